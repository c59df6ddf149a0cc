//! A finished picture.

#[cfg(not(target_arch = "wasm32"))]
use crate::error::{Error, Result};
#[cfg(not(target_arch = "wasm32"))]
use std::path::Path;

/// A picture, row by row, with row 0 on top.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Linear radiance before exposure; alpha is the share of the pixel that leaves cover.
    pub hdr: Vec<[f32; 4]>,
    /// Tone-mapped sRGB; alpha is 255.
    pub ldr: Vec<[u8; 4]>,
}

impl Picture {
    /// The pixel at column `x`, row `y`: radiance and coverage.
    pub fn radiance(&self, x: u32, y: u32) -> [f32; 4] {
        self.hdr[(y * self.width + x) as usize]
    }

    /// Writes the tone-mapped picture as PNG.
    ///
    /// # Errors
    /// `Write` with the path and the cause.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn save_png(&self, path: &Path) -> Result<()> {
        save_png(path, self.width, self.height, self.ldr.as_flattened())
    }
}

/// Writes RGBA bytes, row 0 on top, as PNG.
///
/// # Errors
/// `Write` with the path and the cause.
#[cfg(not(target_arch = "wasm32"))]
pub fn save_png(path: &Path, width: u32, height: u32, rgba: &[u8]) -> Result<()> {
    let write = || {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.write_header()?.write_image_data(rgba)?;
        Ok(std::fs::write(path, bytes)?)
    };
    write().map_err(|e: png::EncodingError| Error::Write { path: path.display().to_string(), reason: e.to_string() })
}
