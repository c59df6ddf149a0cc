//! What a plant is grown from: a TOML file (format: `data/plants/README.md`).

use crate::file::MOST_TRIANGLES;
use crate::{Error, Result};
use mesophyll_files::atomic::explain;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::path::Path;

/// A plant's description.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Version of the format: 1.
    pub schema: u32,
    /// What the plant is called.
    pub name: String,
    /// Its botanical name.
    #[serde(default)]
    pub species: String,
    /// Where the figures come from.
    #[serde(default)]
    pub sources: Vec<String>,
    /// The same seed grows the same plant.
    pub seed: u64,
    /// From the foot to the top.
    pub height_mm: f64,
    /// Shape of the crown.
    pub crown: Crown,
    /// Thickness and stiffness.
    pub wood: Wood,
    /// The trunk, then what grows on it, and so on.
    #[serde(rename = "level")]
    pub levels: Vec<Level>,
    /// The leaves.
    pub leaves: Option<Leaves>,
}

/// The crown as a body of revolution around the trunk.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crown {
    /// Where it begins: a share of the height.
    pub base: f64,
    /// Its largest radius.
    pub radius_mm: f64,
    /// Share of the crown's height, and share of its radius there; heights ascend.
    pub profile: Vec<[f64; 2]>,
}

/// What decides on radii and loads.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wood {
    /// Radius of every tip.
    pub twig_radius_mm: f64,
    /// Exponent p of the pipe model: a branch's radius to the power of p is the sum of what it carries.
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
    /// Each a golden angle from the one before.
    #[default]
    Spiral,
    /// Left and right in turn, in a plane that is as level as the parent allows.
    TwoRanked,
    /// In pairs, each pair a quarter turn from the one before.
    Opposite,
}

/// Branches of one order.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Level {
    /// How many there are on the whole plant; longer parents bear more.
    pub count: usize,
    /// Around the parent.
    #[serde(default)]
    pub arrangement: Arrangement,
    /// Angle to the parent, for those that grow lowest and highest on it; of a trunk, from the vertical.
    #[serde(default)]
    pub angle_deg: [f64; 2],
    /// How far single ones stray from it.
    #[serde(default)]
    pub angle_spread_deg: f64,
    /// Share of the parent, from its root, on which none grow.
    #[serde(default)]
    pub bare: f64,
    /// Order 1: share of the way to the crown's surface. Higher orders: share of the parent's length, for the lowest on
    /// it; the highest get half of it.
    #[serde(default = "whole")]
    pub length: f64,
    /// How far single lengths stray: a share.
    #[serde(default)]
    pub length_spread: f64,
    /// How far a branch turns towards the light over its length, where it stands across it.
    #[serde(default)]
    pub light_deg: f64,
    /// How far it sags over its length, where it is level.
    #[serde(default)]
    pub sag_deg: f64,
    /// How far its direction strays over its length.
    #[serde(default)]
    pub wander_deg: f64,
    /// Corners around a drawn branch.
    pub sides: usize,
    /// Rings of corners along it.
    pub rings: usize,
}

/// The leaves of a plant.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Leaves {
    /// How many there are on the whole plant; longer shoots bear more.
    pub count: usize,
    /// How many orders bear them, from the last one back.
    #[serde(default = "one")]
    pub levels: usize,
    /// Around the shoot.
    #[serde(default)]
    pub arrangement: Arrangement,
    /// Share of the shoot, from its root, that bears none.
    #[serde(default)]
    pub bare: f64,
    /// Between a blade's midrib and the shoot.
    pub angle_deg: f64,
    /// How far a blade's tip hangs below that.
    #[serde(default)]
    pub droop_deg: f64,
    /// How far single ones stray from it.
    #[serde(default)]
    pub spread_deg: f64,
    /// Of a blade, without its stalk.
    pub length_mm: f64,
    /// Of a blade, at its widest.
    pub width_mm: f64,
    /// Length of the stalk; it is not drawn.
    #[serde(default)]
    pub petiole_mm: f64,
    /// How far single lengths stray: a share.
    #[serde(default)]
    pub size_spread: f64,
    /// Share of the blade's length, and share of its half width there; a rectangle where there are no more than two.
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

/// No plant has more branches, or leaves, than this; a larger number is likelier a typing error.
const MOST: usize = 500_000;

impl Spec {
    /// Reads and checks a description.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the line or the field, what was found and what was expected.
    pub fn read(path: &Path) -> Result<Spec> {
        parse::<Spec>(path).and_then(|spec| spec.check(path).map(|()| spec))
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

/// Reads a description; what it says is not checked yet.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::input(path, explain(&e)))?;
    toml::from_str(&text).map_err(|e| Error::toml(path, &text, &e))
}

/// Whether a field's value lies within its limits.
pub(crate) fn range(path: &Path, field: &str, value: f64, [low, high]: [f64; 2]) -> Result<()> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Error::unexpected(path, field, value, format!("{low} to {high}")))
}

/// Whether a profile's places ascend within 0 and 1 and its shares are not negative.
pub(crate) fn profile(path: &Path, field: &str, points: &[[f64; 2]]) -> Result<()> {
    let ascending = points.windows(2).all(|w| w[0][0] < w[1][0]);
    if !ascending || points.iter().any(|[x, y]| !((0.0..=1.0).contains(x) && (0.0..=10.0).contains(y))) {
        return Err(Error::field(path, field, "expected ascending places from 0 to 1, each with a share of 0 or more"));
    }
    Ok(())
}

/// A profile's value, linear between its points.
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
