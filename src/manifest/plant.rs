//! Where leaves stand and what they hang on: single leaves, whole plants, branches in the wind, a twig, a crown.

use super::one;
use mesophyll_files::mesh::Unit;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A leaf at a place: it is scaled, turned about x, then y, then z, and then moved.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// Name of the leaf.
    pub leaf: String,
    /// Place of the leaf's origin.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Angles about x, then y, then z.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
    /// A factor on the leaf's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// A file with a list of places. Each line has x y z, which are added to `position_mm`.
    pub positions: Option<PathBuf>,
    /// Unit of that list; metres when absent.
    pub unit: Option<Unit>,
    /// The branch on which the leaf hangs. Position and rotation are then in that branch's frame at `at`.
    pub branch: Option<String>,
    /// Place on the branch, from 0 (root) to 1 (tip).
    pub at: Option<f64>,
    /// Distance from the branch's axis to the leaf's origin, along the x axis of the turned leaf.
    pub offset_mm: Option<f64>,
}

/// A tapered branch, which bends under its weight and in the wind.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Branch {
    /// The name by which instances refer to it.
    pub name: String,
    /// Length of its axis.
    pub length_mm: f64,
    /// Radius at the root.
    pub radius_mm: f64,
    /// Tip radius over root radius; 1 when neither this nor a fit is given.
    pub taper: Option<f64>,
    /// F/(E′r₁⁴) under its own weight if it were horizontal, as `fit beam --deflections` defines it.
    pub load_over_stiffness_mm: Option<f64>,
    /// A folder of `fit beam --deflections -o`, which gives taper and load.
    pub fit: Option<PathBuf>,
    /// The name of the measured branch in that folder, where it differs from this one.
    pub measured: Option<String>,
    /// Place of its root.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Direction from root to tip, of any length.
    pub direction: [f64; 3],
    /// Diffuse reflectance of the bark.
    pub bark: [f64; 3],
    /// Deflection of the tip over the length, for each m/s of a steady wind across the branch.
    #[serde(default)]
    pub lean_per_m_s: f64,
    /// Resonance frequency; it follows from the length when absent.
    pub resonance_hz: Option<f64>,
    /// Damping relative to critical damping.
    #[serde(default = "damping")]
    pub damping: f64,
}

/// What is drawn for a material of a plant.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Matter {
    /// A leaf of the scene, by its name.
    Leaf(String),
    /// Bark with this diffuse reflectance.
    Bark([f64; 3]),
}

/// A whole plant, from a glTF file or grown from a description. It sways where the scene has a wind.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plant {
    /// Name of the plant in printed text; the file's name when absent.
    pub name: Option<String>,
    /// A glTF file. Either this or `grow` is given.
    pub file: Option<PathBuf>,
    /// A description for `mesophyll grow`. The plant is made in the run's own folder.
    pub grow: Option<PathBuf>,
    /// Seed for `grow`; that of the description when absent.
    pub grow_seed: Option<u64>,
    /// What is drawn for each material, by the plant's name of the material.
    pub materials: BTreeMap<String, Matter>,
    /// Place of the foot.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Angles about x, then y, then z.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
    /// A factor on the plant's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// Number of plants in the area.
    #[serde(default = "single")]
    pub count: usize,
    /// Size of the area along x and y, around the position.
    pub area_mm: Option<[f64; 2]>,
    /// Seed of the places in the area.
    #[serde(default)]
    pub seed: u64,
    /// Force of the wind (N) for each m/s and for each m² across the wind. All of the wood and half of the leaves
    /// count. With 0 the plant stands still in any wind.
    #[serde(default = "one")]
    pub drag_n_s_m3: f64,
    /// Damping of its branches relative to critical damping.
    #[serde(default = "damping")]
    pub damping: f64,
    /// Density of fresh wood.
    #[serde(default = "wood")]
    pub wood_kg_m3: f64,
    /// Mass of a blade for each unit of its area.
    #[serde(default = "blade")]
    pub leaf_kg_m2: f64,
    /// How its leaves flutter. When absent, they keep still on their branches. It is refused where no wind moves the
    /// branches.
    pub flutter: Option<Flutter>,
}

/// The highest resonance (Hz) of leaves that flutter. Above it, the renderer's textures would repeat within ten
/// minutes.
pub const MOST_LEAF_RESONANCE: f64 = 6.4;

/// Leaves that turn back and forth about their axes in gusts.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Flutter {
    /// Angle by which a slow change of the wind's speed by 1 m/s turns a leaf.
    pub deg_per_m_s: f64,
    /// Resonance frequency of a leaf, up to [`MOST_LEAF_RESONANCE`].
    #[serde(default = "leaf_resonance")]
    pub resonance_hz: f64,
    /// Damping relative to critical damping.
    #[serde(default = "leaf_damping")]
    pub damping: f64,
}

/// A mean wind and its gusts.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wind {
    /// Mean speed at the place of the scene.
    pub speed_m_s: f64,
    /// Direction that it blows to, from +x towards +y.
    #[serde(default)]
    pub azimuth_deg: f64,
    /// Standard deviation of the speed over its mean.
    #[serde(default = "turbulence")]
    pub turbulence: f64,
    /// Seed of the gusts.
    pub seed: u64,
    /// Time at which the scene is seen, where a view does not state it.
    #[serde(default)]
    pub time_s: f64,
}

/// The period of a scene whose light comes as if it repeated along x and y around the origin.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Periodic {
    /// Lengths of the period along x and y.
    pub size_mm: [f64; 2],
}

/// A level, matte square of ground in the middle of the world. It reflects light and hides what is behind it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// Diffuse reflectance.
    pub albedo: [f64; 3],
    /// Half of its width; in a periodic scene the ground covers the period.
    pub reach_mm: Option<f64>,
    /// Height of the ground on z.
    #[serde(default)]
    pub height_mm: f64,
    /// Size of its clods, old leaves and stones (mm), which the path tracer draws. The ground is even where this is
    /// absent.
    pub grain_mm: Option<f64>,
    /// Standard deviation of the logarithm of the reflectance, where there is a grain; .4 when absent.
    pub contrast: Option<f64>,
}

/// Number of grains along a side of the square after which the ground's pattern repeats.
pub const GRAINS_A_TILE: f64 = 64.0;

impl Ground {
    /// Standard deviation of the logarithm of the reflectance from grain to grain.
    pub fn contrast(&self) -> f64 {
        self.contrast.unwrap_or(0.4)
    }
}

/// Leaves on a twig along z, each a golden angle from the one before.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cluster {
    /// Names of leaves, which are taken in turn.
    pub leaves: Vec<String>,
    /// Number of leaves.
    pub count: usize,
    /// Length of the twig.
    pub length_mm: f64,
    /// Distance from the twig to a blade's centre.
    pub offset_mm: f64,
    /// Mean angle of a blade below the horizontal.
    #[serde(default)]
    pub droop_deg: f64,
    /// Standard deviation of that angle between blades.
    #[serde(default)]
    pub spread_deg: f64,
    /// A factor on a leaf's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// The seed. The same seed gives the same cluster.
    pub seed: u64,
}

/// A crown of leaves on rigid wood that is made from a seed. The trunk's foot is the origin.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tree {
    /// Names of leaves, which are taken in turn.
    pub leaves: Vec<String>,
    /// Number of leaves.
    pub count: usize,
    /// Height from the foot to the top.
    pub height_mm: f64,
    /// Radius of the crown.
    pub crown_mm: f64,
    /// Distance from the twig to a blade's centre.
    pub offset_mm: f64,
    /// Mean angle of a blade below the horizontal.
    #[serde(default)]
    pub droop_deg: f64,
    /// Standard deviation of that angle between blades.
    #[serde(default)]
    pub spread_deg: f64,
    /// A factor on a leaf's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// Diffuse reflectance of the bark.
    pub bark: [f64; 3],
    /// The seed. The same seed gives the same tree.
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
