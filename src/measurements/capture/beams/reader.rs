//! Photographs under beams, opened for fitting: all of them exist, have one size, and hold readings.

use super::manifest::{BeamPhotograph, BeamsManifest};
use crate::folder::{check_size, content_hash};
use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_files::image::{exr_info, read_exr_rows};
use mesophyll_files::quantity::RGB;
use std::path::{Path, PathBuf};

/// A validated capture with its photographs.
#[derive(Debug)]
pub struct BeamsCapture {
    /// The folder that was read.
    pub folder: PathBuf,
    /// The contents of its `capture.toml`.
    pub manifest: BeamsManifest,
    /// For each photograph and channel (R G B): values in the *lit* side's columns, row by row; NaN where there is no
    /// reading.
    pub photographs: Vec<[Vec<f64>; 3]>,
}

impl BeamsCapture {
    /// # Errors
    /// [`Error::Input`] naming the first file that is missing, of another size, without a channel, or without a
    /// reading.
    pub fn open(folder: &Path) -> Result<BeamsCapture> {
        let manifest = BeamsManifest::read(folder)?;
        let photographs = manifest.beams.iter().map(|b| photograph(folder, &manifest, b)).collect::<Result<_>>()?;
        Ok(BeamsCapture { folder: folder.to_path_buf(), manifest, photographs })
    }

    /// Content hash of everything a fit reads.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn hash(&self) -> Result<String> {
        let names = std::iter::once("capture.toml").chain(self.manifest.beams.iter().map(|b| b.file.as_str()));
        content_hash(&self.folder, &names.map(|name| self.folder.join(name)).collect::<Vec<_>>())
    }
}

/// One photograph in the lit side's columns, a channel (R G B) each; NaN where there is no reading.
///
/// # Errors
/// As [`BeamsCapture::open`].
pub fn photograph(folder: &Path, manifest: &BeamsManifest, beam: &BeamPhotograph) -> Result<[Vec<f64>; 3]> {
    let path = folder.join(&beam.file);
    check_size(&path, &exr_info(&path)?, ImageSize::new(manifest.width, manifest.height))?;
    let maps = read_exr_rows(&path, Some(&RGB), None)?;
    let mut channels: [Vec<f64>; 3] = Default::default();
    for (channel, name) in channels.iter_mut().zip(RGB) {
        let seen = maps.require(&path, name)?;
        // The lit side's camera would see the place of column i at column width − 1 − i.
        *channel = seen.chunks(manifest.width).flat_map(|row| row.iter().rev().map(|v| f64::from(*v))).collect();
        if !channel.iter().any(|v| v.is_finite()) {
            return Err(Error::field(&path, name, "no texel has a reading; expected a photograph"));
        }
    }
    Ok(channels)
}
