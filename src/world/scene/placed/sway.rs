//! How every branch of a plant responds to the wind. A branch is an oscillator (H9 Eq. 4.16, as it follows from the
//! equation of motion) with its own resonance (Eq. 4.20), and with the mass of everything that it carries (Eq. 4.17,
//! and the leaves). Also, which branches are alike enough to share a motion texture.

use mesophyll_files::mesh::LeafMesh;
use mesophyll_plants::branch_loads::{carried, own_mass};
use mesophyll_plants::form::{Branch, Leaf, Plant};
use mesophyll_plants::mechanics::wind::{Oscillator, Sway, Wind};
use std::f64::consts::TAU;

/// The largest ratio of two resonances for which branches share a motion texture.
pub const ALIKE: f64 = 1.12;

/// Texels along a side of a motion texture. It holds frequencies down to 1/64 of a branch's resonance, and does not
/// repeat within 8,000 of its periods.
pub const MOTION_SIDE: usize = 1024;

/// The sway of every branch of a plant, and the mass that it carries (kg). What the scene states about a branch goes
/// before what follows from its size, its mass and the plant's drag.
pub fn sways(said: &crate::manifest::StatedPlant, wind: Wind, plant: &Plant) -> Vec<Option<(Sway, f64)>> {
    let metres = said.scale / 1e3;
    let blades: Vec<f64> = plant.blades.iter().map(|b| area(&b.mesh)).collect();
    // Area of one side of a blade (m²).
    let of_leaf =
        |leaf: &Leaf| blades[leaf.blade] * leaf.transform.determinant().abs().cbrt().powi(2) * metres * metres;
    let across = |b: &Branch| (b.root_radius + b.tip_radius) * b.length() * metres * metres;
    let masses = carried(plant, |b| own_mass(b, said.wood_kg_m3, said.scale), |leaf| said.leaf_kg_m2 * of_leaf(leaf));
    // Leaves that face all directions have half of their area across the wind.
    let areas = carried(plant, across, |leaf| 0.5 * of_leaf(leaf));
    let leafless = plant.leaves.is_empty();
    let one = |(k, branch): (usize, &Branch)| {
        let (length, stated) = (branch.length() * metres, &branch.stated);
        if !(length > 1e-9) {
            return None;
        }
        let ratio = stated.damping.unwrap_or(said.damping);
        let oscillator = match stated.resonance_hz {
            Some(resonance) => Oscillator { resonance, damping: ratio * 2.0 * TAU * resonance },
            None => Oscillator::of_branch(length, leafless, ratio),
        };
        let lean = match stated.lean_per_m_s {
            Some(lean) => lean * wind.speed,
            None => {
                let force = said.drag_n_s_m3 * areas[k] * wind.speed;
                let stiffness = masses[k] * (TAU * oscillator.resonance).powi(2);
                force / stiffness / length
            }
        };
        (lean > 0.0 && lean.is_finite()).then_some((Sway { wind, oscillator, lean }, masses[k]))
    };
    plant.branches.iter().enumerate().map(one).collect()
}

/// Variance of the tip's deflection over the length, for the frequencies that a motion texture holds.
pub fn variance(sway: &Sway) -> f64 {
    let count = MOTION_SIDE / mesophyll_plants::mechanics::motion::TEXELS_A_CYCLE;
    let step = sway.highest() / count as f64;
    (1..=count).map(|j| sway.spectrum(j as f64 * step) * step).sum()
}

fn area(mesh: &LeafMesh) -> f64 {
    (0..mesh.triangles())
        .map(|t| {
            let [a, b, c] = mesh.triangle(t).map(|k| mesh.positions[k]);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum()
}

/// Whether a sway can use the texture of another.
pub fn alike(lead: &Sway, sway: &Sway) -> bool {
    let ratio = |s: &Sway| s.oscillator.damping / s.oscillator.resonance;
    let apart = (sway.oscillator.resonance / lead.oscillator.resonance).ln().abs();
    apart <= 0.5 * ALIKE.ln() + 1e-9 && (ratio(lead) / ratio(sway) - 1.0).abs() < 1e-9
}

/// The sways for which motion textures are made. They are as few as possible, such that each of `sways` is alike to one
/// of them. The resonance of each is in the middle of those that are alike to it. Their lean is 1.
pub fn leads(mut sways: Vec<Sway>) -> Vec<Sway> {
    sways.sort_by(|a, b| a.oscillator.resonance.total_cmp(&b.oscillator.resonance));
    let mut out: Vec<Sway> = Vec::new();
    for (k, sway) in sways.iter().enumerate() {
        if out.iter().any(|lead| alike(lead, sway)) {
            continue;
        }
        let f = sway.oscillator.resonance;
        let ratio = sway.oscillator.damping / f;
        let damped = |s: &Sway| (s.oscillator.damping / s.oscillator.resonance / ratio - 1.0).abs() < 1e-9;
        let reach = |s: &&Sway| s.oscillator.resonance <= ALIKE * f && damped(s);
        let last = sways[k..].iter().rfind(reach).map_or(f, |s| s.oscillator.resonance);
        let middle = (f * last).sqrt();
        out.push(Sway { oscillator: Oscillator { resonance: middle, damping: ratio * middle }, lean: 1.0, ..*sway });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::winds::SwayingPlants;
    use super::super::winds::tests::scene;
    use super::*;
    use crate::placed::ledger::Ledger;
    use mesophyll_plants::form::BranchMotion;

    #[test]
    fn what_a_branch_carries_decides_how_far_it_goes() {
        let (manifest, planted) = scene(4.0);
        let said = &manifest.plants[0];
        let answers = |speed: f64, said: &crate::manifest::StatedPlant| {
            sways(said, Wind { speed, turbulence: 0.3 }, &planted[0].plant)
        };
        let (a, b) = (answers(4.0, said), answers(8.0, said));
        for ((slow, mass), (fast, same)) in a.iter().flatten().zip(b.iter().flatten()) {
            // The force is proportional to the speed, and the mass stays the same.
            assert!((fast.lean / slow.lean - 2.0).abs() < 1e-12 && mass == same);
        }
        // The trunk carries everything: the sum over cones and leaves, one by one.
        let plant = &planted[0].plant;
        let wood: f64 = plant
            .branches
            .iter()
            .map(|b| {
                let (r, s) = (b.root_radius / 1e3, b.tip_radius / 1e3);
                900.0 * std::f64::consts::PI * b.length() / 3e3 * (r * r + r * s + s * s)
            })
            .sum();
        let blade: f64 =
            plant.leaves.iter().map(|l| area(&plant.blades[l.blade].mesh) * l.transform.x_axis.length_squared()).sum();
        let (trunk, mass) = a[0].unwrap();
        assert!((mass / (wood + 0.2 * blade * 1e-6) - 1.0).abs() < 1e-9, "{mass}");
        let resonance = 2.55 * (plant.branches[0].length() / 1e3).powf(-0.59);
        assert!((trunk.oscillator.resonance / resonance - 1.0).abs() < 1e-12);
        assert!(a.iter().skip(1).flatten().all(|(_, own)| *own < mass));
        // There are as few textures as the ratio allows, and every branch has one.
        let all: Vec<Sway> = a.iter().flatten().map(|(sway, _)| *sway).collect();
        let leads = leads(all.clone());
        assert!(all.iter().all(|s| leads.iter().any(|lead| alike(lead, s))));
        let spread = |of: fn(f64, f64) -> f64, from: f64| all.iter().map(|s| s.oscillator.resonance).fold(from, of);
        let bands = (spread(f64::max, 0.0) / spread(f64::min, f64::INFINITY)).ln() / ALIKE.ln();
        assert!(leads.len() as f64 <= bands.ceil(), "{} for {bands}", leads.len());
        // Nothing moves without a wind, and a wind without a hold on a plant does not move it.
        let mut free = manifest.clone();
        free.plants[0].drag_n_s_m3 = 0.0;
        assert!(answers(4.0, &free.plants[0]).iter().all(Option::is_none));
        // What is stated about a branch goes before its mass, its length and the plant's drag.
        let stated = BranchMotion { lean_per_m_s: Some(0.02), resonance_hz: Some(3.0), damping: Some(0.5) };
        let mut told = planted[0].plant.clone();
        told.branches[1].stated = stated;
        let told = sways(&free.plants[0], Wind { speed: 4.0, turbulence: 0.3 }, &told);
        let (sway, _) = told[1].unwrap();
        assert!((sway.lean - 0.08).abs() < 1e-15 && sway.oscillator.resonance == 3.0);
        assert!((sway.oscillator.damping - 0.5 * 4.0 * std::f64::consts::PI * 3.0).abs() < 1e-12);
        assert_eq!(told.iter().flatten().count(), 1);
        for still in [free, scene(0.0).0] {
            assert!(SwayingPlants::new(&still, &planted, &Ledger::new()).unwrap().is_none());
        }
    }
}
