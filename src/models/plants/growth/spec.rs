//! What a plant is grown from: a TOML file (format: `data/plants/README.md`).

use crate::file::MOST_TRIANGLES;
use crate::{Error, Result};
use mesophyll_base::error::TomlKind;
use mesophyll_files::whole_file;
use serde::Deserialize;
use std::path::Path;
use std::str::FromStr;

/// A plant's description.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantSpec {
    /// Version of the format: 1.
    pub schema: u32,
    /// Name of the plant.
    pub name: String,
    /// Its botanical name.
    #[serde(default)]
    pub species: String,
    /// Where the figures come from.
    #[serde(default)]
    pub sources: Vec<String>,
    /// The seed. The same seed grows the same plant.
    pub seed: u64,
    /// Height from the foot to the top.
    pub height_mm: f64,
    /// Shape of the crown.
    pub crown: Crown,
    /// Thickness and stiffness.
    pub wood: WoodSpec,
    /// Levels of branching: the trunk, then what grows on it, and so on.
    #[serde(rename = "level")]
    pub levels: Vec<BranchLevel>,
    /// The leaves.
    pub leaves: Option<FoliageSpec>,
}

/// The crown as a body of revolution around the trunk.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crown {
    /// Where the crown begins: a share of the plant's height.
    pub base: f64,
    /// Its largest radius.
    pub radius_mm: f64,
    /// Points of the outline: a share of the crown's height, and the share of its radius there. Heights ascend.
    pub profile: Vec<[f64; 2]>,
}

/// The figures that decide on radii and loads.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WoodSpec {
    /// Radius of every tip.
    pub twig_radius_mm: f64,
    /// Exponent p of the pipe model: a branch's radius to the power of p is the sum of the same powers over the tips
    /// that it carries.
    pub pipe_exponent: f64,
    /// Of fresh wood.
    #[serde(default = "density")]
    pub density_kg_m3: f64,
    /// Young's modulus of fresh wood.
    #[serde(default = "modulus")]
    pub modulus_gpa: f64,
    /// Name of the material.
    #[serde(default = "bark")]
    pub material: String,
}

/// How branches or leaves follow each other around what they grow on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Arrangement {
    /// Each is a golden angle further around than the one before.
    #[default]
    Spiral,
    /// Left and right in turn, in a plane that is as level as the parent allows.
    TwoRanked,
    /// In pairs, each a quarter turn further around than the pair before.
    Opposite,
}

/// Branches of one order.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BranchLevel {
    /// Number of branches of this order on the whole plant. Longer parents bear more.
    pub count: usize,
    /// How the branches follow each other around the parent.
    #[serde(default)]
    pub arrangement: Arrangement,
    /// Angle to the parent, for the lowest and for the highest branch on it. A trunk's angle is from the vertical.
    #[serde(default)]
    pub angle_deg: [f64; 2],
    /// Largest deviation of single branches from that angle.
    #[serde(default)]
    pub angle_spread_deg: f64,
    /// Share of the parent, counted from its root, on which no branch grows.
    #[serde(default)]
    pub bare: f64,
    /// For order 1, the length as a share of the way to the crown's surface. For higher orders, the length of the
    /// lowest branch as a share of the parent's length; the highest branch gets half of it.
    #[serde(default = "whole")]
    pub length: f64,
    /// Largest relative deviation of single lengths.
    #[serde(default)]
    pub length_spread: f64,
    /// Angle by which a branch would turn towards the light over its length if it stood across it.
    #[serde(default)]
    pub light_deg: f64,
    /// Angle by which a branch would sag over its length if it were level.
    #[serde(default)]
    pub sag_deg: f64,
    /// Angle by which its direction wanders at random over its length.
    #[serde(default)]
    pub wander_deg: f64,
    /// Number of corners around a drawn branch.
    pub sides: usize,
    /// Number of rings of corners along it.
    pub rings: usize,
}

/// The leaves of a plant.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoliageSpec {
    /// Number of leaves on the whole plant. Longer shoots bear more.
    pub count: usize,
    /// Number of orders that bear leaves, counted from the last one.
    #[serde(default = "one")]
    pub levels: usize,
    /// How leaves follow each other around the shoot.
    #[serde(default)]
    pub arrangement: Arrangement,
    /// Share of the shoot, counted from its root, that bears no leaves.
    #[serde(default)]
    pub bare: f64,
    /// Angle between a blade's midrib and the shoot.
    pub angle_deg: f64,
    /// Angle by which a blade's tip hangs below that direction.
    #[serde(default)]
    pub droop_deg: f64,
    /// Largest deviation of single leaves from these angles.
    #[serde(default)]
    pub spread_deg: f64,
    /// Length of a blade without its stalk.
    pub length_mm: f64,
    /// Width of a blade at its widest place.
    pub width_mm: f64,
    /// Length of the stalk; it is not drawn.
    #[serde(default)]
    pub petiole_mm: f64,
    /// Largest relative deviation of single sizes.
    #[serde(default)]
    pub size_spread: f64,
    /// Points of the outline: a share of the blade's length, and the share of its half width there. With fewer than
    /// three points the blade is a rectangle.
    #[serde(default)]
    pub profile: Vec<[f64; 2]>,
    /// Mass of a blade per area.
    #[serde(default = "leaf_mass")]
    pub mass_kg_m2: f64,
    /// Name of the material.
    #[serde(default = "leaf")]
    pub material: String,
}

fn density() -> f64 {
    900.0
}
fn modulus() -> f64 {
    8.0
}
fn bark() -> String {
    "bark".into()
}
fn leaf() -> String {
    "leaf".into()
}
fn whole() -> f64 {
    1.0
}
fn one() -> usize {
    1
}
fn leaf_mass() -> f64 {
    0.2
}

/// The largest number of branches, and of leaves. A larger number is more likely a typing error than meant.
const MOST: usize = 500_000;

/// Reads the text of a description without checking its values.
impl FromStr for PlantSpec {
    type Err = toml::de::Error;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        toml::from_str(text)
    }
}

impl PlantSpec {
    /// Reads and checks a description.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the line or the field, what was found and what was expected.
    pub fn read(path: &Path) -> Result<PlantSpec> {
        parse::<PlantSpec>(path).and_then(|spec| spec.check(path).map(|()| spec))
    }

    fn check(&self, path: &Path) -> Result<()> {
        let range = |field: String, value: f64, limits: [f64; 2]| range(path, &field, value, limits);
        if self.schema != 1 {
            return Err(Error::unexpected(path, "schema", self.schema, "1"));
        }
        range("height_mm".into(), self.height_mm, [1.0, 1e6])?;
        range("crown.base".into(), self.crown.base, [0.0, 0.99])?;
        range("crown.radius_mm".into(), self.crown.radius_mm, [1.0, 1e6])?;
        range("wood.twig_radius_mm".into(), self.wood.twig_radius_mm, [1e-3, 1e4])?;
        range("wood.pipe_exponent".into(), self.wood.pipe_exponent, [1.0, 4.0])?;
        range("wood.density_kg_m3".into(), self.wood.density_kg_m3, [1.0, 1e4])?;
        range("wood.modulus_gpa".into(), self.wood.modulus_gpa, [1e-3, 1e3])?;
        profile(path, "crown.profile", &self.crown.profile)?;
        if self.crown.profile.len() < 2 {
            return Err(Error::unexpected(path, "crown.profile", self.crown.profile.len(), "two points or more"));
        }
        if self.levels.is_empty() {
            return Err(Error::field(path, "level", "missing; expected at least the trunk's [[level]]"));
        }
        for (k, level) in self.levels.iter().enumerate() {
            let field = |name: &str| format!("level {k}: {name}");
            range(field("count"), level.count as f64, [1.0, MOST as f64])?;
            range(field("angle_deg"), level.angle_deg[0], [0.0, 180.0])?;
            range(field("angle_deg"), level.angle_deg[1], [0.0, 180.0])?;
            range(field("angle_spread_deg"), level.angle_spread_deg, [0.0, 90.0])?;
            range(field("bare"), level.bare, [0.0, 1.0])?;
            range(field("length"), level.length, [1e-3, 10.0])?;
            range(field("length_spread"), level.length_spread, [0.0, 0.95])?;
            range(field("light_deg"), level.light_deg, [-180.0, 180.0])?;
            range(field("sag_deg"), level.sag_deg, [-180.0, 180.0])?;
            range(field("wander_deg"), level.wander_deg, [0.0, 180.0])?;
            range(field("sides"), level.sides as f64, [3.0, 256.0])?;
            range(field("rings"), level.rings as f64, [2.0, 1024.0])?;
        }
        let triangles = self.levels.iter().map(|l| l.count.saturating_mul(2 * l.sides * (l.rings - 1)));
        let triangles = triangles.fold(0usize, usize::saturating_add);
        if triangles > MOST_TRIANGLES {
            let found = format!("{triangles} triangles of all branches together (count, sides and rings)");
            return Err(Error::unexpected(path, "level", found, format!("at most {MOST_TRIANGLES}")));
        }
        let Some(leaves) = &self.leaves else { return Ok(()) };
        let field = |name: &str| format!("leaves.{name}");
        if leaves.profile.len() == 1 {
            return Err(Error::unexpected(path, "leaves.profile", 1, "two points or more, or none"));
        }
        range(field("count"), leaves.count as f64, [1.0, MOST as f64])?;
        range(field("levels"), leaves.levels as f64, [1.0, self.levels.len() as f64])?;
        range(field("bare"), leaves.bare, [0.0, 1.0])?;
        range(field("angle_deg"), leaves.angle_deg, [0.0, 180.0])?;
        range(field("droop_deg"), leaves.droop_deg, [-180.0, 180.0])?;
        range(field("spread_deg"), leaves.spread_deg, [0.0, 180.0])?;
        range(field("length_mm"), leaves.length_mm, [1e-2, 1e5])?;
        range(field("width_mm"), leaves.width_mm, [1e-2, 1e5])?;
        range(field("petiole_mm"), leaves.petiole_mm, [0.0, 1e5])?;
        range(field("size_spread"), leaves.size_spread, [0.0, 0.95])?;
        range(field("mass_kg_m2"), leaves.mass_kg_m2, [0.0, 100.0])?;
        profile(path, "leaves.profile", &leaves.profile)
    }
}

/// Reads a description without checking its values.
pub(crate) fn parse<T: FromStr<Err = toml::de::Error>>(path: &Path) -> Result<T> {
    let text = whole_file::text(path)?;
    text.parse().map_err(|e| Error::toml_of(TomlKind::Growth, path, &text, &e))
}

/// Checks that a field's value lies within its limits.
pub(crate) fn range(path: &Path, field: &str, value: f64, [low, high]: [f64; 2]) -> Result<()> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Error::unexpected(path, field, value, format!("{low} to {high}")))
}

/// Checks that the places of a profile ascend within 0 and 1 and that its shares are not negative.
pub(crate) fn profile(path: &Path, field: &str, points: &[[f64; 2]]) -> Result<()> {
    let ascending = points.windows(2).all(|w| w[0][0] < w[1][0]);
    if !ascending || points.iter().any(|[x, y]| !((0.0..=1.0).contains(x) && (0.0..=10.0).contains(y))) {
        return Err(Error::field(path, field, "expected ascending places from 0 to 1, each with a share of 0 or more"));
    }
    Ok(())
}

/// The value of a profile, linear between its points.
pub(crate) fn at(points: &[[f64; 2]], x: f64) -> f64 {
    let Some(first) = points.first() else { return 1.0 };
    if x <= first[0] {
        return first[1];
    }
    for w in points.windows(2) {
        if x <= w[1][0] {
            return w[0][1] + (w[1][1] - w[0][1]) * (x - w[0][0]) / (w[1][0] - w[0][0]);
        }
    }
    points.last().map_or(1.0, |p| p[1])
}
