//! A round crown of 2,000 leaves of 100 triangles, and three kinds of rays in it: from a camera, from the leaves that
//! it sees in all directions, and from there to the sun. It is seeded, and every number is an f32, so that all programs
//! get the same input.

use glam::{DMat4, DQuat, DVec3};
use mesophyll_transport::rays::{InstanceForest, Ray, TriangleTree};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{PI, TAU};

/// Number of leaves in the crown, and of quads along and across each leaf.
const LEAVES: usize = 2000;
const QUADS: [usize; 2] = [10, 5];
/// Radius of the crown, and length and half width of a leaf before scaling (mm).
const CROWN: f64 = 500.0;
const LEAF: [f64; 2] = [60.0, 15.0];
/// Where the camera stands (mm); it looks at the crown's middle.
pub(super) const EYE: DVec3 = DVec3::new(0.0, -1600.0, 300.0);
/// Width of the camera's picture at unit distance.
pub(super) const TANGENT: f64 = 0.62;
/// Pixels a side of the camera's picture.
const PIXELS: usize = 400;
/// Distance from a leaf at which rays start (mm); it is larger than the rounding of an f32 here.
const STEP: f64 = 0.02;
/// The sun's angular radius (rad).
const SUN: f64 = 0.0046;

/// The crown and its rays.
pub struct ProofFoliage {
    /// Corners of all leaves (mm).
    pub positions: Vec<DVec3>,
    /// Three indices for each triangle.
    pub indices: Vec<u32>,
    /// The crown as one mesh.
    pub forest: InstanceForest,
    /// Rays row by row through the pixels of a picture that the crown fills.
    pub camera: Vec<Ray>,
    /// From each place that the camera sees, in a direction that is uniform over the sphere.
    pub incoherent: Vec<Ray>,
    /// From each place that the camera sees, to a point of the sun's disk.
    pub shadow: Vec<Ray>,
}

/// The nearest point whose coordinates are f32.
fn single(p: DVec3) -> DVec3 {
    p.as_vec3().as_dvec3()
}

fn uniform(rng: &mut Pcg64) -> DVec3 {
    let z = 2.0 * rng.random::<f64>() - 1.0;
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

impl ProofFoliage {
    /// Makes the crown, which is always the same.
    pub fn new() -> ProofFoliage {
        let mut rng = Pcg64::seed_from_u64(7);
        let (mut positions, mut indices) = (Vec::new(), Vec::new());
        for _ in 0..LEAVES {
            leaf(&mut rng, &mut positions, &mut indices);
        }
        let forest = InstanceForest::new(
            vec![TriangleTree::with_solid(&positions, &indices, |_| true)],
            &[(0, DMat4::IDENTITY)],
        );
        let camera = camera();
        let sun = DVec3::new(0.4, -0.3, 0.86).normalize();
        let (mut incoherent, mut shadow) = (Vec::new(), Vec::new());
        for ray in &camera {
            let Some(hit) = forest.nearest(ray, |_, _, _| true) else { continue };
            let [a, b, c] = [0, 1, 2].map(|k| positions[indices[3 * hit.triangle + k] as usize]);
            let normal = (b - a).cross(c - a).normalize();
            let point = ray.origin + ray.direction * hit.t;
            let start = |direction: DVec3| {
                let side = STEP.copysign(normal.dot(direction));
                Ray::new(single(point + normal * side), single(direction))
            };
            incoherent.push(start(uniform(&mut rng)));
            shadow.push(start((sun + uniform(&mut rng) * SUN).normalize()));
        }
        ProofFoliage { positions, indices, forest, camera, incoherent, shadow }
    }
}

impl Default for ProofFoliage {
    fn default() -> Self {
        ProofFoliage::new()
    }
}

/// A curved and folded leaf, somewhere in the crown.
fn leaf(rng: &mut Pcg64, positions: &mut Vec<DVec3>, indices: &mut Vec<u32>) {
    let place = uniform(rng) * CROWN * rng.random::<f64>().cbrt();
    let turn = DQuat::from_rotation_arc(DVec3::Z, uniform(rng)) * DQuat::from_rotation_z(TAU * rng.random::<f64>());
    let size = 0.7 + 0.6 * rng.random::<f64>();
    let (curl, fold) = (0.3 * rng.random::<f64>(), 0.5 * rng.random::<f64>());
    let first = positions.len() as u32;
    let [along, across] = QUADS;
    for i in 0..=along {
        let u = i as f64 / along as f64;
        let half = LEAF[1] * (PI * (0.03 + 0.94 * u)).sin().powf(0.8);
        for j in 0..=across {
            let y = half * (2.0 * j as f64 / across as f64 - 1.0);
            let z = curl * LEAF[0] * (u - 0.5) * (u - 0.5) + fold * y.abs();
            positions.push(single(place + turn * (DVec3::new(LEAF[0] * (u - 0.5), y, z) * size)));
        }
    }
    let row = across as u32 + 1;
    for i in 0..along as u32 {
        for j in 0..across as u32 {
            let a = first + i * row + j;
            indices.extend([a, a + 1, a + row + 1, a, a + row + 1, a + row]);
        }
    }
}

fn camera() -> Vec<Ray> {
    let forward = -EYE.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let up = right.cross(forward);
    let at = |k: usize| TANGENT * ((k as f64 + 0.5) / PIXELS as f64 - 0.5);
    let ray = |i: usize, j: usize| Ray::new(EYE, single((forward + right * at(i) - up * at(j)).normalize()));
    (0..PIXELS).flat_map(|j| (0..PIXELS).map(move |i| ray(i, j))).collect()
}
