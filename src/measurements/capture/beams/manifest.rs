//! `capture.toml` of photographs under beams. Lengths in mm, angles in degrees; unknown fields are errors.

use crate::Result;
use crate::kind::{self, CaptureKind};
use crate::manifest_check::ManifestCheck;
use mesophyll_optics::side::Side;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What was photographed, and how (format: `data/README.md`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeamsManifest {
    /// Version of the format.
    pub schema: u32,
    /// `beams`.
    pub kind: String,
    /// The leaf's name.
    pub name: String,
    /// Columns of every photograph.
    pub width: usize,
    /// Rows of every photograph.
    pub height: usize,
    /// Size of a texel on the blade (mm).
    pub texel_mm: f64,
    /// Noise sd of a reading = √((relative·value)² + floor²); estimated when both are absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_relative: Option<f64>,
    /// The part of the noise that does not grow with the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_floor: Option<f64>,
    /// The photographs, each with its light.
    #[serde(rename = "beam")]
    pub beams: Vec<BeamPhotograph>,
}

/// One photograph and its light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeamPhotograph {
    /// Photograph of the unlit side, R G B, relative to the folder.
    pub file: String,
    /// The side that the light falls on.
    pub lit: Side,
    /// Elevation of the light over the blade's plane; 90 is along the normal.
    pub elevation_deg: f64,
    /// Direction that the light comes from in the lit side's image, counted from right to up.
    pub azimuth_deg: f64,
}

impl BeamPhotograph {
    /// Unit vector towards the light in the lit side's image frame: x right, y up, z out of the lit side.
    pub fn direction(&self) -> [f64; 3] {
        let ((se, ce), (sa, ca)) = (self.elevation_deg.to_radians().sin_cos(), self.azimuth_deg.to_radians().sin_cos());
        [ce * ca, ce * sa, se]
    }
}

impl BeamsManifest {
    /// Reads and validates `CAPTURE/capture.toml`.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the field, what was found and what was expected; also for a capture of another
    /// kind.
    pub fn read(folder: &Path) -> Result<BeamsManifest> {
        let (path, manifest) = kind::read::<BeamsManifest>(folder, CaptureKind::Beams)?;
        manifest.validate(&path)?;
        Ok(manifest)
    }

    fn validate(&self, path: &Path) -> Result<()> {
        let fields = ManifestCheck { path };
        let bad =
            |field: &str, found: &dyn std::fmt::Display, expected: &str| Err(fields.wrong(field, found, expected));
        fields.photographs(self.schema, self.width, self.height, 3..=16_384)?;
        fields.positive_mm([("texel_mm", self.texel_mm)])?;
        fields.not_negative([("noise_relative", self.noise_relative), ("noise_floor", self.noise_floor)])?;
        if self.beams.is_empty() || self.beams.len() > 1000 {
            return bad("beam", &format!("{} photographs", self.beams.len()), "1 to 1000");
        }
        for (k, beam) in self.beams.iter().enumerate() {
            let field = |name: &str| format!("beam {}: {name}", k + 1);
            if beam.file.is_empty()
                || Path::new(&beam.file).components().any(|c| !matches!(c, std::path::Component::Normal(_)))
            {
                return bad(&field("file"), &format!("{:?}", beam.file), "a path inside the capture");
            }
            if !(beam.elevation_deg > 0.0 && beam.elevation_deg <= 90.0) {
                return bad(
                    &field("elevation_deg"),
                    &beam.elevation_deg,
                    "above 0 (the blade's plane) to 90 (along its normal)",
                );
            }
            if !(-360.0..=360.0).contains(&beam.azimuth_deg) {
                return bad(&field("azimuth_deg"), &beam.azimuth_deg, "-360 to 360");
            }
        }
        Ok(())
    }

    /// Number of texels in a photograph.
    pub fn texels(&self) -> usize {
        self.width * self.height
    }
}
