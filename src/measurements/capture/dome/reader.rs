//! A capture under a dome, opened: every file that it needs exists, has the right size, and is read. The dark level is
//! subtracted from photographs.

use super::manifest::{DomeManifest, DomePicture, empty_path, white_path};
use crate::folder::{self, check_image, content_hash, read_rgb};
use crate::reader::FramePixels;
use crate::{Error, Result};
use mesophyll_files::image::{ChannelMaps, read_exr_rows};
use mesophyll_optics::side::{Side, Sides};
use std::path::{Path, PathBuf};

/// One side's pictures, as its camera saw it.
#[derive(Debug, Clone)]
pub struct DomeSidePictures {
    /// Photograph under the dome, less the dark frame.
    pub albedo: FramePixels,
    /// Photograph in front of the back light, less the dark frame.
    pub translucency: FramePixels,
    /// Height (mm) towards the camera, above the scan's own zero; NaN is a hole.
    pub height: Vec<f32>,
    /// How many readings under the dome share the highest recorded value: many where a sensor clips.
    pub clipped: usize,
    /// Which texels read `full_scale` or more in either photograph.
    pub saturated: Vec<bool>,
}

/// A validated capture in memory.
#[derive(Debug)]
pub struct DomeCapture {
    /// The folder that was read.
    pub folder: PathBuf,
    /// The contents of its `capture.toml`.
    pub manifest: DomeManifest,
    /// The pictures of both sides, each in its own camera's columns.
    pub sides: Sides<DomeSidePictures>,
    /// Photograph of the white sheet, less the dark frame.
    pub white: FramePixels,
    /// Photograph of the back light, less the dark frame.
    pub empty: FramePixels,
    /// Whether there is a dark frame.
    pub has_dark: bool,
    /// `mask.exr`, in the front's columns.
    pub mask: Option<Vec<bool>>,
}

impl DomeCapture {
    /// Opens `folder`.
    ///
    /// # Errors
    /// [`Error::Input`] naming the first file that is missing, of another size, without its channels, or without any
    /// reading.
    pub fn open(folder: &Path) -> Result<DomeCapture> {
        let manifest = DomeManifest::read(folder)?;
        check_files(folder, &manifest).into_iter().next().map_or(Ok(()), Err)?;
        let dark_path = folder.join("dark.exr");
        let dark = if dark_path.exists() { Some(read_rgb(&dark_path)?) } else { None };
        let photograph = |path: &Path| -> Result<(FramePixels, Vec<bool>, usize)> {
            let mut image = read_rgb(path)?;
            if image.iter().all(|v| v.iter().any(|c| !c.is_finite())) {
                return Err(Error::input(path, "no reading anywhere (all NaN)"));
            }
            let full = manifest.full_scale.unwrap_or(f64::INFINITY) as f32;
            let saturated = image.iter().map(|v| v.iter().any(|c| *c >= full)).collect();
            let highest = image.iter().flatten().copied().filter(|v| v.is_finite()).fold(f32::MIN, f32::max);
            let clipped = image.iter().flatten().filter(|v| **v == highest).count();
            if let Some(dark) = &dark {
                image.iter_mut().zip(dark).for_each(|(v, d)| *v -= *d);
            }
            Ok((image, saturated, clipped))
        };
        let side = |side: Side| -> Result<DomeSidePictures> {
            let path = |p: DomePicture| p.path(folder, side);
            let (albedo, a, clipped) = photograph(&path(DomePicture::Albedo))?;
            let (translucency, t, _) = photograph(&path(DomePicture::Translucency))?;
            let height = read_exr_rows(&path(DomePicture::Height), Some(&["Y"]), None)?.channels.swap_remove(0).1;
            if height.iter().all(|h| !h.is_finite()) {
                return Err(Error::input(&path(DomePicture::Height), "no height anywhere (all NaN)"));
            }
            Ok(DomeSidePictures {
                albedo,
                translucency,
                height,
                clipped,
                saturated: a.into_iter().zip(t).map(|(a, t)| a || t).collect(),
            })
        };
        let sides = Sides::try_of(side)?;
        let (white, empty) = (photograph(&white_path(folder))?.0, photograph(&empty_path(folder))?.0);
        for (path, image) in [(white_path(folder), &white), (empty_path(folder), &empty)] {
            let unlit = image.iter().filter(|v| v.iter().any(|c| *c <= 0.0)).count();
            if 2 * unlit > image.len() {
                let share = 100.0 * unlit as f64 / image.len() as f64;
                return Err(Error::input(
                    &path,
                    format!(
                        "{share:.1} % of the texels are no brighter than the dark frame; expected light everywhere"
                    ),
                ));
            }
        }
        let mask = folder::mask(folder, manifest.size())?;
        if mask.as_ref().is_some_and(|mask| !mask.contains(&true)) {
            return Err(Error::field(&folder.join("mask.exr"), "Y", "no texel is 1, so there is no leaf"));
        }
        Ok(DomeCapture { folder: folder.to_path_buf(), manifest, sides, white, empty, has_dark: dark.is_some(), mask })
    }

    /// Content hash of everything a fit reads.
    pub fn hash(&self) -> Result<String> {
        content_hash(&self.folder, &self.files())
    }

    /// Every file a fit reads, in a fixed order.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files = vec![self.folder.join("capture.toml")];
        files.extend(required(&self.folder).into_iter().map(|(path, _)| path));
        files.extend(["dark.exr", "mask.exr"].map(|n| self.folder.join(n)).into_iter().filter(|p| p.exists()));
        files
    }

    /// `truth/front.exr` of a synthetic capture.
    pub fn truth(&self, side: Side) -> Result<Option<ChannelMaps>> {
        folder::truth(&self.folder, side, self.manifest.size())
    }
}

/// The pictures that a capture must have, and their channels.
fn required(folder: &Path) -> Vec<(PathBuf, &'static [&'static str])> {
    let sides = [Side::Front, Side::Back];
    let pictures = sides.iter().flat_map(|&s| DomePicture::ALL.map(|p| (p.path(folder, s), p.channels())));
    pictures.chain([white_path(folder), empty_path(folder)].map(|p| (p, DomePicture::Albedo.channels()))).collect()
}

/// Everything that is wrong with the presence, size and channels of the files; their samples are not read.
pub(crate) fn check_files(folder: &Path, manifest: &DomeManifest) -> Vec<Error> {
    let optional = [("dark.exr", DomePicture::Albedo.channels()), ("mask.exr", DomePicture::Height.channels())];
    let optional =
        optional.into_iter().map(|(name, channels)| (folder.join(name), channels)).filter(|(p, _)| p.exists());
    required(folder)
        .into_iter()
        .chain(optional)
        .filter_map(|(path, channels)| check_image(&path, channels, manifest.size()).err())
        .collect()
}
