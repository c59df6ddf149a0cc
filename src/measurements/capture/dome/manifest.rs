//! `capture.toml` of a capture under a dome. Lengths in mm; unknown fields are errors.

use crate::Result;
use crate::kind::{self, CaptureKind};
use crate::manifest_check::ManifestCheck;
use mesophyll_base::image::ImageSize;
use mesophyll_optics::side::Side;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What was photographed and scanned, and how (format: `data/README.md`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DomeManifest {
    /// Version of the format.
    pub schema: u32,
    /// `dome`.
    pub kind: String,
    /// The leaf's name.
    pub name: String,
    /// Columns of every picture.
    pub width: usize,
    /// Rows of every picture.
    pub height: usize,
    /// Size of a texel on the blade (mm).
    pub texel_mm: f64,
    /// Thickness of the thickest place in the pictures, by caliper (mm).
    pub thickness_max_mm: f64,
    /// Standard error of the caliper's reading (mm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_max_err_mm: Option<f64>,
    /// Width of the caliper's contact (mm). The caliper measures the mean thickness under it.
    #[serde(default = "contact")]
    pub contact_mm: f64,
    /// Noise sd of a photograph's reading = √((relative·value)² + floor²); estimated when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_relative: Option<f64>,
    /// The part of the noise that does not grow with the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_floor: Option<f64>,
    /// The number of exposures that white, back light and dark are averages of; their noise is smaller by its square
    /// root.
    #[serde(default = "one_shot")]
    pub reference_shots: u32,
    /// Noise sd of a height as delivered (mm); estimated when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_noise_mm: Option<f64>,
    /// Standard deviation of the Gaussian that the scans were smoothed with before delivery (mm).
    #[serde(default)]
    pub height_filter_mm: f64,
    /// Readings of this value or more are saturated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub full_scale: Option<f64>,
    /// Reflectance of the white sheet.
    #[serde(default = "white")]
    pub white_reflectance: f64,
    /// Effective refractive index of front and back surface, which says how much of the dome's light is mirrored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub highlight_index: Option<[f64; 2]>,
    /// `front` and `back`.
    pub sides: Vec<Side>,
}

fn contact() -> f64 {
    1.0
}

fn one_shot() -> u32 {
    1
}

fn white() -> f64 {
    1.0
}

impl DomeManifest {
    /// Reads and validates `CAPTURE/capture.toml`.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the field, what was found and what was expected; also for a capture of the
    /// other kind.
    pub fn read(folder: &Path) -> Result<DomeManifest> {
        let (path, manifest) = kind::read::<DomeManifest>(folder, CaptureKind::Dome)?;
        manifest.validate(&path)?;
        Ok(manifest)
    }

    fn validate(&self, path: &Path) -> Result<()> {
        let fields = ManifestCheck { path };
        let bad =
            |field: &str, found: &dyn std::fmt::Display, expected: &str| Err(fields.wrong(field, found, expected));
        fields.photographs(self.schema, self.width, self.height, 3..=65_536)?;
        fields.positive_mm([("texel_mm", self.texel_mm), ("thickness_max_mm", self.thickness_max_mm)])?;
        fields.not_negative([
            ("thickness_max_err_mm", self.thickness_max_err_mm),
            ("noise_relative", self.noise_relative),
            ("noise_floor", self.noise_floor),
            ("height_noise_mm", self.height_noise_mm),
            ("contact_mm", Some(self.contact_mm)),
            ("height_filter_mm", Some(self.height_filter_mm)),
        ])?;
        for (field, value) in [("height_filter_mm", self.height_filter_mm), ("contact_mm", 0.25 * self.contact_mm)] {
            if value > 32.0 * self.texel_mm.max(0.01) {
                return bad(field, &value, "less: it would level out every vein");
            }
        }
        if let Some(full) = self.full_scale
            && !(full > 0.0 && full.is_finite())
        {
            return bad("full_scale", &full, "a positive reading");
        }
        if !(self.white_reflectance > 0.0 && self.white_reflectance <= 1.0) {
            return bad("white_reflectance", &self.white_reflectance, "more than 0 and at most 1");
        }
        if self.reference_shots == 0 {
            return bad("reference_shots", &self.reference_shots, "1 or more");
        }
        if let Some(index) = self.highlight_index
            && !index.iter().all(|n| (1.0..=2.5).contains(n))
        {
            return bad("highlight_index", &format!("{index:?}"), "[front, back], refractive indices of 1 to 2.5");
        }
        if self.sides != [Side::Front, Side::Back] {
            let found = format!("{:?}", self.sides.iter().map(|s| s.name()).collect::<Vec<_>>());
            return bad("sides", &found, "[\"front\", \"back\"]: thickness is the difference of both sides' heights");
        }
        Ok(())
    }

    /// Standard deviation (texels) of the Gaussian that averages like a disc of the contact's width.
    pub(crate) fn contact_texels(&self) -> f64 {
        0.25 * self.contact_mm / self.texel_mm
    }

    /// Columns and rows of every picture.
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    /// Texels of a picture.
    pub fn texels(&self) -> usize {
        self.width * self.height
    }
}

/// The pictures of a side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DomePicture {
    /// The photograph under the dome.
    Albedo,
    /// The photograph in front of the back light: its light fell on the other side.
    Translucency,
    /// Heights in mm towards this side's camera.
    Height,
}

impl DomePicture {
    /// Every picture of a side.
    pub const ALL: [DomePicture; 3] = [DomePicture::Albedo, DomePicture::Translucency, DomePicture::Height];

    /// The first part of the file's name.
    pub fn name(self) -> &'static str {
        match self {
            DomePicture::Albedo => "albedo",
            DomePicture::Translucency => "translucency",
            DomePicture::Height => "height",
        }
    }

    /// Channels that the picture must hold.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            DomePicture::Height => &["Y"],
            _ => &["R", "G", "B"],
        }
    }

    /// `CAPTURE/front/albedo.exr`.
    pub fn path(self, folder: &Path, side: Side) -> PathBuf {
        folder.join(side.name()).join(format!("{}.exr", self.name()))
    }
}

/// `CAPTURE/white.exr`: the white sheet under the dome.
pub fn white_path(folder: &Path) -> PathBuf {
    folder.join("white.exr")
}

/// `CAPTURE/backlight_empty.exr`: the back light without the leaf.
pub fn empty_path(folder: &Path) -> PathBuf {
    folder.join("backlight_empty.exr")
}
