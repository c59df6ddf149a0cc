//! A capture under a dome, opened: every file that it needs exists, has the right size, and is read. The dark level is
//! subtracted from photographs.

use super::manifest::{DomeManifest, DomePicture, empty_path, white_path};
use crate::{Error, Result};
use mesophyll_files::hash;
use mesophyll_files::image::{ChannelMaps, ExrInfo, exr_info, read_exr, read_exr_rows};
use mesophyll_optics::side::Side;
use std::path::{Path, PathBuf};

/// One RGB triple a texel, row-major.
pub type DomePixels = Vec<[f32; 3]>;

/// One side's pictures, as its camera saw it.
#[derive(Debug, Clone)]
pub struct DomeSidePictures {
    /// Photograph under the dome, less the dark frame.
    pub albedo: DomePixels,
    /// Photograph in front of the back light, less the dark frame.
    pub translucency: DomePixels,
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
    /// The front's pictures.
    pub front: DomeSidePictures,
    /// The back's pictures, in its own camera's columns.
    pub back: DomeSidePictures,
    /// Photograph of the white sheet, less the dark frame.
    pub white: DomePixels,
    /// Photograph of the back light, less the dark frame.
    pub empty: DomePixels,
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
        let dark = if dark_path.exists() { Some(rgb(&dark_path)?) } else { None };
        let photograph = |path: &Path| -> Result<(DomePixels, Vec<bool>, usize)> {
            let mut image = rgb(path)?;
            if image.iter().all(|v| v.iter().any(|c| !c.is_finite())) {
                return Err(Error::input(path, "no reading anywhere (all NaN)"));
            }
            let full = manifest.full_scale.unwrap_or(f64::INFINITY) as f32;
            let saturated = image.iter().map(|v| v.iter().any(|c| *c >= full)).collect();
            let highest = image.iter().flatten().copied().filter(|v| v.is_finite()).fold(f32::MIN, f32::max);
            let clipped = image.iter().flatten().filter(|v| **v == highest).count();
            if let Some(dark) = &dark {
                for (v, d) in image.iter_mut().zip(dark) {
                    (0..3).for_each(|c| v[c] -= d[c]);
                }
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
        let (front, back) = (side(Side::Front)?, side(Side::Back)?);
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
        let mask_path = folder.join("mask.exr");
        let mask = if mask_path.exists() {
            let mask: Vec<bool> =
                read_exr_rows(&mask_path, Some(&["Y"]), None)?.channels[0].1.iter().map(|&v| v > 0.5).collect();
            if !mask.contains(&true) {
                return Err(Error::field(&mask_path, "Y", "no texel is 1, so there is no leaf"));
            }
            Some(mask)
        } else {
            None
        };
        Ok(DomeCapture {
            folder: folder.to_path_buf(),
            manifest,
            front,
            back,
            white,
            empty,
            has_dark: dark.is_some(),
            mask,
        })
    }

    /// One side's pictures.
    pub fn pictures(&self, side: Side) -> &DomeSidePictures {
        match side {
            Side::Front => &self.front,
            Side::Back => &self.back,
        }
    }

    /// Content hash of everything a fit reads.
    pub fn hash(&self) -> Result<String> {
        let files = self.files();
        let hashes: Vec<String> = files.iter().map(|p| hash::file(p)).collect::<Result<_>>()?;
        let names: Vec<String> =
            files.iter().map(|p| p.strip_prefix(&self.folder).unwrap_or(p).to_string_lossy().into_owned()).collect();
        Ok(hash::combine(names.iter().map(String::as_str).zip(hashes.iter().map(String::as_str))))
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
        let path = crate::truth_path(&self.folder, side);
        if !path.exists() {
            return Ok(None);
        }
        check_size(&path, &exr_info(&path)?, &self.manifest)?;
        read_exr(&path).map(Some)
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
        .filter_map(|(path, channels)| check_image(&path, channels, manifest).err())
        .collect()
}

fn check_image(path: &Path, channels: &[&str], manifest: &DomeManifest) -> Result<()> {
    let info = exr_info(path)?;
    check_size(path, &info, manifest)?;
    match channels.iter().find(|name| !info.channels.iter().any(|c| c == *name)) {
        Some(name) => {
            Err(Error::field(path, name, format!("no such channel; the file holds {}", info.channels.join(", "))))
        }
        None => Ok(()),
    }
}

fn check_size(path: &Path, info: &ExrInfo, m: &DomeManifest) -> Result<()> {
    if (info.width, info.height) != (m.width, m.height) {
        let what = format!("found {}x{} texels, capture.toml says {}x{}", info.width, info.height, m.width, m.height);
        return Err(Error::input(path, what));
    }
    Ok(())
}

fn rgb(path: &Path) -> Result<DomePixels> {
    Ok(crate::reader::interleave(&read_exr_rows(path, Some(&["R", "G", "B"]), None)?))
}
