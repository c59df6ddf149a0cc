//! Grows a plant from a description: a parametric model of the family of J. Weber and J. Penn ("Creation and rendering
//! of realistic trees", SIGGRAPH 1995: counts, angles, lengths and curvature by order, inside a given crown), with
//! radii from the pipe model (K. Shinozaki et al., Jap. J. Ecol. 14 (1964), 97–105) and axes that turn to the light
//! ([`light`]). The same description and seed give the same plant.

mod foliage;
pub mod light;
pub mod meadow;
pub mod spec;
#[cfg(test)]
mod tests;
mod wood;

use crate::Result;
use crate::form::{Branch, BranchMotion, Joint, Plant};
use glam::{DQuat, DVec3};
use light::ShadeGrid;
use meadow::MeadowSpec;
use mesophyll_files::mesh::LeafMesh;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use spec::{Arrangement, BranchLevel, Crown, PlantSpec};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;

/// Number of cells of shade along the height of a plant.
const CELLS: f64 = 40.0;
/// For orders above 1, the highest branch on a parent has this share of the length of the lowest one.
const HIGHEST: f64 = 0.5;
/// The least length of a branch, as a share of the plant's height.
const SHORTEST: f64 = 2e-3;

/// The random numbers of a plant.
pub(crate) struct Chance(Pcg64);

impl Chance {
    /// A number from −1 to 1, all equally likely.
    pub(crate) fn stray(&mut self) -> f64 {
        self.0.random::<f64>() * 2.0 - 1.0
    }

    /// Normally distributed with the standard deviation 1 (Box and Muller 1958).
    pub(crate) fn normal(&mut self) -> f64 {
        let (u, v) = (1.0 - self.0.random::<f64>(), self.0.random::<f64>());
        (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
    }
}

/// Reads what `path` describes and grows it: a meadow if the file has a [[sward]], otherwise a plant. A `seed` replaces
/// that of the description.
///
/// # Errors
/// As [`PlantSpec::read`] and [`MeadowSpec::read`].
pub fn described(path: &Path, seed: Option<u64>) -> Result<Plant> {
    let table: toml::Table = spec::parse(path)?;
    match table.contains_key("sward") {
        true => MeadowSpec::read(path).map(|meadow| meadow.grow(seed)),
        false => PlantSpec::read(path).map(|spec| grow(&spec, seed)),
    }
}

/// Grows the plant. A `seed` replaces that of the description.
pub fn grow(spec: &PlantSpec, seed: Option<u64>) -> Plant {
    let mut chance = Chance(Pcg64::seed_from_u64(seed.unwrap_or(spec.seed)));
    let mut shade = ShadeGrid::new(spec.height_mm / CELLS);
    let mut branches: Vec<Branch> = Vec::new();
    let mut before = 0..0;
    for (order, level) in spec.levels.iter().enumerate() {
        let first = branches.len();
        let sprouts = if order == 0 {
            trunks(spec, level, &mut chance)
        } else {
            sprouts(spec, order, &branches, before, &mut chance)
        };
        for sprout in sprouts {
            let number = branches.len() - first;
            branches.push(sprout.grow(spec, level, order, number, &shade, &mut chance));
        }
        before = first..branches.len();
        for branch in &branches[before.clone()] {
            let steps = (branch.length() / shade.cell()).ceil().max(1.0) as usize;
            (1..=steps).for_each(|k| shade.add(branch.point(k as f64 / steps as f64).0));
        }
    }
    let mut plant = Plant { name: spec.name.clone(), branches, ..Plant::default() };
    wood::radii(spec, &mut plant.branches);
    if let Some(leaves) = &spec.leaves {
        foliage::grow(spec, leaves, &mut plant, &mut chance);
    }
    wood::loads(spec, &mut plant);
    wood::skin(spec, &mut plant.branches);
    plant
}

/// A branch that starts to grow.
struct Sprout {
    parent: Option<Joint>,
    root: DVec3,
    direction: DVec3,
    length: f64,
}

/// The trunks. A single one stands upright at the origin, and several stand around it.
fn trunks(spec: &PlantSpec, level: &BranchLevel, chance: &mut Chance) -> Vec<Sprout> {
    (0..level.count)
        .map(|k| {
            let azimuth = TAU * k as f64 / level.count as f64;
            let lean = (level.angle_deg[0] + level.angle_spread_deg * chance.stray()).to_radians();
            let out = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
            let apart = if level.count > 1 { 0.01 * spec.height_mm } else { 0.0 };
            Sprout {
                parent: None,
                root: out * apart,
                direction: out * lean.sin() + DVec3::Z * lean.cos(),
                length: spec.height_mm * level.length * (1.0 - 0.5 * level.length_spread * (1.0 + chance.stray())),
            }
        })
        .collect()
}

/// How many of `total` each of the weights gets: whole numbers in proportion to the weights, by largest remainders.
pub(crate) fn shares(total: usize, weights: &[f64]) -> Vec<usize> {
    let whole: f64 = weights.iter().sum();
    if !(whole > 0.0) {
        return vec![0; weights.len()];
    }
    let exact: Vec<f64> = weights.iter().map(|w| total as f64 * w / whole).collect();
    let mut out: Vec<usize> = exact.iter().map(|e| e.floor() as usize).collect();
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|a, b| (exact[*b] - exact[*b].floor()).total_cmp(&(exact[*a] - exact[*a].floor())).then(a.cmp(b)));
    let missing = total.saturating_sub(out.iter().sum());
    order.iter().take(missing).for_each(|k| out[*k] += 1);
    out
}

/// Unit vector across `t` for the k-th of the branches or leaves that follow each other around it.
pub(crate) fn side(arrangement: Arrangement, t: DVec3, k: usize, turned: f64) -> DVec3 {
    // The first direction is level where that is possible.
    let level = t.cross(DVec3::Z).try_normalize().unwrap_or_else(|| t.any_orthonormal_vector());
    let turn = match arrangement {
        Arrangement::Spiral => k as f64 * PI * (3.0 - 5f64.sqrt()) + turned,
        Arrangement::TwoRanked => k as f64 * PI,
        Arrangement::Opposite => (k % 2) as f64 * PI + (k / 2 % 2) as f64 * FRAC_PI_2 + turned,
    };
    DQuat::from_axis_angle(t, turn) * level
}

fn sprouts(
    spec: &PlantSpec,
    order: usize,
    branches: &[Branch],
    parents: std::ops::Range<usize>,
    chance: &mut Chance,
) -> Vec<Sprout> {
    let level = &spec.levels[order];
    let weights: Vec<f64> = branches[parents.clone()].iter().map(Branch::length).collect();
    let mut out = Vec::new();
    for (index, count) in parents.zip(shares(level.count, &weights)) {
        let parent = &branches[index];
        let turned = PI * chance.stray();
        // The two of an opposite pair share a place.
        let together = if level.arrangement == Arrangement::Opposite { 2 } else { 1 };
        let mut share = 0.0;
        for k in 0..count {
            if k % together == 0 {
                let place = (k / together) as f64 + 0.5 + 0.35 * chance.stray();
                share = place / count.div_ceil(together) as f64;
            }
            let at = level.bare + (1.0 - level.bare) * share;
            let (root, t) = parent.point(at);
            let angle = level.angle_deg[0] + (level.angle_deg[1] - level.angle_deg[0]) * share;
            let angle = (angle + level.angle_spread_deg * chance.stray()).to_radians();
            let across = side(level.arrangement, t, k, turned);
            let direction = (t * angle.cos() + across * angle.sin()).normalize();
            let stray = 1.0 + level.length_spread * chance.stray();
            let to_surface = reach(&spec.crown, spec.height_mm, root, direction);
            let length = if order == 1 {
                to_surface * level.length
            } else {
                (parent.length() * level.length * (1.0 - (1.0 - HIGHEST) * share)).min(1.1 * to_surface)
            };
            let length = (length * stray).max(SHORTEST * spec.height_mm);
            out.push(Sprout { parent: Some(Joint { branch: index, at }), root, direction, length });
        }
    }
    out
}

/// Distance from `place` along `direction` to the crown's surface; 0 from outside.
fn reach(crown: &Crown, height: f64, place: DVec3, direction: DVec3) -> f64 {
    let step = 0.005 * height;
    let base = crown.base * height;
    let inside = |p: DVec3| {
        let share = (p.z - base) / (height - base);
        share <= 1.0 && p.truncate().length() <= crown.radius_mm * spec::at(&crown.profile, share.max(0.0))
    };
    (1..1000).map(|k| f64::from(k) * step).find(|d| !inside(place + direction * *d)).map_or(1000.0 * step, |d| d - step)
}

impl Sprout {
    /// Grows the axis. On its way it bends towards the light, down by its weight, and at random.
    fn grow(
        self,
        spec: &PlantSpec,
        level: &BranchLevel,
        order: usize,
        number: usize,
        shade: &ShadeGrid,
        chance: &mut Chance,
    ) -> Branch {
        let steps = level.rings - 1;
        let step = self.length / steps as f64;
        let turn = |d: DVec3, to: DVec3, angle: f64| {
            // The turn is largest where the branch stands across the target direction.
            let across = to - d * to.dot(d);
            (d + across * angle).normalize()
        };
        let part = |deg: f64| deg.to_radians() / steps as f64;
        let (mut place, mut d) = (self.root, self.direction);
        let mut world = vec![place];
        for _ in 0..steps {
            place += d * step;
            world.push(place);
            d = turn(d, shade.direction(place), part(level.light_deg));
            d = turn(d, DVec3::NEG_Z, part(level.sag_deg));
            let (u, v) = d.any_orthonormal_pair();
            let astray = level.wander_deg.to_radians() / (steps as f64).sqrt();
            d = (d + u * (astray * chance.stray()) + v * (astray * chance.stray())).normalize();
        }
        // s lies across the axis and as far up as possible; r = s × t.
        let t = self.direction;
        let up = if t.z.abs() > 0.999 { DVec3::X } else { DVec3::Z };
        let s = (up - t * t.dot(up)).try_normalize().unwrap_or(DVec3::Y);
        let r = s.cross(t);
        let local = |p: &DVec3| DVec3::new((*p - self.root).dot(t), (*p - self.root).dot(r), (*p - self.root).dot(s));
        Branch {
            name: if order == 0 && spec.levels[0].count == 1 { "trunk".into() } else { format!("{order}.{number}") },
            parent: self.parent,
            level: order,
            root: self.root,
            axes: [t, r, s],
            axis: world.iter().map(local).collect(),
            root_radius: 0.0,
            tip_radius: 0.0,
            load: 0.0,
            bending_load: 0.0,
            stated: BranchMotion::default(),
            material: spec.wood.material.clone(),
            wood: LeafMesh::default(),
        }
    }
}
