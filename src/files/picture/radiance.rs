//! Radiance pictures (`.hdr`, `.pic`): red, green and blue with a common exponent.

use super::LinearPicture;
use super::primaries::Primaries;
use crate::image::{ChannelMaps, in_proportion};
use crate::{Error, Result, atomic, guard, memory};
use image::ImageDecoder;
use image::codecs::hdr::{HdrDecoder, HdrMetadata};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// What such a file begins with.
const MAGIC: &[u8] = b"#?";
/// A header of more bytes is none.
const HEADER: u64 = 1 << 16;

/// Whether the file begins as a Radiance picture does.
///
/// # Errors
/// [`Error::Input`] for a file that cannot be opened.
pub fn is(path: &Path) -> Result<bool> {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(2).read_to_end(&mut head));
    read.map_err(|e| Error::input(path, atomic::explain(&e)))?;
    Ok(head == MAGIC)
}

/// Reads the picture as radiance: the exposure and the correction of colours that the header states are taken out.
///
/// # Errors
/// [`Error::Input`] for a file that is damaged, or is stored in another order or other colours than red, green, blue.
pub fn read(path: &Path, fits: impl FnOnce(usize, usize) -> Result<()>) -> Result<LinearPicture> {
    let broken = |e: image::ImageError| {
        Error::input(path, format!("not a readable Radiance picture ({e}); expected -Y H +X W and 32-bit_rle_rgbe"))
    };
    header(path)?;
    let file = File::open(path).map_err(|e| Error::input(path, atomic::explain(&e)))?;
    let length = file.metadata().map_err(|e| Error::input(path, atomic::explain(&e)))?.len();
    let decoder = HdrDecoder::new_nonstrict(BufReader::with_capacity(1 << 17, file)).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    fits(width, height)?;
    in_proportion(path, [width, height], 3, length)?;
    memory::require(24 * (width * height) as u64, &format!("{}: {width}x{height} pixels", path.display()))?;
    let meta = decoder.metadata();
    let mut bytes = vec![0; 12 * width * height];
    guard::guarded(|| decoder.read_image(&mut bytes).map_err(broken))
        .unwrap_or_else(|| Err(Error::input(path, "not a readable Radiance picture (damaged)")))?;
    let mut said = Vec::new();
    let gain = gain(path, &meta, &mut said)?;
    let mut maps = ChannelMaps::new(width, height);
    for (c, name) in super::RGB.iter().enumerate() {
        let sample = |pixel: &[u8]| f32::from_ne_bytes([0, 1, 2, 3].map(|k| pixel[4 * c + k])) * gain[c];
        maps.push(*name, bytes.chunks_exact(12).map(sample).collect());
    }
    let stated = meta.custom_attributes.iter().find(|(key, _)| key == "PRIMARIES");
    let primaries = stated.map(|(_, text)| primaries_of(text).ok_or(text)).transpose();
    let primaries = primaries.map_err(|text| {
        Error::field(path, "PRIMARIES", format!("found {text:?}; expected x and y of red, green, blue and white"))
    })?;
    super::recolour(path, &mut maps, primaries.as_ref(), &mut said)?;
    Ok(LinearPicture { maps, said })
}

/// Refuses a file without an end of its header, before the decoder looks for it.
fn header(path: &Path) -> Result<()> {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEADER).read_to_end(&mut head));
    read.map_err(|e| Error::input(path, atomic::explain(&e)))?;
    if head.windows(2).any(|w| w == b"\n\n") || head.windows(4).any(|w| w == b"\r\n\r\n") {
        return Ok(());
    }
    Err(Error::input(path, "not a readable Radiance picture: no empty line ends its header (truncated?)"))
}

/// What each channel is multiplied by, so that it becomes radiance.
fn gain(path: &Path, meta: &HdrMetadata, said: &mut Vec<String>) -> Result<[f32; 3]> {
    let (exposure, (r, g, b)) = (meta.exposure.unwrap_or(1.0), meta.color_correction.unwrap_or((1.0, 1.0, 1.0)));
    let divided = [r, g, b].map(|c| c * exposure);
    if divided.iter().any(|d| !(*d > 0.0 && d.is_finite())) {
        let what = format!("found {exposure} and corrections {r} {g} {b}; expected numbers above 0");
        return Err(Error::field(path, "EXPOSURE", what));
    }
    if divided != [1.0; 3] {
        said.push(format!("the header states exposures; red, green and blue are divided by {divided:?}"));
    }
    Ok(divided.map(f32::recip))
}

fn primaries_of(text: &str) -> Option<Primaries> {
    let numbers: Vec<f64> = text.split_whitespace().map(|t| t.parse().ok()).collect::<Option<_>>()?;
    let [a, b, c, d, e, f, g, h] = numbers[..] else { return None };
    Some([[a, b], [c, d], [e, f], [g, h]])
}
