//! Ways to put a fault into the files of a scan.

use super::FRAMES;
use crate::{Error, Result};
use mesophyll_base::random::RandomStream;
use mesophyll_files::image::{ChannelMaps, Packing, read_exr, write_exr};
use std::path::{Path, PathBuf};

/// Path of a frame.
pub fn frame(capture: &Path, side: &str, pass: &str, k: usize) -> PathBuf {
    capture.join(side).join(pass).join(format!("{k:04}.exr"))
}

/// The same fault in both sides.
pub fn both_sides(put: impl Fn(&str) -> Result<()>) -> Result<()> {
    ["front", "back"].into_iter().try_for_each(put)
}

/// Writes a picture.
pub fn put(path: &Path, maps: &ChannelMaps) -> Result<()> {
    write_exr(path, maps, Packing::Raw)
}

/// Changes every value of a picture.
pub fn change(path: &Path, to: impl Fn(f32) -> f32) -> Result<()> {
    let mut maps = read_exr(path)?;
    maps.channels.iter_mut().flat_map(|c| &mut c.1).for_each(|v| *v = to(*v));
    put(path, &maps)
}

/// Changes every photograph below a folder (its truth and mask stay).
pub fn every(folder: &Path, below: &str, to: fn(f32) -> f32) -> Result<()> {
    let folder = folder.join(below);
    let entries = std::fs::read_dir(&folder).map_err(|e| Error::write(&folder, e))?;
    for path in entries.flatten().map(|e| e.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() && name != "truth" {
            every(&path, "", to)?;
        } else if name.ends_with(".exr") && name != "mask.exr" {
            change(&path, to)?;
        }
    }
    Ok(())
}

/// Codes a value with sRGB's curve.
pub fn srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Exchanges two files or folders.
pub fn exchange(a: &Path, b: &Path) -> Result<()> {
    let aside = a.with_extension("aside");
    [(a, aside.as_path()), (b, a), (&aside, b)]
        .into_iter()
        .try_for_each(|(from, to)| std::fs::rename(from, to).map_err(|e| Error::write(to, e)))
}

/// Turns the order of the frames in a folder round.
pub fn reverse(folder: &Path) -> Result<()> {
    let path = |k: usize| folder.join(format!("{k:04}.exr"));
    (0..FRAMES / 2).try_for_each(|k| exchange(&path(k), &path(FRAMES - 1 - k)))
}

/// Shifts a picture by columns to the right and rows upwards; what comes in is the border's.
pub fn shift(path: &Path, [right, up]: [i64; 2]) -> Result<()> {
    let mut maps = read_exr(path)?;
    let (w, h) = (maps.width as i64, maps.height as i64);
    for (_, values) in &mut maps.channels {
        let old = values.clone();
        for j in 0..h {
            for i in 0..w {
                let (x, y) = ((i - right).clamp(0, w - 1), (j + up).clamp(0, h - 1));
                values[(j * w + i) as usize] = old[(y * w + x) as usize];
            }
        }
    }
    put(path, &maps)
}

/// Mirrors a picture left to right.
pub fn flip(path: &Path) -> Result<()> {
    let mut maps = read_exr(path)?;
    let width = maps.width;
    maps.channels.iter_mut().for_each(|c| c.1.chunks_mut(width).for_each(<[f32]>::reverse));
    put(path, &maps)
}

/// The same picture taken once more: its noise is another one, so that of both together is √2 times as large.
pub fn noisy(mut maps: ChannelMaps, seed: u64) -> ChannelMaps {
    let mut stream = RandomStream::new(seed, &[0xfa]);
    for v in maps.channels.iter_mut().flat_map(|c| &mut c.1) {
        *v += (stream.normal_pair()[0] * (0.01 * f64::from(*v)).hypot(5e-4)) as f32;
    }
    maps
}

/// Sets a number of capture.toml; `table.field` for one of a table.
pub fn manifest(capture: &Path, field: &str, value: f64) -> Result<()> {
    edit(capture, field, |_| value)
}

/// Multiplies a number of capture.toml.
pub fn scale(capture: &Path, field: &str, by: f64) -> Result<()> {
    edit(capture, field, |v| v * by)
}

fn edit(capture: &Path, field: &str, to: impl Fn(f64) -> f64) -> Result<()> {
    with_manifest(capture, |table| {
        let (inner, name) = match field.split_once('.') {
            Some((outer, name)) => (table.get_mut(outer).and_then(toml::Value::as_table_mut)?, name),
            None => (table, field),
        };
        let old = inner.get(name)?.as_float()?;
        inner.insert(name.into(), toml::Value::Float(to(old)));
        Some(())
    })
}

/// Exchanges the ends of the first pass in capture.toml.
pub fn exchange_ends(capture: &Path) -> Result<()> {
    with_manifest(capture, |table| {
        let pass = table.get_mut("pass")?.as_array_mut()?.first_mut()?.as_table_mut()?;
        let (a, b) = (pass.get("start_mm")?.clone(), pass.get("end_mm")?.clone());
        pass.insert("start_mm".into(), b);
        pass.insert("end_mm".into(), a);
        Some(())
    })
}

fn with_manifest(capture: &Path, change: impl FnOnce(&mut toml::Table) -> Option<()>) -> Result<()> {
    let path = capture.join("capture.toml");
    let text = std::fs::read_to_string(&path).map_err(|e| Error::write(&path, e))?;
    let mut table: toml::Table = text.parse().map_err(|e| Error::toml(&path, &text, &e))?;
    change(&mut table).ok_or_else(|| Error::input(&path, "no such field to put a fault into"))?;
    std::fs::write(&path, table.to_string()).map_err(|e| Error::write(&path, e))
}
