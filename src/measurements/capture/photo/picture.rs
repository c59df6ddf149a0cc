//! A photograph in memory: linear light, with pixels that are clipped (+∞) or without a reading (NaN).

use super::encoding::{self, TonalSteps};
use super::manifest::PhotoManifest;
use crate::photo::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_files::memory;
use mesophyll_files::picture::{self, PictureRequest, RGB};
use std::path::{Path, PathBuf};

/// Largest picture that is read (pixels); larger ones can be developed smaller.
const PIXELS: usize = 120_000_000;
/// Memory that is in use for a pixel of a picture where it is largest: two pictures, their ratio and masks (measured).
const BYTES: u64 = 60;

/// A photograph, row-major, row 0 on top.
#[derive(Debug, Clone)]
pub struct LinearPhotograph {
    /// Where it was read from.
    pub path: PathBuf,
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear readings; +∞ where a channel is clipped, NaN where there is none.
    pub pixels: Vec<Rgb<f32>>,
    /// The highest reading that is not clipped, and the number of readings that share it: many where a sensor clips
    /// without a stated full scale.
    pub highest: (f32, usize),
    /// The steps of its numbers, where they have 8 bits.
    pub steps: Option<TonalSteps>,
}

impl LinearPhotograph {
    /// Columns and rows.
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    /// Reads an EXR or a Radiance file, a PNG or a TIFF file with 16 bits a channel, or one of these or a JPEG with
    /// 8 bits and a known curve.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that is missing, broken, of another kind, without colours, with 8 bits a channel and
    /// no curve, or too large.
    pub fn read(path: &Path, manifest: &PhotoManifest) -> Result<LinearPhotograph> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let (width, height, mut pixels, steps) = match extension.as_str() {
            "exr" | "hdr" => linear(path)?,
            "png" | "tif" | "tiff" | "jpg" | "jpeg" => encoding::read(path, manifest.transfer)?,
            _ => {
                let expected =
                    "an .exr or .hdr file, or a .png, .tif or .tiff file with 16 bits a channel, developed from RAW";
                return Err(Error::input(path, format!("found a file of another kind, expected {expected}")));
            }
        };
        let full = manifest.full_scale.map_or(f32::INFINITY, |full| full as f32);
        let mut highest = (f32::MIN, 0);
        for value in pixels.iter_mut().flatten() {
            if *value >= full {
                *value = f32::INFINITY;
            } else if *value > highest.0 {
                highest = (*value, 1);
            } else if *value == highest.0 {
                highest.1 += 1;
            }
        }
        if highest.1 == 0 {
            return Err(Error::input(path, "no reading anywhere: every pixel is clipped or NaN"));
        }
        Ok(LinearPhotograph { path: path.into(), width, height, pixels, highest, steps })
    }

    /// The mean of the three channels, which is not finite where one is not.
    pub fn grey(&self, k: usize) -> f32 {
        self.pixels[k].iter().sum::<f32>() / 3.0
    }

    /// Share of the pixels of `rectangle` (left, top, width, height; inside the picture) that are clipped. A value that
    /// many readings of the picture share as their highest counts as clipped.
    pub fn clipped(&self, rectangle: [usize; 4]) -> f64 {
        let [left, top, width, height] = rectangle;
        let top_value = if self.highest.1 > 8 + self.pixels.len() / 2000 { self.highest.0 } else { f32::INFINITY };
        let at = (top..top + height).flat_map(|j| (left..left + width).map(move |i| (i, j)));
        let count = at.filter(|&(i, j)| self.pixels[j * self.width + i].iter().any(|v| *v >= top_value)).count();
        count as f64 / (width * height).max(1) as f64
    }

    /// The value at a place between pixels (pixel (i, j) has its centre at (i + ½, j + ½)), weighted linearly. NaN
    /// outside and beside pixels without a reading, +∞ beside clipped ones.
    pub fn at(&self, [x, y]: [f64; 2]) -> Rgb {
        let (x, y) = (x - 0.5, y - 0.5);
        if !(x >= 0.0 && y >= 0.0 && x <= (self.width - 1) as f64 && y <= (self.height - 1) as f64) {
            return Rgb::splat(f64::NAN);
        }
        let (i, j) = ((x as usize).min(self.width.max(2) - 2), (y as usize).min(self.height.max(2) - 2));
        let (u, v) = (x - i as f64, y - j as f64);
        let mut sum = Rgb::splat(0.0);
        for (di, dj, w) in [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)]
        {
            if w > 1e-9 {
                sum += w * self.pixels[(j + dj) * self.width + i + di].map(f64::from);
            }
        }
        sum
    }
}

/// Refuses a picture that is too small or too large.
pub(super) fn too_large(path: &Path, width: usize, height: usize) -> Result<()> {
    if width < 16 || height < 16 || width.saturating_mul(height) > PIXELS {
        let expected = format!("at least 16 by 16 and at most {PIXELS} pixels");
        return Err(Error::input(path, format!("found {width}x{height} pixels, expected {expected}")));
    }
    memory::require(BYTES * (width * height) as u64, &format!("{}: a picture of this size", path.display()))
}

fn linear(path: &Path) -> Result<encoding::Read> {
    let request = PictureRequest { names: &RGB, all: false, outside: f32::NAN };
    let picture::LinearPicture { maps, said } = picture::read(path, &request, |w, h| too_large(path, w, h))?;
    picture::tell(path, &said);
    Ok((maps.width, maps.height, maps.rgb(), None))
}
