//! `capture.toml`: what was scanned and how. Lengths in mm, angles in degrees where the name says so.

use crate::kind::{self, CaptureKind};
use crate::manifest_check::ManifestCheck;
use crate::{Error, Result};
use mesophyll_base::image::ImageSize;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::{Travel, Tube};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// `capture.toml` as written by the owner of a device (format: `data/README.md`). Unknown fields are errors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TubeManifest {
    /// Version of the format.
    pub schema: u32,
    /// The leaf's name.
    pub name: String,
    /// Columns of every frame.
    pub width: usize,
    /// Rows of every frame.
    pub height: usize,
    /// Size of a texel on the blade (mm).
    pub texel_mm: f64,
    /// Mean thickness h by caliper (mm).
    pub thickness_mm: f64,
    /// Standard error of the caliper's reading (mm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_err_mm: Option<f64>,
    /// Angle of the view direction (sin, 0, cos) from the vertical, in every pass.
    pub camera_deg: f64,
    /// Noise: the standard deviation is √((relative·value)² + floor²); estimated when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_relative: Option<f64>,
    /// The part of the noise that does not grow with the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_floor: Option<f64>,
    /// Reflectance of the white sheet; 1 when absent. A calibrated value of 1 is a perfectly white texel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white_reflectance: Option<f64>,
    /// `front`, or `front` and `back`.
    pub sides: Vec<Side>,
    /// The linear light source.
    pub tube: Tube,
    /// How the light box was photographed.
    #[serde(default)]
    pub lightbox: LightBox,
    /// What the device can do, for designs of further scans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<DeviceLimits>,
    /// The passes of the tube over the leaf: `x`, or `x` and `y`.
    #[serde(rename = "pass")]
    pub passes: Vec<TubePass>,
}

/// Where the tube can stand. A design of a further scan proposes nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceLimits {
    /// Least and largest position in pass x (mm); those of the pass when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x_mm: Option<[f64; 2]>,
    /// The same in pass y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y_mm: Option<[f64; 2]>,
    /// Positions are whole multiples of this (mm); any position when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step_mm: Option<f64>,
}

impl DeviceLimits {
    /// Least and largest position in a pass (mm), where they are stated.
    pub fn of(&self, pass: Travel) -> Option<[f64; 2]> {
        match pass {
            Travel::X => self.x_mm,
            Travel::Y => self.y_mm,
        }
    }
}

/// How the light box was photographed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightBox {
    /// Camera angle of the light-box photographs.
    #[serde(default)]
    pub camera_deg: f64,
}

/// One pass of the tube: from where to where in how many frames, or the place of every frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TubePass {
    /// The direction of travel.
    pub name: Travel,
    /// Position of the first frame along the travel (mm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_mm: Option<f64>,
    /// Position of the last frame along the travel (mm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_mm: Option<f64>,
    /// How many frames there are, evenly from `start_mm` to `end_mm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<usize>,
    /// Position of every frame along the travel (mm), in place of the other three.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub positions_mm: Option<Vec<f64>>,
}

impl TubePass {
    /// Tube position of every frame along the direction of travel (mm), both ends included.
    pub fn positions(&self) -> Vec<f64> {
        if let Some(list) = &self.positions_mm {
            return list.clone();
        }
        let (a, b, n) = (self.start_mm.unwrap_or(0.0), self.end_mm.unwrap_or(0.0), self.frames.unwrap_or(0));
        if n == 1 {
            return vec![a];
        }
        (0..n).map(|k| a + (b - a) * k as f64 / (n - 1) as f64).collect()
    }
}

impl TubeManifest {
    /// Reads and validates `CAPTURE/capture.toml`.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the field, what was found and what was expected.
    pub fn read(folder: &Path) -> Result<TubeManifest> {
        let (path, manifest) = kind::read::<TubeManifest>(folder, CaptureKind::Tube)?;
        manifest.validate(&path)?;
        Ok(manifest)
    }

    fn validate(&self, path: &Path) -> Result<()> {
        let fields = ManifestCheck { path };
        let bad =
            |field: &str, found: &dyn std::fmt::Display, expected: &str| Err(fields.wrong(field, found, expected));
        fields.photographs(self.schema, self.width, self.height, 1..=65_536)?;
        fields.positive_mm([
            ("texel_mm", self.texel_mm),
            ("tube.height_mm", self.tube.height_mm),
            ("tube.length_mm", self.tube.length_mm),
        ])?;
        fields.thickness_mm("thickness_mm", self.thickness_mm)?;
        fields.not_negative([
            ("tube.radius_mm", Some(self.tube.radius_mm)),
            ("thickness_err_mm", self.thickness_err_mm),
            ("noise_relative", self.noise_relative),
            ("noise_floor", self.noise_floor),
        ])?;
        if let Some(white) = self.white_reflectance
            && !(0.01..=1.0).contains(&white)
        {
            return bad("white_reflectance", &white, "0.01 to 1, a share of the light (99 % is 0.99)");
        }
        if self.tube.radius_mm >= self.tube.height_mm {
            return bad("tube.radius_mm", &self.tube.radius_mm, "less than tube.height_mm");
        }
        for (field, value) in [("camera_deg", self.camera_deg), ("lightbox.camera_deg", self.lightbox.camera_deg)] {
            if !(-85.0..=85.0).contains(&value) {
                return bad(field, &value, "-85 to 85 degrees");
            }
        }
        if self.sides.first() != Some(&Side::Front) || self.sides.len() > 2 || self.sides[1..].contains(&Side::Front) {
            return bad(
                "sides",
                &format!("{:?}", self.sides.iter().map(|s| s.name()).collect::<Vec<_>>()),
                "[\"front\"] or [\"front\", \"back\"]",
            );
        }
        if let Some(limits) = self.limits {
            for travel in [Travel::X, Travel::Y] {
                if let Some([a, b]) = limits.of(travel)
                    && !(a < b && a.abs() <= 1e7 && b.abs() <= 1e7)
                {
                    let field = format!("limits.{}_mm", travel.name());
                    return bad(&field, &format!("{a} … {b}"), "the least and the largest position (mm), at most 1e7");
                }
            }
            fields.positive_mm(limits.step_mm.map(|step| ("limits.step_mm", step)))?;
        }
        for travel in [Travel::X, Travel::Y] {
            let count = self.passes.iter().filter(|p| p.name == travel).count();
            if count > 1 || (count == 0 && travel == Travel::X) {
                return bad(
                    "pass",
                    &format!("{count} passes named \"{}\"", travel.name()),
                    "one \"x\" and at most one \"y\"",
                );
            }
        }
        for pass in &self.passes {
            let field = |f: &str| format!("pass \"{}\": {f}", pass.name.name());
            let ramp = [pass.start_mm.is_some(), pass.end_mm.is_some(), pass.frames.is_some()];
            if pass.positions_mm.is_some() == ramp.contains(&true)
                || (pass.positions_mm.is_none() && ramp.contains(&false))
            {
                return Err(Error::field(
                    path,
                    &field("positions"),
                    "expected either positions_mm or all of start_mm, end_mm and frames",
                ));
            }
            // A number that is much too large would ask for all the memory there is.
            let count = pass.positions_mm.as_ref().map_or(pass.frames.unwrap_or(0), Vec::len);
            if !(8..=10_000).contains(&count) {
                return bad(&field("frames"), &count, "8 to 10000 frames");
            }
            let positions = pass.positions();
            let (up, down) = positions.windows(2).fold((true, true), |(u, d), w| (u && w[1] > w[0], d && w[1] < w[0]));
            if !(up || down) || positions.iter().any(|p| !(p.abs() <= 1e7)) {
                return bad(
                    &field("positions"),
                    &format!("{:?} … {:?}", positions[0], positions[positions.len() - 1]),
                    "positions that move one way, at most 1e7 mm from the middle",
                );
            }
        }
        Ok(())
    }

    /// The pass in this direction, where there is one.
    pub fn pass(&self, travel: Travel) -> Option<&TubePass> {
        self.passes.iter().find(|p| p.name == travel)
    }

    /// Columns and rows of every frame.
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    /// Centre of a texel (column, row) on the blade (mm): x to the right, y up, origin at the image centre.
    pub fn texel_position(&self, [column, row]: [u32; 2]) -> [f64; 2] {
        self.size().place_mm(self.texel_mm, row as usize * self.width + column as usize)
    }
}

/// `CAPTURE/front/x/0007.exr`.
pub fn frame_path(folder: &Path, side: Side, travel: Travel, frame: usize) -> PathBuf {
    folder.join(side.name()).join(travel.name()).join(format!("{frame:04}.exr"))
}

/// `CAPTURE/mirror/x/0007.exr`.
pub fn mirror_path(folder: &Path, travel: Travel, frame: usize) -> PathBuf {
    folder.join("mirror").join(travel.name()).join(format!("{frame:04}.exr"))
}

/// `CAPTURE/white/x/0007.exr`.
pub fn white_path(folder: &Path, travel: Travel, frame: usize) -> PathBuf {
    folder.join("white").join(travel.name()).join(format!("{frame:04}.exr"))
}
