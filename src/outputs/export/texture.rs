//! Maps as 8-bit pictures. Colours (ρd, ρt, ρs) are sRGB-encoded; everything else is data, linear in the byte.

use super::side::ExportSideMaps;
use crate::Error;
use crate::Result;
use mesophyll_files::claim::{self, OutputKind};
use mesophyll_files::image::to_srgb8;
use mesophyll_files::quantity::{self, Quantity};
use mesophyll_files::{atomic, image};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Whether a picture is mirrored: the back's maps are, when they are laid on the front's texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextureMirroring {
    /// As the side's own camera saw it.
    AsSeen,
    /// Left and right exchanged.
    Mirrored,
}

/// RGB bytes of a side, texel by texel.
pub fn pixels(side: &ExportSideMaps, turn: TextureMirroring, pixel: impl Fn(usize) -> [u8; 3]) -> Vec<u8> {
    let width = side.maps.width;
    let source = |k: usize| if turn == TextureMirroring::AsSeen { k } else { mesophyll_optics::side::behind(k, width) };
    (0..width * side.maps.height).flat_map(|k| pixel(source(k))).collect()
}

/// A PNG in memory.
pub fn encode(path: &Path, width: usize, height: usize, rgb: &[u8]) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    let failed = |e: png::EncodingError| Error::write(path, e);
    encoder.write_header().map_err(failed)?.write_image_data(rgb).map_err(failed)?;
    Ok(bytes)
}

/// Maps [low, high] linearly to 0 … 255.
pub(crate) fn data_byte(value: f32, low: f64, high: f64) -> u8 {
    let t = (f64::from(value) - low) / (high - low);
    if t.is_nan() { 0 } else { (t.clamp(0.0, 1.0) * 255.0).round() as u8 }
}

/// A unit normal as colours, x = 2·byte/255 − 1 (mirrored pictures mirror x as well).
pub(crate) fn normal_pixel(n: [f32; 3], turn: TextureMirroring) -> [u8; 3] {
    let x = if turn == TextureMirroring::Mirrored { -n[0] } else { n[0] };
    [x, n[1], n[2]].map(|v| data_byte(v, -1.0, 1.0))
}

/// `PATH/front_rho_d.png` … and `PATH/ranges.json`.
///
/// # Errors
/// A folder that holds something else (see [`claim::folder`]), among it the fit itself (`from`), or that cannot be
/// written.
pub fn folder(sides: &[ExportSideMaps], from: &Path, path: &Path) -> Result<Vec<PathBuf>> {
    let _claim = claim::folder(path, OutputKind::Maps, &[from])?;
    claim::begin(path, OutputKind::Maps)?;
    let mut written = Vec::new();
    let mut ranges = Map::new();
    for side in sides {
        let (width, height) = (side.maps.width, side.maps.height);
        let mut save = |what: &str, bytes: &[u8], meaning: Value| {
            let name = format!("{}_{what}.png", side.side.name());
            image::write_png(&path.join(&name), width, height, bytes)?;
            written.push(path.join(&name));
            ranges.insert(name, meaning);
            Ok::<(), Error>(())
        };
        let mut names: Vec<&str> = side.maps.channels.iter().map(|(n, _)| quantity::split(n).0).collect();
        names.sort_unstable();
        names.dedup();
        for name in names {
            let planes: Vec<&[f32]> =
                side.maps.channels.iter().filter(|(n, _)| quantity::split(n).0 == name).map(|(_, p)| &p[..]).collect();
            match (name.parse(), planes.as_slice()) {
                (Ok(Quantity::Mask), [mask]) => {
                    let bytes = pixels(side, TextureMirroring::AsSeen, |k| {
                        [if mask[k] > 0.5 {
                            255
                        } else if mask[k] < -0.5 {
                            128
                        } else {
                            0
                        }; 3]
                    });
                    save(name, &bytes, json!({"encoding": "255 good, 128 defective, 0 outside"}))?;
                }
                (Ok(Quantity::Normal), [x, y, z]) => {
                    let bytes = pixels(side, TextureMirroring::AsSeen, |k| {
                        normal_pixel([x[k], y[k], z[k]], TextureMirroring::AsSeen)
                    });
                    let axes = "x right, y up, z out of this side";
                    save(name, &bytes, json!({"encoding": "linear", "low": -1.0, "high": 1.0, "axes": axes}))?;
                }
                (Ok(Quantity::RhoD | Quantity::RhoT | Quantity::RhoS), [r, g, b]) => {
                    let bytes =
                        pixels(side, TextureMirroring::AsSeen, |k| [to_srgb8(r[k]), to_srgb8(g[k]), to_srgb8(b[k])]);
                    save(name, &bytes, json!({"encoding": "sRGB (IEC 61966-2-1), 1 = 255"}))?;
                }
                (_, [r, g, b]) => {
                    let each = [r, g, b].map(|p| side.range(p));
                    let (low, high) = (
                        each.iter().map(|r| r.0).fold(f64::INFINITY, f64::min),
                        each.iter().map(|r| r.1).fold(f64::NEG_INFINITY, f64::max),
                    );
                    let bytes =
                        pixels(side, TextureMirroring::AsSeen, |k| [r[k], g[k], b[k]].map(|v| data_byte(v, low, high)));
                    save(name, &bytes, json!({"encoding": "linear", "low": low, "high": high}))?;
                }
                (_, [plane]) => {
                    let (low, high) = side.range(plane);
                    let bytes = pixels(side, TextureMirroring::AsSeen, |k| [data_byte(plane[k], low, high); 3]);
                    save(name, &bytes, json!({"encoding": "linear", "low": low, "high": high}))?;
                }
                _ => {}
            }
        }
    }
    let about = json!({"about": "linear: value = low + (high - low) * byte / 255, clipped to 1 and 99 % of the good \
     texels; the EXR maps hold the exact values", "files": ranges});
    let text = serde_json::to_vec_pretty(&about).map_err(|e| Error::write(path, e))?;
    atomic::write_bytes(&path.join("ranges.json"), &text)?;
    claim::finish(path)?;
    written.push(path.join("ranges.json"));
    Ok(written)
}
