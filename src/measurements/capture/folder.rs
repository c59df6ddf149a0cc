//! What the readers of all captures ask of the files in a folder.

use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use mesophyll_files::hash;
use mesophyll_files::image::{ChannelMaps, ExrInfo, exr_info, read_exr, read_exr_rows};
use mesophyll_files::quantity::RGB;
use mesophyll_optics::side::Side;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Refuses an image of another size than the manifest states.
pub(crate) fn check_size(path: &Path, info: &ExrInfo, size: ImageSize) -> Result<()> {
    if ImageSize::new(info.width, info.height) == size {
        return Ok(());
    }
    let what = format!("found {}x{} texels, capture.toml says {}x{}", info.width, info.height, size.width, size.height);
    Err(Error::input(path, what))
}

/// Refuses an image of another size, or without one of the channels; its samples are not read.
pub(crate) fn check_image(path: &Path, channels: &[&str], size: ImageSize) -> Result<()> {
    let info = exr_info(path)?;
    check_size(path, &info, size)?;
    match channels.iter().find(|name| !info.channels.iter().any(|c| c == *name)) {
        Some(name) => {
            Err(Error::field(path, name, format!("no such channel; the file holds {}", info.channels.join(", "))))
        }
        None => Ok(()),
    }
}

/// Content hash of files under their names in the folder. Their whole content is hashed: names, sizes and a sample of
/// the bytes would miss edits.
pub(crate) fn content_hash(folder: &Path, files: &[PathBuf]) -> Result<String> {
    let hashes: Vec<String> = files.par_iter().map(|p| hash::file(p)).collect::<Result<_>>()?;
    let names: Vec<_> = files.iter().map(|p| p.strip_prefix(folder).unwrap_or(p).to_string_lossy()).collect();
    Ok(hash::combine(names.iter().map(AsRef::as_ref).zip(hashes.iter().map(String::as_str))))
}

/// The colours of a whole image.
pub(crate) fn read_rgb(path: &Path) -> Result<Vec<Rgb<f32>>> {
    Ok(read_exr_rows(path, Some(&RGB), None)?.rgb())
}

/// `mask.exr` (channel Y), where there is one.
pub(crate) fn mask(folder: &Path, size: ImageSize) -> Result<Option<Vec<bool>>> {
    let path = folder.join("mask.exr");
    if !path.exists() {
        return Ok(None);
    }
    check_size(&path, &exr_info(&path)?, size)?;
    Ok(Some(read_exr_rows(&path, Some(&["Y"]), None)?.channels[0].1.iter().map(|&v| v > 0.5).collect()))
}

/// `truth/front.exr` of a synthetic capture, where there is one.
pub(crate) fn truth(folder: &Path, side: Side, size: ImageSize) -> Result<Option<ChannelMaps>> {
    let path = crate::truth_path(folder, side);
    if !path.exists() {
        return Ok(None);
    }
    check_size(&path, &exr_info(&path)?, size)?;
    read_exr(&path).map(Some)
}
