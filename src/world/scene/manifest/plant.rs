//! Where leaves stand and what moves them: single leaves, whole plants, their branches, and the wind.

use super::one;
use super::spectrum::{StatedSpectrum, unstated};
use glam::DVec3;
use mesophyll_files::unit::LengthUnit;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A leaf at a place: it is scaled, turned about x, then y, then z, and then moved.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneInstance {
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
    pub unit: Option<LengthUnit>,
    /// Of an instance that a list of places makes: the number of its table.
    #[serde(skip)]
    pub list: Option<usize>,
}

/// What a scene states about a branch of a plant, or about all branches of a level, instead of the plant's file.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BranchOverride {
    /// Name of the branch. Either this or `level` is given.
    pub name: Option<String>,
    /// Level of the branches; 0 is a trunk.
    pub level: Option<usize>,
    /// Tip radius over root radius.
    pub taper: Option<f64>,
    /// F/(E′r₁⁴) under its own weight if it were horizontal, as `fit beam --deflections` defines it. The plant's file
    /// then has the branch without this load, and the scene bends it.
    pub load_over_stiffness_mm: Option<f64>,
    /// A folder of `fit beam --deflections -o`, which gives taper and load.
    pub fit: Option<PathBuf>,
    /// The name of the measured branch in that folder, where it differs from `name`.
    pub measured: Option<String>,
    /// Deflection of the tip over the length, for each m/s of a steady wind across the branch. When absent, it follows
    /// from the plant's drag and mass.
    pub lean_per_m_s: Option<f64>,
    /// Resonance frequency; it follows from the length when absent.
    pub resonance_hz: Option<f64>,
    /// Damping relative to critical damping; that of the plant when absent.
    pub damping: Option<f64>,
}

/// What is drawn for a material of a plant.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum SceneMaterial {
    /// A leaf of the scene, by its name.
    Leaf(String),
    /// Bark with this diffuse reflectance.
    Bark([f64; 3]),
}

/// A whole plant, from a glTF file or grown from a description. It sways where the scene has a wind.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedPlant {
    /// Name of the plant in printed text; the file's name when absent.
    pub name: Option<String>,
    /// A glTF file. Either this or `grow` is given.
    pub file: Option<PathBuf>,
    /// A description for `mesophyll grow`. The plant is made in the run's own folder.
    pub grow: Option<PathBuf>,
    /// Seed for `grow`; that of the description when absent.
    pub grow_seed: Option<u64>,
    /// What is drawn for each material, by the plant's name of the material.
    pub materials: BTreeMap<String, SceneMaterial>,
    /// Place of the foot.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Angles about x, then y, then z.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
    /// A factor on the plant's size.
    #[serde(default = "one")]
    pub scale: f64,
    /// A factor on the size in which the scene's leaves are drawn in place of its blades. The plant's own blades keep
    /// their size.
    #[serde(default = "one")]
    pub leaf_scale: f64,
    /// Number of plants in the area.
    #[serde(default = "single")]
    pub count: usize,
    /// A file with a list of places, in place of a number and an area. Each line has x y z, which are added to
    /// `position_mm`.
    pub positions: Option<PathBuf>,
    /// Unit of that list; metres when absent.
    pub unit: Option<LengthUnit>,
    /// Least and largest factor on the scale of the single plants, by the seed; 1 when absent.
    pub scales: Option<[f64; 2]>,
    /// Size of the area along x and y, around the position.
    pub area_mm: Option<[f64; 2]>,
    /// Seed of the places in the area, and of the turns and scales.
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
    /// How its leaves flutter. When absent, they keep still on their branches. It is refused in a wind that moves none
    /// of the branches.
    pub flutter: Option<StatedFlutter>,
    /// What the scene states about single branches or levels, instead of the file.
    #[serde(default, rename = "branch")]
    pub branches: Vec<BranchOverride>,
}

/// The highest resonance (Hz) of leaves that flutter. Above it, the renderer's textures would repeat within ten
/// minutes.
pub const MOST_LEAF_RESONANCE: f64 = 6.4;

/// Leaves that turn back and forth about their axes in gusts.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedFlutter {
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
pub struct SceneWind {
    /// Mean speed at the place of the scene.
    pub speed_m_s: f64,
    /// Direction that it blows to, from +x towards +y.
    #[serde(default)]
    pub azimuth_deg: f64,
    /// Standard deviation of the speed over its mean.
    #[serde(default = "turbulence")]
    pub turbulence: f64,
    /// Seed of the gusts.
    #[serde(default)]
    pub seed: u64,
    /// Time at which the scene is seen, where a view does not state it.
    #[serde(default)]
    pub time_s: f64,
    /// Whether the real-time renderer moves plants in H9's simplified way (§4.8): only positions move, leaves and bark
    /// are lit as if they had not turned, and lengths of branches are corrected in closed form.
    #[serde(default)]
    pub simplified: bool,
}

impl SceneWind {
    /// The direction that it blows to, a unit vector.
    pub fn direction(&self) -> DVec3 {
        let azimuth = self.azimuth_deg.to_radians();
        DVec3::new(azimuth.cos(), azimuth.sin(), 0.0)
    }
}

/// The period of a scene whose light comes as if it repeated along x and y around the origin.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenePeriod {
    /// Lengths of the period along x and y.
    pub size_mm: [f64; 2],
}

/// A level, matte square of ground in the middle of the world. It reflects light and hides what is behind it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneGround {
    /// Diffuse reflectance; from the spectrum where it is not stated.
    #[serde(default = "unstated")]
    pub albedo: [f64; 3],
    /// A table of its reflectance over wavelength, for light of any band.
    pub spectrum: Option<StatedSpectrum>,
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
    /// A hill on it. Lawns follow it; plants and leaves stand where they are stated.
    pub hill: Option<SceneHill>,
}

/// A hill in the shape of a Gaussian, or a hollow.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneHill {
    /// Height of its top over the ground; less than 0 in a hollow.
    pub height_mm: f64,
    /// Distance from the top at which it is steepest, the standard deviation of the Gaussian.
    pub radius_mm: f64,
    /// The place of its top.
    #[serde(default)]
    pub position_mm: [f64; 2],
}

/// Number of grains along a side of the square after which the ground's pattern repeats.
pub const GRAINS_A_TILE: f64 = 64.0;

impl SceneGround {
    /// Standard deviation of the logarithm of the reflectance from grain to grain.
    pub fn contrast(&self) -> f64 {
        self.contrast.unwrap_or(0.4)
    }
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
