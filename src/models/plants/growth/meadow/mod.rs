//! Grass: blades in tufts on a square that repeats, grown from a TOML file (format: `data/grass/README.md`). The same
//! description and seed give the same meadow.
//!
//! A blade is a thin sheet along an arc, tapered and folded along its midrib. A trefoil is a stalk with three leaflets.
//! Each sward has a number of shapes, and all its blades are instances of these. A blade belongs to the square in which
//! its foot stands, and may hang over the edge into the next square.

#[cfg(test)]
mod tests;

use super::Chance;
use super::spec::{self, profile, range};
use crate::file::MOST_TRIANGLES;
use crate::form::{Blade, Branch, BranchMotion, Joint, Leaf, Plant};
use crate::{Error, Result};
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use mesophyll_files::mesh::{LeafMesh, vertex_normals, vertex_tangents};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use serde::Deserialize;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;
use std::str::FromStr;

/// The largest number of blades on a square. A larger number is more likely a typing error than meant.
const MOST: f64 = 300_000.0;
/// Share of the width that is left at a pointed end, so that no triangle lacks an area.
const POINT: f64 = 0.02;
/// How far leaflets rise from the plane across their stalk: the slope along the stalk.
const LEAFLETS_RISE: f64 = 0.25;

/// A meadow's description.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeadowSpec {
    /// Version of the format: 1.
    pub schema: u32,
    /// Name of the meadow.
    pub name: String,
    /// Where the figures come from.
    #[serde(default)]
    pub sources: Vec<String>,
    /// The seed. The same seed grows the same meadow.
    pub seed: u64,
    /// Size along x and y of the square (or rectangle) that repeats. Its middle is the origin.
    pub size_mm: [f64; 2],
    /// The species that grow on it.
    #[serde(rename = "sward")]
    pub swards: Vec<Sward>,
}

/// Blades of one species.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sward {
    /// Name of the material.
    pub material: String,
    /// Botanical name.
    #[serde(default)]
    pub species: String,
    /// Number of blades (or trefoils) on a square metre.
    pub per_m2: f64,
    /// Length of a blade along its arc from foot to tip, or of a trefoil's stalk.
    pub length_mm: f64,
    /// Largest relative deviation of single blades from the mean size.
    #[serde(default)]
    pub size_spread: f64,
    /// Width of a blade at its widest place, or of a trefoil's stalk.
    pub width_mm: f64,
    /// Points of the outline: a share of the blade's length, and the share of the full width there.
    #[serde(default)]
    pub profile: Vec<[f64; 2]>,
    /// Angle between the vertical and the blade at its foot.
    #[serde(default)]
    pub lean_deg: f64,
    /// Largest deviation of single blades from that angle.
    #[serde(default)]
    pub lean_spread_deg: f64,
    /// How far the blade turns outwards and down from its foot to its tip.
    #[serde(default)]
    pub bend_deg: f64,
    /// Largest deviation of single shapes from that angle.
    #[serde(default)]
    pub bend_spread_deg: f64,
    /// Angle by which each half of the blade rises from flat.
    #[serde(default)]
    pub fold_deg: f64,
    /// Standard deviation of the distance of a tuft's feet from its middle.
    #[serde(default)]
    pub tuft_mm: f64,
    /// Number of blades in a tuft. They lean away from its middle.
    #[serde(default = "one")]
    pub blades_a_tuft: usize,
    /// Length and width of a trefoil's leaflets; a blade has none.
    pub leaflet_mm: Option<[f64; 2]>,
    /// Number of different shapes that blades are instances of.
    #[serde(default = "shapes")]
    pub shapes: usize,
    /// Number of pieces along a blade.
    #[serde(default = "segments")]
    pub segments: usize,
}

fn one() -> usize {
    1
}
fn shapes() -> usize {
    12
}
fn segments() -> usize {
    6
}

/// Reads the text of a description without checking its values.
impl FromStr for MeadowSpec {
    type Err = toml::de::Error;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        toml::from_str(text)
    }
}

impl MeadowSpec {
    /// Reads and checks a description.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the line or the field, what was found and what was expected.
    pub fn read(path: &Path) -> Result<MeadowSpec> {
        spec::parse::<MeadowSpec>(path).and_then(|meadow| meadow.check(path).map(|()| meadow))
    }

    fn check(&self, path: &Path) -> Result<()> {
        if self.schema != 1 {
            return Err(Error::unexpected(path, "schema", self.schema, "1"));
        }
        for side in self.size_mm {
            range(path, "size_mm", side, [1.0, 1e5])?;
        }
        if self.swards.is_empty() {
            return Err(Error::field(path, "sward", "missing; expected at least one [[sward]]"));
        }
        for (k, sward) in self.swards.iter().enumerate() {
            let within = |name: &str, value: f64, limits: [f64; 2]| {
                range(path, &format!("sward {}: {name}", k + 1), value, limits)
            };
            within("per_m2", sward.per_m2, [0.0, 1e7])?;
            within("length_mm", sward.length_mm, [0.1, 1e4])?;
            within("size_spread", sward.size_spread, [0.0, 0.95])?;
            within("width_mm", sward.width_mm, [0.01, 1e3])?;
            within("lean_deg", sward.lean_deg, [0.0, 90.0])?;
            within("lean_spread_deg", sward.lean_spread_deg, [0.0, 90.0])?;
            within("bend_deg", sward.bend_deg, [0.0, 180.0])?;
            within("bend_spread_deg", sward.bend_spread_deg, [0.0, 90.0])?;
            within("fold_deg", sward.fold_deg, [0.0, 85.0])?;
            within("tuft_mm", sward.tuft_mm, [0.0, 1e4])?;
            within("blades_a_tuft", sward.blades_a_tuft as f64, [1.0, 1e5])?;
            within("shapes", sward.shapes as f64, [1.0, 256.0])?;
            within("segments", sward.segments as f64, [1.0, 64.0])?;
            for side in sward.leaflet_mm.into_iter().flatten() {
                within("leaflet_mm", side, [0.01, 1e3])?;
            }
            let points = format!("sward {}: profile", k + 1);
            profile(path, &points, &sward.profile)?;
            if sward.profile.len() == 1 {
                return Err(Error::unexpected(path, &points, 1, "two points or more, or none"));
            }
        }
        let blades: f64 = self.swards.iter().map(|s| self.blades(s)).sum();
        if !(1.0..=MOST).contains(&blades) {
            return Err(Error::unexpected(
                path,
                "size_mm and per_m2",
                format!("{blades} blades"),
                format!("1 to {MOST}"),
            ));
        }
        // A mesh holds each shape once, but a scene holds all blades where they stand.
        let triangles = |s: &Sward| (self.blades(s) + s.shapes as f64) * s.triangles() as f64;
        let triangles: f64 = self.swards.iter().map(triangles).sum();
        if triangles > MOST_TRIANGLES as f64 {
            let found = format!("{triangles} triangles of all blades together (per_m2, shapes and segments)");
            return Err(Error::unexpected(path, "sward", found, format!("at most {MOST_TRIANGLES}")));
        }
        Ok(())
    }

    /// Number of blades of a sward on the square.
    fn blades(&self, sward: &Sward) -> f64 {
        (sward.per_m2 * self.size_mm[0] * self.size_mm[1] * 1e-6).round()
    }

    /// Grows the meadow. A `seed` replaces that of the description. The plant has one branch without wood: the ground
    /// on which all blades stand.
    pub fn grow(&self, seed: Option<u64>) -> Plant {
        let mut chance = Chance(Pcg64::seed_from_u64(seed.unwrap_or(self.seed)));
        let mut plant =
            Plant { name: self.name.clone(), branches: vec![ground()], period: Some(self.size_mm), ..Plant::default() };
        for sward in &self.swards {
            let (first, count) = (plant.blades.len(), self.blades(sward) as usize);
            for _ in 0..if count > 0 { sward.shapes } else { 0 } {
                let bend = (sward.bend_deg + sward.bend_spread_deg * chance.stray()).clamp(0.0, 180.0).to_radians();
                plant.blades.push(Blade { material: sward.material.clone(), mesh: sward.shape(bend) });
            }
            let mut tuft = DVec2::ZERO;
            for k in 0..count {
                if k % sward.blades_a_tuft == 0 {
                    tuft = DVec2::new(chance.stray(), chance.stray()) * 0.5 * DVec2::from(self.size_mm);
                }
                let away = DVec2::new(chance.normal(), chance.normal()) * sward.tuft_mm;
                // Blades lean away from the middle of their tuft, with some deviation. Blades that stand alone lean
                // anywhere.
                let stray = if sward.blades_a_tuft > 1 { 0.3 } else { 1.0 };
                // Where all feet of a tuft are at one place, its blades lean in all directions.
                let out = if sward.tuft_mm > 0.0 { away.to_angle() } else { PI * chance.stray() };
                let azimuth = out + stray * PI * chance.stray();
                let foot = wrapped(tuft + away, self.size_mm);
                let lean = (sward.lean_deg + sward.lean_spread_deg * chance.stray()).clamp(0.0, FRAC_PI_2.to_degrees());
                let size = 1.0 + sward.size_spread * chance.stray();
                let (out, lean) = (DVec3::new(azimuth.cos(), azimuth.sin(), 0.0), lean.to_radians());
                let x = out * lean.sin() + DVec3::Z * lean.cos();
                // The upper side of a leaning blade looks up, towards the tuft's middle.
                let z = DVec3::Z * lean.sin() - out * lean.cos();
                let turn = DMat3::from_cols(x, z.cross(x), z) * size;
                let middle = foot.extend(0.0) + x * (0.5 * sward.length_mm * size);
                let shape = (0.5 * (1.0 + chance.stray()) * sward.shapes as f64) as usize;
                plant.leaves.push(Leaf {
                    blade: first + shape.min(sward.shapes - 1),
                    joint: Joint { branch: 0, at: 0.0 },
                    transform: DMat4::from_translation(middle) * DMat4::from_mat3(turn),
                });
            }
        }
        plant
    }
}

/// The branch that blades stand on. It has no length, so no wind moves it, and no wood.
fn ground() -> Branch {
    Branch {
        name: "ground".into(),
        parent: None,
        level: 0,
        root: DVec3::ZERO,
        axes: [DVec3::Z, DVec3::X, DVec3::Y],
        axis: vec![DVec3::ZERO; 2],
        root_radius: 0.0,
        tip_radius: 0.0,
        load: 0.0,
        bending_load: 0.0,
        stated: BranchMotion::default(),
        material: String::new(),
        wood: LeafMesh::default(),
    }
}

/// The corresponding place within the square around the origin.
fn wrapped(place: DVec2, size: [f64; 2]) -> DVec2 {
    let size = DVec2::from(size);
    place - size * (place / size + 0.5).floor()
}

impl Sward {
    /// Number of triangles of one blade.
    fn triangles(&self) -> usize {
        4 * self.segments + if self.leaflet_mm.is_some() { 3 * 2 * (LEAFLET.len() - 1) } else { 0 }
    }

    /// A shape that turns by `bend` (radians) over its length. Its foot is at −½ length on x, where it points to +x and
    /// its upper side to +z.
    fn shape(&self, bend: f64) -> LeafMesh {
        let (length, fold) = (self.length_mm, self.fold_deg.to_radians());
        let width = |s: f64| if self.profile.is_empty() { 1.0 } else { spec::at(&self.profile, s) };
        let mut mesh = LeafMesh::default();
        for k in 0..=self.segments {
            let s = k as f64 / self.segments as f64;
            let (place, along, up) = arc(length, bend, s);
            let half = 0.5 * self.width_mm * width(s).max(POINT);
            for side in [-1.0, 0.0, 1.0] {
                let out = DVec3::Y * (side * fold.cos()) + up * (side.abs() * fold.sin());
                mesh.positions.push(place + out * half);
                mesh.uvs.push(DVec2::new(s, 0.5 - 0.5 * side));
            }
            debug_assert!((along.cross(DVec3::Y) - up).length() < 1e-9);
        }
        for k in 0..self.segments as u32 {
            for a in [3 * k, 3 * k + 1] {
                mesh.indices.extend([a, a + 3, a + 1, a + 3, a + 4, a + 1]);
            }
        }
        if let Some(leaflet) = self.leaflet_mm {
            let (tip, along, up) = arc(length, bend, 1.0);
            for k in 0..3 {
                let angle = TAU * (f64::from(k) / 3.0);
                let out = DQuat::from_axis_angle(along, angle) * up;
                let forth = (out + along * LEAFLETS_RISE).normalize();
                add_leaflet(&mut mesh, tip, forth, along.cross(out), leaflet);
            }
        }
        mesh.normals = vertex_normals(&mesh);
        mesh.tangents = vertex_tangents(&mesh);
        mesh
    }
}

/// Place, direction and upper side at a share `s` of an arc that turns by `bend` from +x towards −z.
fn arc(length: f64, bend: f64, s: f64) -> (DVec3, DVec3, DVec3) {
    let angle = bend * s;
    // ∫ cos and ∫ sin of the angle along the arc. The form with half angles also holds at bend 0.
    let half = 0.5 * angle;
    let chord = s * length * if half.abs() < 1e-6 { 1.0 } else { half.sin() / half };
    let place = DVec3::new(chord * half.cos() - 0.5 * length, 0.0, -chord * half.sin());
    let along = DVec3::new(angle.cos(), 0.0, -angle.sin());
    (place, along, DVec3::new(angle.sin(), 0.0, angle.cos()))
}

/// Points of a leaflet's outline: a share of its length, and the share of its width there.
const LEAFLET: [[f64; 2]; 5] = [[0.0, POINT], [0.3, 0.6], [0.65, 1.0], [0.9, 0.8], [1.0, 0.3]];

/// Adds a flat leaflet in the shape of an inverted egg, from its foot along `forth`.
fn add_leaflet(mesh: &mut LeafMesh, foot: DVec3, forth: DVec3, across: DVec3, [length, width]: [f64; 2]) {
    let first = mesh.positions.len() as u32;
    for [s, share] in LEAFLET {
        for side in [-1.0, 1.0] {
            mesh.positions.push(foot + forth * (s * length) + across * (0.5 * side * share * width));
            mesh.uvs.push(DVec2::new(s, 0.5 - 0.5 * side * share));
        }
    }
    for k in 0..LEAFLET.len() as u32 - 1 {
        let a = first + 2 * k;
        mesh.indices.extend([a, a + 2, a + 1, a + 2, a + 3, a + 1]);
    }
}
