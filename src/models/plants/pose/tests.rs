use super::*;
use crate::form::along;
use crate::growth::{grow, spec::PlantSpec};
use std::f64::consts::PI;
use std::path::Path;

/// The exact shape of an even beam. For other tapers, a shape with all four numbers, which need not be a real beam's
/// here.
fn shape(alpha: f64) -> TaperShape<f64> {
    if alpha == 1.0 {
        return TaperShape::new(1.0, [1.0 / PI, -2.0 / (3.0 * PI), 1.0 / (6.0 * PI), 0.0]);
    }
    TaperShape::new(alpha, [0.21, 0.11, 0.07, 0.05])
}

fn sapling() -> Plant {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/plants/bird-cherry-sapling.toml");
    grow(&PlantSpec::read(&path).unwrap(), None)
}

/// Amplitudes that move tips by `tip` of the length, each branch in another direction.
fn amplitudes(limbs: &RestPose, tip: f64) -> Vec<[f64; 2]> {
    let way = |k: usize| (0.7 + 1.3 * k as f64).sin_cos();
    limbs.0.iter().enumerate().map(|(k, l)| [way(k).0, way(k).1].map(|c| c * tip / l.shape.tip())).collect()
}

#[test]
fn without_a_bend_no_number_changes() {
    let plant = sapling();
    let limbs = RestPose::new(&plant, shape);
    assert_eq!(limbs.pose(|_| [0.0; 2]).plant(&plant), plant);
    assert_eq!(limbs.pose(|_| [f64::NAN, 1.0]).plant(&plant), plant);
    assert_eq!(limbs.pose(|_| [f64::INFINITY; 2]).plant(&plant), plant);
}

/// The turn of a bent beam over its own arc, from the beam's graph in many small steps.
fn turns(limb: &Limb, size: f64) -> Vec<(f64, f64)> {
    let s = &limb.shape;
    let place = |y: f64| if s.alpha == 1.0 { y } else { (s.alpha.powf(y) - 1.0) / (s.alpha - 1.0) };
    let rise = |y: f64| size * s.a.iter().enumerate().map(|(k, a)| a * y.powi(k as i32 + 2)).sum::<f64>();
    let (n, mut arc) = (8000, 0.0);
    (0..n)
        .map(|k| {
            let (a, b) = (f64::from(k) / f64::from(n), f64::from(k + 1) / f64::from(n));
            let (dx, dy) = (place(b) - place(a), rise(b) - rise(a));
            let middle = arc + 0.5 * dx.hypot(dy);
            arc += dx.hypot(dy);
            (middle, dy.atan2(dx))
        })
        .collect()
}

/// A branch as a chain of many small rigid pieces: the place at `at` after its own bend, and the rotation there.
fn chain(branch: &Branch, limb: &Limb, amplitude: [f64; 2], at: f64) -> (DVec3, DMat3) {
    let size = amplitude[0].hypot(amplitude[1]);
    let [t, r, s] = limb.axes;
    let e = (amplitude[0] * r + amplitude[1] * s) / size;
    let about = t.cross(e);
    let size = limited(size * limb.shape.tip(), FREELY, FURTHEST) / limb.shape.tip();
    let turns = turns(limb, size);
    let turn = |x: f64| {
        let k = turns.partition_point(|m| m.0 < x).clamp(1, turns.len() - 1);
        let ((a, p), (b, q)) = (turns[k - 1], turns[k]);
        DMat3::from_axis_angle(about, p + (q - p) * ((x - a) / (b - a)).clamp(0.0, 1.0))
    };
    let frame = branch.frame();
    let (mut place, steps) = (branch.root, 4000);
    let mut before = branch.root;
    for k in 0..steps {
        let [middle, end] = [0.5, 1.0].map(|h| at * (f64::from(k) + h) / f64::from(steps));
        let rest = frame.transform_point3(along(&branch.axis, end).0);
        place += turn(middle) * (rest - before);
        before = rest;
    }
    (place, turn(at))
}

/// Every branch of the sapling agrees with a chain of small pieces, where plain matrices place a child on its parent.
#[test]
fn a_pose_is_that_of_chains_of_small_rigid_pieces() {
    let plant = sapling();
    let limbs = RestPose::new(&plant, shape);
    for tip in [0.05, 0.4, 0.95] {
        let amplitudes = amplitudes(&limbs, tip);
        let pose = limbs.pose(|k| amplitudes[k]);
        let mut bases: Vec<DMat4> = Vec::new();
        let mut worst = 0.0f64;
        let section = |k: usize, at: f64, base: DMat4| {
            let (place, turn) = chain(&plant.branches[k], &limbs.0[k], amplitudes[k], at);
            let rest = plant.branches[k].point(at).0;
            base * DMat4::from_translation(place) * DMat4::from_mat3(turn) * DMat4::from_translation(-rest)
        };
        for (k, branch) in plant.branches.iter().enumerate() {
            let base = branch.parent.map_or(DMat4::IDENTITY, |j| section(j.branch, j.at, bases[j.branch]));
            bases.push(base);
            let tip = section(k, 1.0, base).transform_point3(branch.point(1.0).0);
            // The error of a chain also contains the errors of its parents' chains.
            worst = worst.max(tip.distance(pose.tip(k)) / plant.branches[0].length());
        }
        println!("tips by {tip}: {worst:.1e} of the trunk's length");
        assert!(worst < 2e-6, "{tip}: {worst}");
        for leaf in plant.leaves.iter().step_by(17) {
            let (k, at) = (leaf.joint.branch, leaf.joint.at);
            let want = section(k, at, bases[k]) * leaf.transform;
            assert!(want.abs_diff_eq(pose.at(k, at).carry(leaf.transform), 2e-2), "leaf on {k} at {at}");
        }
    }
}

/// In a storm that moves tips by nine tenths of their length, lengths are kept, and children stay on their parents.
#[test]
fn lengths_are_kept_and_children_stay_where_they_grew() {
    let mut plant = sapling();
    plant.branches[3].tip_radius = 0.0;
    plant.branches[5].tip_radius = plant.branches[5].root_radius;
    let limbs = RestPose::new(&plant, shape);
    for size in [0.1, 0.9, 30.0] {
        let amplitudes = amplitudes(&limbs, size);
        let posed = limbs.pose(|k| amplitudes[k]).plant(&plant);
        for (rest, now) in plant.branches.iter().zip(&posed.branches) {
            assert!((now.length() / rest.length() - 1.0).abs() < 2e-6, "{size} {}: {}", rest.name, now.length());
            let tip = now.chord().distance(rest.chord().length() * now.axes[0]);
            assert!(tip > 0.0 && tip.is_finite());
            if let Some(joint) = rest.parent {
                let gap = |plant: &Plant, b: &Branch| plant.branches[joint.branch].point(joint.at).0.distance(b.root);
                let limit = 1e-3 * plant.branches[joint.branch].radius(joint.at);
                assert!((gap(&posed, now) - gap(&plant, rest)).abs() < limit, "{size} {}", rest.name);
            }
            // Rings stay rings: the bark keeps its distance from the axis.
            for (p, q) in rest.wood.positions.iter().zip(&now.wood.positions).step_by(7) {
                let [before, after] = [(&rest.axis, p), (&now.axis, q)].map(|(axis, p)| nearest(axis, *p).1);
                assert!(
                    (before - after).abs() < 0.02 * rest.root_radius + 1e-9,
                    "{size} {}: {before} {after}",
                    rest.name
                );
            }
        }
    }
}

#[test]
fn a_branch_without_length_and_thin_and_even_tapers_have_a_pose() {
    let mut plant = sapling();
    let trunk = &plant.branches[0];
    let stump = Branch {
        name: "stump".into(),
        parent: Some(crate::form::Joint { branch: 0, at: 0.5 }),
        root: trunk.point(0.5).0,
        axis: vec![DVec3::ZERO; 2],
        wood: Default::default(),
        ..trunk.clone()
    };
    plant.branches.push(stump);
    let limbs = RestPose::new(&plant, shape);
    let posed = limbs.pose(|_| [1.0, 0.5]);
    let (last, on) = (plant.branches.len() - 1, posed.at(0, 0.5));
    assert!(posed.tip(last).distance(on.place(plant.branches[last].root)) < 1e-9);
    // The chord of a bent trunk moves as far as requested, less the part that keeping the length takes.
    let [t, r, s] = limbs.0[0].axes;
    let small = limbs.pose(|k| if k == 0 { [1e-3 / limbs.0[0].tip, 0.0] } else { [0.0; 2] });
    let moved = small.tip(0) - plant.branches[0].point(1.0).0;
    assert!((moved.dot(r) / (1e-3 * limbs.0[0].length) - 1.0).abs() < 1e-3, "{}", moved.dot(r));
    assert!(moved.dot(s).abs() < 1e-3 * moved.dot(r) && moved.dot(t).abs() < 0.05 * moved.dot(r));
}

/// Of the vertices that stand in a ring, one section carries all, except where the branch is thick and bent.
#[test]
fn a_ring_of_bark_has_one_section() {
    let plant = sapling();
    let (mut rings, mut sections) = (0, 0);
    for branch in &plant.branches {
        let own = bark::BarkCarriers::new(branch);
        let mut at: Vec<u64> = own.at.iter().map(|at| at.to_bits()).collect();
        at.sort_unstable();
        at.dedup();
        assert_eq!(at.len(), own.at.len(), "{}: a section twice", branch.name);
        for (vertex, section) in branch.wood.positions.iter().zip(&own.of_vertices) {
            let off = nearest(&branch.axis, *vertex).0 - own.at[*section as usize];
            assert!(off.abs() <= 1.0 / 1024.0, "{}: {off}", branch.name);
        }
        let mut along: Vec<u64> = branch.wood.uvs.iter().map(|uv| uv.y.to_bits()).collect();
        along.sort_unstable();
        along.dedup();
        rings += along.len();
        sections += own.at.len();
    }
    println!("{sections} sections for {rings} rings");
    assert!(rings > 200 && sections >= rings && sections < rings + rings / 5, "{sections} sections, {rings} rings");
}
