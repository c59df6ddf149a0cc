//! Radii by the pipe model, loads by the weight that a branch carries, and the bark.

use super::spec::PlantSpec;
use crate::branch_loads::{carried, own_mass};
use crate::form::{Branch, Plant, tube};

/// A branch has at most this share of the thickness of the branch that it grows on.
const THINNER: f64 = 0.85;
/// Acceleration of gravity (m/s²).
const GRAVITY: f64 = 9.81;

/// In the pipe model every branch has a pipe for each tip on it: r^p = Σ r_tip^p over its own tip and those of all
/// branches that grow on it. Along a branch the radius falls linearly to that of a tip.
pub fn radii(spec: &PlantSpec, branches: &mut [Branch]) {
    let p = spec.wood.pipe_exponent;
    let tip = spec.wood.twig_radius_mm;
    let mut carried = vec![1.0; branches.len()];
    for k in (0..branches.len()).rev() {
        if let Some(joint) = branches[k].parent {
            carried[joint.branch] += carried[k];
        }
    }
    for k in 0..branches.len() {
        let wanted = tip * f64::powf(carried[k], 1.0 / p);
        let most = branches[k].parent.map_or(f64::INFINITY, |joint| THINNER * branches[joint.branch].radius(joint.at));
        // A last shoot is slightly thicker at its root than at its tip.
        let root = wanted.max(1.25 * tip).min(most);
        branches[k].root_radius = root;
        branches[k].tip_radius = tip.min(0.9 * root);
    }
}

/// F/(E′r₁⁴) of a branch under the weight of its own wood, of its leaves and of everything that grows on it. The weight
/// is taken as spread evenly along the branch. Under an even load F, the tip of a clamped beam of constant thickness
/// goes down by F L³/(2π E r₁⁴), and that of the normalised beam by F/(2π E′r₁⁴). So F/(E′r₁⁴) = F L³/(E r₁⁴).
pub fn loads(spec: &PlantSpec, plant: &mut Plant) {
    // The blade's area is that of an ellipse with its length and width.
    let blade = spec.leaves.as_ref().map_or(0.0, |leaves| {
        leaves.mass_kg_m2 * 0.25 * std::f64::consts::PI * leaves.length_mm * leaves.width_mm * 1e-6
    });
    let masses = carried(plant, |b| own_mass(b, spec.wood.density_kg_m3, 1.0), |_| blade);
    for (branch, mass) in plant.branches.iter_mut().zip(masses) {
        // Units are N, N/mm² and mm.
        let modulus = spec.wood.modulus_gpa * 1e3;
        branch.load = mass * GRAVITY * branch.length().powi(3) / (modulus * branch.root_radius.powi(4));
    }
}

/// A tube around every axis.
pub fn skin(spec: &PlantSpec, branches: &mut [Branch]) {
    for branch in branches {
        let level = &spec.levels[branch.level];
        branch.wood = tube(&branch.axis, [branch.root_radius, branch.tip_radius], level.sides, level.rings);
    }
}
