//! Sums over what branches carry: their own wood, their leaves, and everything that grows on them.

use crate::form::{Branch, Leaf, Plant};
use crate::mechanics::wind::{TruncatedCone, mass};

/// The sum for each branch, over itself, its leaves and everything that grows on it. H9 Eq. 4.17 couples the motion of
/// branches by such sums.
pub fn carried(plant: &Plant, wood: impl Fn(&Branch) -> f64, leaf: impl Fn(&Leaf) -> f64) -> Vec<f64> {
    let mut sums: Vec<f64> = plant.branches.iter().map(wood).collect();
    for one in &plant.leaves {
        if let Some(sum) = sums.get_mut(one.joint.branch) {
            *sum += leaf(one);
        }
    }
    // Parents stand before the branches that grow on them, so the loop ends with the parents.
    for k in (0..sums.len()).rev() {
        if let Some(joint) = plant.branches[k].parent {
            sums[joint.branch] += sums[k];
        }
    }
    sums
}

/// Mass (kg) of a branch's own wood of `density` kg/m³, for a plant that is `scale` times as large.
pub fn own_mass(branch: &Branch, density: f64, scale: f64) -> f64 {
    let metres = |mm: f64| scale * mm / 1e3;
    let (root, tip) = (metres(branch.root_radius), metres(branch.tip_radius));
    mass(density, &[TruncatedCone { length: metres(branch.length()), root, tip }])
}
