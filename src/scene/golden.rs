//! Golden pictures: the reference renderer's, at half size, committed beside the scenes. A fit that was changed and hashed anew still
//! draws another picture than the golden.

use super::manifest::{Manifest, View};
use crate::files::atomic::explain;
use crate::files::image;
use crate::transport::{ReferencePicture, compare as measure};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Pixels of a golden are means over this many pixels a side.
const BLOCK: usize = 2;

/// `golden/SCENE-VIEW.png` beside the scene file.
pub fn path(manifest: &Manifest, view: &View) -> PathBuf {
    manifest.resolve(Path::new("golden")).join(format!("{}-{}.png", manifest.name, view.name))
}

/// Writes the golden of a view.
pub fn write(path: &Path, reference: &ReferencePicture) -> Result<()> {
    let (w, h, pixels) = halved(&reference.ldr, reference.width, reference.height);
    let rgb: Vec<u8> = pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    image::write_png(path, w, h, &rgb)
}

/// FLIP and the largest error of a picture against the golden, over pixels that the reference of today calls interior.
///
/// # Errors
/// [`Error::Input`] when the golden cannot be read or has another size.
pub fn compare(path: &Path, today: &ReferencePicture, picture: &[[u8; 4]]) -> Result<measure::Comparison> {
    let golden = read(path)?;
    let (w, h, drawn) = halved(picture, today.width, today.height);
    if (golden.0, golden.1) != (w, h) {
        let what = format!("found {}x{} pixels, expected {w}x{h}; `mesophyll check --update-golden` writes it anew", golden.0, golden.1);
        return Err(Error::input(path, what));
    }
    let block = |test: &dyn Fn(usize) -> bool| -> Vec<bool> {
        (0..w * h)
            .map(|k| (0..BLOCK * BLOCK).all(|b| test((k / w * BLOCK + b / BLOCK) * today.width + k % w * BLOCK + b % BLOCK)))
            .collect()
    };
    let reference = ReferencePicture {
        width: w,
        height: h,
        hdr: vec![[0.0, 0.0, 0.0, 1.0]; w * h],
        ldr: golden.2,
        noise: vec![0.0; w * h],
        interior: block(&|k| today.interior[k]),
        penumbra: block(&|k| !today.penumbra[k]).into_iter().map(|calm| !calm).collect(),
    };
    measure::compare(&reference, &drawn)
}

fn halved(pixels: &[[u8; 4]], width: usize, height: usize) -> (usize, usize, Vec<[u8; 4]>) {
    let (w, h) = (width / BLOCK, height / BLOCK);
    let mean = |k: usize, c: usize| {
        let sum: u32 =
            (0..BLOCK * BLOCK).map(|b| u32::from(pixels[(k / w * BLOCK + b / BLOCK) * width + k % w * BLOCK + b % BLOCK][c])).sum();
        ((sum + (BLOCK * BLOCK / 2) as u32) / (BLOCK * BLOCK) as u32) as u8
    };
    (w, h, (0..w * h).map(|k| [mean(k, 0), mean(k, 1), mean(k, 2), 255]).collect())
}

fn read(path: &Path) -> Result<(usize, usize, Vec<[u8; 4]>)> {
    let bytes = std::fs::read(path).map_err(|e| Error::input(path, explain(&e)))?;
    let decoded = ::image::load_from_memory_with_format(&bytes, ::image::ImageFormat::Png)
        .map_err(|e| Error::input(path, format!("not a readable PNG ({e})")))?
        .to_rgba8();
    let (w, h) = decoded.dimensions();
    Ok((w as usize, h as usize, decoded.pixels().map(|p| p.0).collect()))
}
