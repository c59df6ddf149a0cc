//! Leaf specifications (`data/leaves/*.toml`, format in `data/README.md`): what a synthetic leaf looks like and how it
//! is scanned. Lengths in mm, angles in degrees, coefficients in 1/mm. Unknown fields are errors.

use super::layers::FoliarSpec;
use crate::{Error, Result};
use mesophyll_base::error::TomlKind;
use mesophyll_files::whole_file;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Tube;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::str::FromStr;
use strum::{Display, EnumIter, EnumString, IntoStaticStr};

/// Which truth a leaf has.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    Display,
    EnumString,
    EnumIter,
    IntoStaticStr,
    strum::EnumMessage,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum InteriorModel {
    /// One σa, σs a leaf; thickness and γ vary (Wang et al. 2005, with full A and B).
    Exact,
    /// σa varies with the chlorophyll of each place; veins hold a tenth of it.
    Pigment,
    /// Layers with pigments instead of the slab: the table `[foliar]`. No σa and σs are right.
    Foliar,
}

/// What a synthetic leaf looks like and how it is scanned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeafSpec {
    /// Version of the format.
    pub schema: u32,
    /// The leaf's name.
    pub name: String,
    /// The plant's botanical name.
    pub species: String,
    /// Whether σa varies over the leaf.
    pub model: InteriorModel,
    /// Seed of everything that is grown by chance.
    pub seed: u64,
    /// Size of the scanned field (mm). The blade is centred in it, with its midrib along x.
    pub field_mm: [f64; 2],
    /// Mean thickness h (mm).
    pub thickness_mm: f64,
    /// The gloss lobe of both sides.
    #[serde(default)]
    pub lobe: Lobe,
    /// The blade's contour.
    pub outline: OutlineSpec,
    /// Teeth along the margin.
    #[serde(default)]
    pub margin: MarginSpec,
    /// How its veins are grown.
    pub veins: VeinSpec,
    /// Shape of both surfaces.
    pub relief: ReliefSpec,
    /// How thickness varies.
    pub variation: ThicknessVariation,
    /// Mean coefficients of the tissue; a leaf of layers needs none.
    #[serde(default)]
    pub interior: InteriorSpec,
    /// How σa varies, for the `pigment` model, and chlorophyll for the `foliar` one.
    #[serde(default)]
    pub pigment: PigmentSpec,
    /// Layers and pigments, for the `foliar` model.
    #[serde(default)]
    pub foliar: Option<FoliarSpec>,
    /// The front's surface.
    pub front: SurfaceSpec,
    /// The back's surface.
    pub back: SurfaceSpec,
    /// What it is scanned with.
    #[serde(default)]
    pub device: DeviceSpec,
}

/// The blade's contour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutlineSpec {
    /// From base to tip along the midrib.
    pub length_mm: f64,
    /// `[t, left, right]`: half widths (mm) at the fraction t of the length; t rises from 0 to 1. Left is +y.
    #[serde(default)]
    pub profile: Vec<[f64; 3]>,
    /// `[angle_deg, radius_mm]` around the petiole for round blades, angle from the tip direction, −180 to 180; instead
    /// of `profile`.
    #[serde(default)]
    pub polar: Vec<[f64; 2]>,
    /// Sideways bow of the midrib.
    #[serde(default)]
    pub bow_mm: f64,
    /// Length of the leaf's stalk; 0 for none.
    #[serde(default)]
    pub petiole_mm: f64,
    /// Width of the stalk.
    #[serde(default)]
    pub petiole_width_mm: f64,
}

/// Teeth along the margin; none by default.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarginSpec {
    /// Distance between teeth; 0 is an entire margin.
    #[serde(default)]
    pub tooth_mm: f64,
    /// How deep the teeth are cut.
    #[serde(default)]
    pub depth_mm: f64,
    /// Smaller teeth on each tooth.
    #[serde(default)]
    pub second: f64,
    /// How deep the smaller teeth are cut.
    #[serde(default)]
    pub second_depth_mm: f64,
    /// 0 blunt and symmetric (crenate), 1 pointing towards the tip (serrate).
    #[serde(default)]
    pub lean: f64,
}

/// How primary and secondary veins run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Venation {
    /// Secondaries leave the midrib and run to the margin.
    Pinnate,
    /// Several primaries leave the petiole's end.
    Palmate,
    /// Primaries run side by side from base to tip.
    Parallel,
}

/// How the network of veins is grown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VeinSpec {
    /// How primary and secondary veins run.
    pub kind: Venation,
    /// Secondaries on each side of the midrib; primaries on each side for `parallel`; primaries in all for `palmate`.
    pub count: usize,
    /// Angle between a secondary and the vein that it leaves.
    pub angle_deg: f64,
    /// How much secondaries turn towards the tip: 0 runs straight to the margin, 1 ends along the margin.
    pub arch: f64,
    /// Irregularity of spacing and angle, 0 to 1.
    #[serde(default)]
    pub jitter: f64,
    /// Widths where a vein starts: primary, secondary, tertiary.
    pub width_mm: [f64; 3],
    /// Distance between the tertiaries that are grown; 0 grows none.
    pub tertiary_mm: f64,
    /// Size of the finest meshes; 0 for none.
    #[serde(default)]
    pub areole_mm: f64,
}

/// Shape of both surfaces (mm): veins sunk into the front and raised on the back, lamina arched between the veins.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReliefSpec {
    /// Depth of primary, secondary and tertiary veins below the front.
    pub sunk_mm: [f64; 3],
    /// Height of the same veins above the back.
    pub raised_mm: [f64; 3],
    /// How far the lamina bulges between secondaries, and between tertiaries.
    pub bulge_mm: [f64; 2],
    /// Distance from the vein over which the lamina rises.
    pub bulge_width_mm: [f64; 2],
    /// Slope of the blade's halves up from the midrib.
    #[serde(default)]
    pub fold_deg: f64,
    /// How far tip and base hang below the middle.
    #[serde(default)]
    pub droop_mm: f64,
    /// Height of slow waves of the blade.
    #[serde(default)]
    pub wave_mm: f64,
    /// Length of those waves.
    #[serde(default = "wave_length")]
    pub wave_length_mm: f64,
}

fn wave_length() -> f64 {
    22.0
}

/// How thickness varies, relative to h.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThicknessVariation {
    /// Extra thickness of primary, secondary and tertiary veins.
    pub veins: [f64; 3],
    /// Standard deviation of slow and of fine variation of the lamina.
    pub lamina: [f64; 2],
}

/// Coefficients a channel (1/mm); all 0 where none are stated.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InteriorSpec {
    /// Absorption coefficient σa.
    pub sigma_a: [f64; 3],
    /// Scattering coefficient σs.
    pub sigma_s: [f64; 3],
}

/// Chlorophyll of the `pigment` model, relative to the leaf's σa.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PigmentSpec {
    /// Chlorophyll left in veins.
    pub veins: f64,
    /// Standard deviation over the lamina.
    pub lamina: f64,
    /// Share of chlorophyll lost halfway between secondaries, as a leaf that yellows does; may be negative.
    pub between: f64,
}

impl Default for PigmentSpec {
    fn default() -> Self {
        PigmentSpec { veins: 0.1, lamina: 0.12, between: 0.1 }
    }
}

/// One side's surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceSpec {
    /// Mean gloss reflectance ρs.
    pub rho_s: f64,
    /// Mean slope m of the gloss.
    pub m: f64,
    /// Relative change of ρs and m on veins.
    #[serde(default)]
    pub gloss_veins: [f64; 2],
    /// Relative standard deviation of ρs and m over the lamina.
    #[serde(default)]
    pub gloss_lamina: [f64; 2],
    /// Relative change of γ on veins, a channel.
    pub gamma_veins: [f64; 3],
    /// Relative standard deviation of γ over the lamina.
    pub gamma_lamina: f64,
}

/// The device; the defaults are a device of Gardner et al.'s kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceSpec {
    /// Angle of the view direction (sin, 0, cos) from the vertical.
    pub camera_deg: f64,
    /// Angle from which the light box is photographed.
    pub lightbox_camera_deg: f64,
    /// The linear light source.
    pub tube: Tube,
    /// Tube positions of the first and last frame.
    pub travel_x_mm: [f64; 2],
    /// The same for pass y.
    pub travel_y_mm: [f64; 2],
    /// Sensitivity a channel.
    pub gain: [f64; 3],
    /// Relative loss of light towards the corners of the field.
    pub vignette: f64,
    /// Value of a frame taken in the dark.
    pub dark: f64,
    /// Value at which the shortest of the three exposures saturates; each longer one saturates eight times earlier.
    pub full_scale: f64,
    /// Noise without light, standard deviation.
    pub noise_floor: f64,
}

impl Default for DeviceSpec {
    fn default() -> Self {
        DeviceSpec {
            camera_deg: 55.0,
            lightbox_camera_deg: 0.0,
            tube: Tube { height_mm: 100.0, length_mm: 500.0, radius_mm: 2.5 },
            travel_x_mm: [-400.0, 250.0],
            travel_y_mm: [-325.0, 325.0],
            gain: [0.94, 1.0, 1.05],
            vignette: 0.05,
            dark: 0.002,
            full_scale: 128.0,
            noise_floor: 5e-4,
        }
    }
}

/// Reads the text of a specification without checking its values.
impl FromStr for LeafSpec {
    type Err = toml::de::Error;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        toml::from_str(text)
    }
}

impl LeafSpec {
    /// Reads and validates a specification.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the field, what was found and what was expected.
    pub fn read(path: &Path) -> Result<LeafSpec> {
        let text = whole_file::text(path)?;
        let mut spec: LeafSpec = text.parse().map_err(|e| Error::toml_of(TomlKind::SyntheticLeaf, path, &text, &e))?;
        spec.validate(path)?;
        if let Some(foliar) = &mut spec.foliar {
            foliar.read(path)?;
        }
        spec.truth(path, None)?;
        Ok(spec)
    }

    /// The model that is asked for; otherwise the specification's own.
    ///
    /// # Errors
    /// [`Error::Input`] where the specification at `path` does not state what that model needs.
    pub fn truth(&self, path: &Path, asked: Option<InteriorModel>) -> Result<InteriorModel> {
        let model = asked.unwrap_or(self.model);
        let (field, found, stated) = match model {
            InteriorModel::Foliar => ("foliar", "no such table", self.foliar.is_some()),
            InteriorModel::Exact | InteriorModel::Pigment => {
                ("interior", "no such table, or only zeros in it", self.interior != InteriorSpec::default())
            }
        };
        if !stated {
            return Err(Error::unexpected(path, field, found, format!("one, for the model {model}")));
        }
        Ok(model)
    }
}
