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

/// Writes RGBA bytes, row 0 on top, as PNG. A file of this name is replaced when the new one is complete.
///
/// # Errors
/// `Write` with the path and the cause.
#[cfg(not(target_arch = "wasm32"))]
pub fn save_png(path: &Path, width: u32, height: u32, rgba: &[u8]) -> Result<()> {
    let mut unfinished = path.as_os_str().to_owned();
    unfinished.push(".partial");
    let write = || {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.write_header()?.write_image_data(rgba)?;
        std::fs::write(&unfinished, bytes)?;
        Ok(std::fs::rename(&unfinished, path)?)
    };
    write().map_err(|e: png::EncodingError| {
        // There may be no such file, and the first error is the one to tell.
        let _ = std::fs::remove_file(&unfinished);
        Error::Write { path: path.display().to_string(), reason: e.to_string() }
    })
}
