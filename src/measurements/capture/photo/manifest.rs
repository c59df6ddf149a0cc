//! `capture.toml` of photographs: which pictures there are, what lies in them, and what is stated because no
//! photograph shows it. Places in a picture are in pixels from its upper left corner, lengths in mm.

use crate::folder::content_hash;
use crate::kind::{self, CaptureKind};
use crate::manifest_check::ManifestCheck;
use crate::photo::{Error, Result};
use mesophyll_optics::side::Side;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A mark of the ruler is found to this many pixels, or the marks say nothing.
const MARK_PX: f64 = 50.0;

/// `capture.toml` of photographs. Unknown fields are errors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhotoManifest {
    /// Version of the format.
    pub schema: u32,
    /// `photo`.
    pub kind: String,
    /// The leaf's name.
    pub name: String,
    /// Mean thickness by caliper (mm); or `thickness_range_mm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_mm: Option<f64>,
    /// Standard error of the caliper's reading (mm); stated with `thickness_mm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_err_mm: Option<f64>,
    /// Thinnest and thickest leaf of the species (mm), where nobody measured this one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_range_mm: Option<[f64; 2]>,
    /// How numbers in PNG, TIFF and JPEG files stand for light. EXR files are linear.
    #[serde(default)]
    pub transfer: TransferCurve,
    /// Readings of this value or more are clipped, 1 being the largest number of a PNG or TIFF file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub full_scale: Option<f64>,
    /// Noise variance of a linear reading v is `noise_photon`·v + `noise_read`²; estimated on the card when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_photon: Option<f64>,
    /// Standard deviation of a reading without light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_read: Option<f64>,
    /// Wanted size of a texel of the maps (mm); when absent, two pixels or more, so that the
    /// leaf is at most 720 texels long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texel_mm: Option<f64>,
    /// The grey card.
    pub card: ReflectanceStatement,
    /// The sheet that the leaf lies on in open shade.
    pub background: ReflectanceStatement,
    /// The ruler in the front's picture.
    pub ruler: Ruler,
    /// The front in open shade.
    pub front: ShadePhotograph,
    /// The back in open shade.
    pub back: ShadePhotograph,
    /// The leaf on the light table.
    pub light_table: LightTable,
    /// What the surface mirrors; only a range is known when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gloss: Option<GlossStatement>,
}

/// How a number in a file stands for light: curves that their makers have published.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(strum::EnumIter))]
#[serde(rename_all = "kebab-case")]
pub enum TransferCurve {
    /// In proportion to light.
    #[default]
    Linear,
    /// By the curve of IEC 61966-2-1.
    Srgb,
    /// By that of ITU-R BT.709, as cameras write it.
    #[serde(rename = "rec-709")]
    Rec709,
    /// By that of Adobe RGB (1998), the power 563/256.
    AdobeRgb,
    /// By that of ROMM RGB (ISO 22028-2), called ProPhoto RGB.
    ProphotoRgb,
    /// By the power 2.2.
    #[serde(rename = "gamma-2.2")]
    Gamma22,
    /// By Sony's S-Log3.
    #[serde(rename = "s-log3")]
    SLog3,
    /// By ARRI's LogC3 at EI 800.
    #[serde(rename = "log-c3")]
    LogC3,
    /// By Panasonic's V-Log.
    #[serde(rename = "v-log")]
    VLog,
}

/// A stated reflectance and its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReflectanceStatement {
    /// Reflectance, the same in every channel.
    pub reflectance: f64,
    /// Its standard error.
    pub reflectance_err: f64,
}

/// Two marks of a ruler.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ruler {
    /// Where the two marks are in the front's picture (pixels).
    pub marks_px: [[f64; 2]; 2],
    /// The length between them (mm).
    pub length_mm: f64,
    /// Distance between neighbouring ticks along the line between the marks (mm).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tick_mm: Option<f64>,
    /// Standard error of the place of a mark (pixels).
    #[serde(default = "one_pixel")]
    pub err_px: f64,
}

fn one_pixel() -> f64 {
    1.0
}

/// One side in open shade.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShadePhotograph {
    /// The picture's file.
    pub file: String,
    /// Left, top, width and height of a rectangle that lies wholly on the card (pixels).
    pub card: [usize; 4],
}

/// The leaf on the light table, and the table alone with camera and exposure as they were.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightTable {
    /// The picture with the leaf.
    pub leaf: String,
    /// The picture with the leaf turned over, so that each side's ρt is seen; optional.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turned: Option<String>,
    /// The picture without the leaf.
    pub bare: String,
    /// The side that faces the camera.
    #[serde(default = "front")]
    pub up: Side,
    /// Share of the light from the leaf's underside that the table throws back.
    pub reflectance: f64,
    /// Its standard error.
    pub reflectance_err: f64,
}

fn front() -> Side {
    Side::Front
}

/// Gloss as it is stated: no photograph in open shade shows it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GlossStatement {
    /// Effective refractive index of front and back.
    pub index: [f64; 2],
    /// Standard error of an index.
    #[serde(default = "index_err")]
    pub index_err: f64,
    /// Slope m of front and back.
    pub slope: [f64; 2],
}

fn index_err() -> f64 {
    0.05
}

impl PhotoManifest {
    /// Reads and validates `CAPTURE/capture.toml`.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the field, what was found and what was expected.
    pub fn read(folder: &Path) -> Result<PhotoManifest> {
        let (path, manifest) = kind::read::<PhotoManifest>(folder, CaptureKind::Photo)?;
        manifest.validate(&path)?;
        Ok(manifest)
    }

    /// Mean thickness and its standard error (mm). A range counts as an even distribution.
    pub fn thickness(&self) -> [f64; 2] {
        match (self.thickness_mm, self.thickness_range_mm) {
            (Some(h), _) => [h, self.thickness_err_mm.unwrap_or(0.0)],
            (None, Some([a, b])) => [0.5 * (a + b), (b - a) / 12f64.sqrt()],
            (None, None) => [f64::NAN; 2],
        }
    }

    /// Where the thickness comes from, in words.
    pub fn thickness_source(&self) -> String {
        match (self.thickness_mm, self.thickness_range_mm) {
            (None, Some([a, b])) => format!("a range, {a} to {b} mm, taken as an even distribution"),
            _ => "a reading".into(),
        }
    }

    /// The pictures in open shade, front and back.
    pub fn in_shade(&self, folder: &Path) -> [PathBuf; 2] {
        [&self.front.file, &self.back.file].map(|f| folder.join(f))
    }

    /// The pictures' files by field.
    fn files(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let table = &self.light_table;
        let always = [
            ("front.file", self.front.file.as_str()),
            ("back.file", self.back.file.as_str()),
            ("light_table.leaf", table.leaf.as_str()),
            ("light_table.bare", table.bare.as_str()),
        ];
        always.into_iter().chain(table.turned.as_deref().map(|file| ("light_table.turned", file)))
    }

    /// Content hash of everything that a fit reads.
    ///
    /// # Errors
    /// [`Error::Input`] for a picture that cannot be read.
    pub fn hash(&self, folder: &Path) -> Result<String> {
        let names = ["capture.toml"].into_iter().chain(self.files().map(|(_, file)| file));
        content_hash(folder, &names.map(|name| folder.join(name)).collect::<Vec<_>>())
    }

    fn validate(&self, path: &Path) -> Result<()> {
        let fields = ManifestCheck { path };
        let bad =
            |field: &str, found: &dyn std::fmt::Display, expected: &str| Err(fields.wrong(field, found, expected));
        if self.schema != 1 {
            return bad("schema", &self.schema, "1");
        }
        match (self.thickness_mm, self.thickness_range_mm) {
            (Some(h), None) => fields.thickness_mm("thickness_mm", h)?,
            (None, Some([a, b])) => {
                fields.thickness_mm("thickness_range_mm", a)?;
                fields.thickness_mm("thickness_range_mm", b)?;
                if a >= b {
                    return bad("thickness_range_mm", &format!("[{a}, {b}]"), "[thinnest, thickest]");
                }
            }
            (found, _) => {
                let found = if found.is_some() { "thickness_range_mm beside it" } else { "neither it nor a range" };
                return bad("thickness_mm", &found, "either thickness_mm or thickness_range_mm");
            }
        }
        if self.thickness_mm.is_some() != self.thickness_err_mm.is_some() {
            return bad("thickness_err_mm", &"one without the other", "the standard error of thickness_mm beside it");
        }
        fields.positive_mm([("ruler.length_mm", self.ruler.length_mm)])?;
        fields.not_negative([
            ("thickness_err_mm", self.thickness_err_mm),
            ("noise_photon", self.noise_photon),
            ("noise_read", self.noise_read),
            ("ruler.err_px", Some(self.ruler.err_px)),
            ("card.reflectance_err", Some(self.card.reflectance_err)),
            ("background.reflectance_err", Some(self.background.reflectance_err)),
            ("light_table.reflectance_err", Some(self.light_table.reflectance_err)),
        ])?;
        for (field, length) in [("texel_mm", self.texel_mm), ("ruler.tick_mm", self.ruler.tick_mm)] {
            fields.positive_mm([(field, length.unwrap_or(1.0))])?;
        }
        if let Some(full) = self.full_scale
            && !(full > 0.0 && full.is_finite())
        {
            return bad("full_scale", &full, "a positive reading");
        }
        if !(0.01..=1.0).contains(&self.card.reflectance) {
            return bad("card.reflectance", &self.card.reflectance, "0.01 to 1, 0.18 for a photographer's grey card");
        }
        if !(0.0..=0.2).contains(&self.background.reflectance) {
            return bad(
                "background.reflectance",
                &self.background.reflectance,
                "0 to 0.2: a black sheet, since a brighter one shines through the leaf",
            );
        }
        if !(0.0..=0.95).contains(&self.light_table.reflectance) {
            return bad("light_table.reflectance", &self.light_table.reflectance, "0 to 0.95");
        }
        for (field, file) in self.files() {
            let inside = Path::new(file).components().all(|c| matches!(c, std::path::Component::Normal(_)));
            if file.is_empty() || !inside {
                return bad(field, &format!("{file:?}"), "a path inside the capture");
            }
        }
        let [a, b] = self.ruler.marks_px;
        if !((a[0] - b[0]).hypot(a[1] - b[1]) >= 10.0) {
            return bad("ruler.marks_px", &format!("{:?}", self.ruler.marks_px), "two marks at least 10 pixels apart");
        }
        let most = MARK_PX.min(0.1 * (a[0] - b[0]).hypot(a[1] - b[1]));
        if self.ruler.err_px > most {
            let expected = format!("at most {MARK_PX} pixels and a tenth of the distance of the marks: {most:.1}");
            return bad("ruler.err_px", &self.ruler.err_px, &expected);
        }
        if let Some(g) = self.gloss {
            if !g.index.iter().all(|n| (1.0..=2.5).contains(n)) || !(0.0..=1.0).contains(&g.index_err) {
                return bad("gloss.index", &format!("{:?} ± {}", g.index, g.index_err), "indices of 1 to 2.5");
            }
            if !g.slope.iter().all(|m| *m > 0.0 && *m <= 1.0) {
                return bad("gloss.slope", &format!("{:?}", g.slope), "[front, back], above 0 and at most 1");
            }
        }
        Ok(())
    }

    /// The refusal of a field of the manifest in `folder`.
    pub(crate) fn wrong(
        folder: &Path,
        field: &str,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> Error {
        Error::unexpected(&folder.join("capture.toml"), field, found, expected)
    }
}
