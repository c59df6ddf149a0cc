//! Helpers of the tests: random scenes, and searches that use no boxes.

use glam::{DMat3, DMat4, DQuat, DVec3};
use mesophyll_base::processor::InstructionSet;
use mesophyll_transport::rays::{InstanceForest, Ray, RayHit, TriangleTree};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Decides which hits count. It is a function pointer and not a closure, because the searches are generic and would be
/// compiled again for every closure.
pub type Accept = fn(usize, usize, [f64; 2]) -> bool;

pub const EVERY: Accept = |_, _, _| true;

pub fn seeded(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// A random point of the cube from −reach to reach.
pub fn point(rng: &mut Pcg64, reach: f64) -> DVec3 {
    DVec3::new(rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5) * 2.0 * reach
}

/// A random rotation with a scale and a translation.
pub fn placement(rng: &mut Pcg64, reach: f64) -> DMat4 {
    let turn = DQuat::from_axis_angle(point(rng, 1.0).normalize(), 6.0 * rng.random::<f64>());
    DMat4::from_scale_rotation_translation(DVec3::splat(0.5 + rng.random::<f64>()), turn, point(rng, reach))
}

/// Separate triangles around the origin, as three positions for each.
pub fn soup(rng: &mut Pcg64, count: usize, reach: f64, size: f64) -> Vec<DVec3> {
    (0..count)
        .flat_map(|_| {
            let corner = point(rng, reach);
            [corner, corner + point(rng, size), corner + point(rng, size)]
        })
        .collect()
}

pub fn numbered(positions: &[DVec3]) -> Vec<u32> {
    (0..positions.len() as u32).collect()
}

/// One mesh of separate triangles, without a transform.
pub fn alone(positions: &[DVec3]) -> InstanceForest {
    InstanceForest::new(vec![TriangleTree::new(positions, &numbered(positions))], &[(0, DMat4::IDENTITY)])
}

/// The forest with every instruction set of this processor.
pub fn with_every_set(forest: &InstanceForest) -> Vec<InstanceForest> {
    InstructionSet::available().map(|set| forest.clone().with_instructions(set)).collect()
}

/// One mesh of separate triangles without a transform, with every instruction set of this processor. No triangle is
/// solid, then every second one, then all.
pub fn variants(positions: &[DVec3]) -> Vec<InstanceForest> {
    let solid: [fn(usize) -> bool; 3] = [|_| false, |k| k % 2 == 0, |_| true];
    let shape = |which: fn(usize) -> bool| TriangleTree::with_solid(positions, &numbered(positions), which);
    solid
        .into_iter()
        .flat_map(|which| with_every_set(&InstanceForest::new(vec![shape(which)], &[(0, DMat4::IDENTITY)])))
        .collect()
}

/// The first triangle by solving a 3×3 system for each of them, and its t.
pub fn by_solving(triangles: &[[DVec3; 3]], ray: &Ray) -> Option<(usize, f64)> {
    let mut best: Option<(usize, f64)> = None;
    for (k, [a, b, c]) in triangles.iter().enumerate() {
        let system = DMat3::from_cols(*b - *a, *c - *a, -ray.direction);
        let s = system.inverse() * (ray.origin - *a);
        if s.is_finite()
            && s.x >= 0.0
            && s.y >= 0.0
            && s.x + s.y <= 1.0
            && s.z > 0.0
            && best.is_none_or(|(_, t)| s.z < t)
        {
            best = Some((k, s.z));
        }
    }
    best
}

/// The f64 test of Woop, Benthin & Wald on one triangle after another, written without regard for speed.
pub fn one_by_one(triangles: &[[DVec3; 3]], ray: &Ray) -> Option<RayHit> {
    let d = ray.direction.to_array();
    let [x, y, z] = d.map(f64::abs);
    let kz = if x > y && x > z {
        0
    } else if y > z {
        1
    } else {
        2
    };
    let (kx, ky) = ((kz + 1) % 3, (kz + 2) % 3);
    let steep = 1.0 / d[kz];
    let mut best: Option<RayHit> = None;
    for (triangle, corners) in triangles.iter().enumerate() {
        let seen = corners.map(|p| {
            let p = (p - ray.origin).to_array();
            [p[kx] - d[kx] * steep * p[kz], p[ky] - d[ky] * steep * p[kz], p[kz]]
        });
        let area = |p: [f64; 3], q: [f64; 3]| {
            let (a, b) = (p[0] * q[1], p[1] * q[0]);
            let rest = if (a - b).abs() > 4e-16 * (a.abs() + b.abs()) {
                0.0
            } else {
                p[0].mul_add(q[1], -a) - p[1].mul_add(q[0], -b)
            };
            a - b + rest
        };
        let weight = [area(seen[2], seen[1]), area(seen[0], seen[2]), area(seen[1], seen[0])];
        let det = weight[0] + weight[1] + weight[2];
        if det == 0.0 || weight.iter().any(|w| *w < 0.0) && weight.iter().any(|w| *w > 0.0) {
            continue;
        }
        let inverse = 1.0 / det;
        let t = (0..3).map(|k| weight[k] * seen[k][2]).sum::<f64>() * inverse * steep;
        if t.is_finite() && t > 0.0 && best.is_none_or(|b| t < b.t) {
            best = Some(RayHit {
                t,
                instance: 0,
                triangle,
                barycentric: [weight[1] * inverse, weight[2] * inverse],
                place: None,
            });
        }
    }
    best
}
