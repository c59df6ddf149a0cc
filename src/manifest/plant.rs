//! Where leaves stand and what they hang on: single ones, whole plants, branches in the wind, a twig, a crown.

use super::one;
use mesophyll_files::mesh::Unit;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A leaf standing somewhere: scaled, turned about x, then y, then z, then moved.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// By the leaf's name.
    pub leaf: String,
    /// Of the leaf's origin.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// About x, then y, then z.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
    /// A factor on the leaf's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// A list of places, a line each: x y z, each added to `position_mm`.
    pub positions: Option<PathBuf>,
    /// Of that list; metres when absent.
    pub unit: Option<Unit>,
    /// The branch that it hangs on; position and rotation are then in that branch's frame at `at`.
    pub branch: Option<String>,
    /// 0 (root) to 1 (tip).
    pub at: Option<f64>,
    /// From the branch's axis to the leaf's origin, along the turned leaf's x.
    pub offset_mm: Option<f64>,
}

/// A tapered branch that bends under its weight and in the wind.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Branch {
    /// What instances call it.
    pub name: String,
    /// Of its axis.
    pub length_mm: f64,
    /// At the root.
    pub radius_mm: f64,
    /// Tip radius over root radius; 1 when neither this nor a fit is given.
    pub taper: Option<f64>,
    /// F/(E′r₁⁴) of its own weight, were it horizontal: what `fit beam --deflections` calls so.
    pub load_over_stiffness_mm: Option<f64>,
    /// A folder of `fit beam --deflections -o`, for taper and load.
    pub fit: Option<PathBuf>,
    /// The measured branch's name there, where it is another.
    pub measured: Option<String>,
    /// Of its root.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// From root to tip; any length.
    pub direction: [f64; 3],
    /// Diffuse reflectance.
    pub bark: [f64; 3],
    /// Tip deflection over length per m/s of a steady wind across it.
    #[serde(default)]
    pub lean_per_m_s: f64,
    /// Its own frequency; from its length when absent.
    pub resonance_hz: Option<f64>,
    /// Over the critical one.
    #[serde(default = "damping")]
    pub damping: f64,
}

/// What a material of a plant is in the scene.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Matter {
    /// A leaf of the scene, by name.
    Leaf(String),
    /// Bark: diffuse reflectance.
    Bark([f64; 3]),
}

/// A whole plant, from a glTF file or grown from a description; it sways where the scene has a wind.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plant {
    /// In what is printed; the file's name when absent.
    pub name: Option<String>,
    /// A glTF file; this or `grow`.
    pub file: Option<PathBuf>,
    /// A description for `mesophyll grow`; the plant is made in the run's own folder.
    pub grow: Option<PathBuf>,
    /// For `grow`; the description's own when absent.
    pub grow_seed: Option<u64>,
    /// By the plant's names of them.
    pub materials: BTreeMap<String, Matter>,
    /// Of the foot.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// About x, then y, then z.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
    /// A factor on the plant's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// How many stand in the area.
    #[serde(default = "single")]
    pub count: usize,
    /// Along x and y, around the position.
    pub area_mm: Option<[f64; 2]>,
    /// Of the places in the area.
    #[serde(default)]
    pub seed: u64,
    /// Force of the wind (N) per m/s and m² that stands across it: all of the wood and half of the leaves. 0 stands
    /// still in any wind.
    #[serde(default = "one")]
    pub drag_n_s_m3: f64,
    /// Of its branches, over the critical one.
    #[serde(default = "damping")]
    pub damping: f64,
    /// Density of fresh wood.
    #[serde(default = "wood")]
    pub wood_kg_m3: f64,
    /// Mass of a blade per area.
    #[serde(default = "blade")]
    pub leaf_kg_m2: f64,
    /// How its leaves flutter; they keep still on their branches when absent. Refused where no wind moves the branches.
    pub flutter: Option<Flutter>,
}

/// The highest resonance (Hz) of leaves that flutter: above, the renderer's textures would repeat within ten minutes.
pub const MOST_LEAF_RESONANCE: f64 = 6.4;

/// Leaves that turn to and fro about their axes in gusts.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Flutter {
    /// Angle that a slow change of the wind's speed by 1 m/s turns a leaf by.
    pub deg_per_m_s: f64,
    /// A leaf's own frequency, up to [`MOST_LEAF_RESONANCE`].
    #[serde(default = "leaf_resonance")]
    pub resonance_hz: f64,
    /// Over the critical one.
    #[serde(default = "leaf_damping")]
    pub damping: f64,
}

/// A mean wind and its gusts.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wind {
    /// Mean speed where the scene stands.
    pub speed_m_s: f64,
    /// Where it blows to, from +x towards +y.
    #[serde(default)]
    pub azimuth_deg: f64,
    /// Standard deviation of the speed over its mean.
    #[serde(default = "turbulence")]
    pub turbulence: f64,
    /// Of the gusts.
    pub seed: u64,
    /// When the scene is seen, where a view does not say.
    #[serde(default)]
    pub time_s: f64,
}

/// A scene that repeats along x and y around the origin, as far as light goes.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Periodic {
    /// Along x and y.
    pub size_mm: [f64; 2],
}

/// A level, matte square of ground in the middle of the world; it reflects and hides.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// Diffuse reflectance.
    pub albedo: [f64; 3],
    /// Half its width; in a periodic scene it covers the period.
    pub reach_mm: Option<f64>,
    /// Where it lies on z.
    #[serde(default)]
    pub height_mm: f64,
    /// Size of its clods, old leaves and stones (mm), which the path tracer draws; even where it is absent.
    pub grain_mm: Option<f64>,
    /// Standard deviation of the reflectance's logarithm, where there is a grain; .4 where it is absent.
    pub contrast: Option<f64>,
}

/// Grains along a side of the square after which a ground's pattern repeats.
pub const GRAINS_A_TILE: f64 = 64.0;

impl Ground {
    /// Standard deviation of the logarithm of a grain's reflectance.
    pub fn contrast(&self) -> f64 {
        self.contrast.unwrap_or(0.4)
    }
}

/// Leaves on a twig along z, a golden angle apart; the same seed gives the same cluster.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cluster {
    /// Leaves by name, taken in turn.
    pub leaves: Vec<String>,
    /// How many leaves.
    pub count: usize,
    /// Length of the twig.
    pub length_mm: f64,
    /// From the twig to a blade's centre.
    pub offset_mm: f64,
    /// Mean angle of a blade below the horizontal, and how far single ones stray from it.
    #[serde(default)]
    pub droop_deg: f64,
    /// Standard deviation of that angle between blades.
    #[serde(default)]
    pub spread_deg: f64,
    /// A factor on a leaf's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// The same seed gives the same cluster.
    pub seed: u64,
}

/// A crown of leaves on seeded, rigid wood; the trunk's foot is the origin.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tree {
    /// Leaves by name, taken in turn.
    pub leaves: Vec<String>,
    /// How many leaves.
    pub count: usize,
    /// From foot to top.
    pub height_mm: f64,
    /// Radius of the crown.
    pub crown_mm: f64,
    /// From the twig to a blade's centre.
    pub offset_mm: f64,
    /// Mean angle of a blade below the horizontal.
    #[serde(default)]
    pub droop_deg: f64,
    /// How far single blades stray.
    #[serde(default)]
    pub spread_deg: f64,
    /// A factor on a leaf's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// Diffuse reflectance.
    pub bark: [f64; 3],
    /// The same seed gives the same tree.
    pub seed: u64,
}

fn damping() -> f64 {
    0.15
}

fn leaf_resonance() -> f64 {
    4.0
}

fn leaf_damping() -> f64 {
    0.3
}

fn single() -> usize {
    1
}

fn wood() -> f64 {
    900.0
}

fn blade() -> f64 {
    0.2
}

fn turbulence() -> f64 {
    0.3
}
