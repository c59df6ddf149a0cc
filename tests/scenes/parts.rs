//! What the adapter poses, compared with the pose in double precision: joints of branches, and boxes around parts.

use glam::{DVec3, Vec3};
use mesophyll::plants::form::Plant;

/// The largest change of the distance between a child's root, as the adapter places the middle of its first ring of
/// vertices, and its parent's axis in double precision, over the parent's radius.
pub fn gap(rest: &Plant, now: &Plant, found: &[[Vec3; 3]]) -> f64 {
    let (mut first, mut worst) = (0, 0.0f64);
    for branch in &rest.branches {
        let ring: Vec<usize> =
            (0..branch.wood.positions.len()).filter(|v| branch.wood.positions[*v].x.abs() < 1e-6).collect();
        let middle = |of: &dyn Fn(usize) -> DVec3| ring.iter().map(|v| of(*v)).sum::<DVec3>() / ring.len() as f64;
        if let (Some(joint), false) = (branch.parent, ring.is_empty()) {
            let parent = &rest.branches[joint.branch];
            let own = branch.frame();
            let at_rest =
                middle(&|v| own.transform_point3(branch.wood.positions[v])).distance(parent.point(joint.at).0);
            let here =
                middle(&|v| found[first + v][0].as_dvec3()).distance(now.branches[joint.branch].point(joint.at).0);
            worst = worst.max((here - at_rest).abs() / parent.radius(joint.at));
        }
        first += branch.wood.positions.len();
    }
    worst
}

/// Every vertex of a part in double precision lies in its box. Returns how many times as long as the part its box is
/// in the mean over parts and axes, and how many times as large.
pub fn looseness(plant: &Plant, blade: &[Vec3], boxes: &[Option<[Vec3; 2]>]) -> [f64; 2] {
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for (k, branch) in plant.branches.iter().enumerate() {
        let frame = branch.frame();
        let bark = branch.wood.positions.iter().map(|p| frame.transform_point3(*p));
        let leaves = plant.leaves.iter().filter(|leaf| leaf.joint.branch == k);
        let leaves = leaves.flat_map(|leaf| blade.iter().map(|p| leaf.transform.transform_point3(p.as_dvec3())));
        let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = bark.chain(leaves).fold(nowhere, |(l, h), p| (l.min(p), h.max(p)));
        let Some([below, above]) = boxes[k].map(|corners| corners.map(|c| c.as_dvec3())) else {
            assert!(low.x > high.x, "branch {k} has no box");
            continue;
        };
        // The steps of sections and single precision: a hundred-thousandth of the branch.
        let slack = DVec3::splat(2e-3 + 1e-5 * branch.length());
        assert!((below - slack).cmple(low).all() && (above + slack).cmpge(high).all(), "branch {k}");
        let ratio = (above - below) / (high - low);
        sums = [sums[0] + (ratio.x + ratio.y + ratio.z) / 3.0, sums[1] + ratio.x * ratio.y * ratio.z];
        count += 1.0;
    }
    sums.map(|s| s / count)
}
