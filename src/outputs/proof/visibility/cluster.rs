//! A cluster of leaves on a twig, the same in every run.

use crate::transport::leaf;
use glam::{DMat4, DQuat, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_transport::{ReferencePlacement, ReferenceWorld};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// Number of leaves, and of quads along and across each.
const LEAVES: usize = 30;
const QUADS: [usize; 2] = [24, 16];
/// Length and half width of a leaf before scaling, length of the twig, and distance from the twig at which a blade
/// begins (mm).
const LEAF: [f64; 2] = [62.0, 15.0];
const TWIG: f64 = 130.0;
const STALK: f64 = 12.0;

/// Edge length at which the cluster has about as many receivers as the source's (Wang et al. 2005, Table 1: 34,000 to
/// 60,000): 42,120.
pub(super) const EDGE_MM: f64 = 1.8;

/// Leaves that are folded along the midrib, bent and wavy, around an upright twig and a golden angle apart.
pub(crate) fn cluster() -> ReferenceWorld {
    let mut rng = Pcg64::seed_from_u64(5);
    let mut about = |middle: f64, spread: f64| middle + spread * (rng.random::<f64>() - 0.5);
    let golden = PI * (3.0 - 5f64.sqrt());
    let instances = (0..LEAVES).map(|k| {
        let turn = DQuat::from_rotation_z(about(golden * k as f64, 0.4))
            * DQuat::from_rotation_y(about(0.5, 0.3))
            * DQuat::from_rotation_x(about(0.0, 0.8));
        let up = TWIG * (k as f64 / (LEAVES - 1) as f64 - 0.5);
        let place = DVec3::Z * up + turn * DVec3::X * STALK;
        let size = DVec3::splat(about(1.0, 0.4));
        ReferencePlacement { leaf: 0, transform: DMat4::from_scale_rotation_translation(size, turn, place) }
    });
    ReferenceWorld {
        instances: instances.collect(),
        leaves: vec![leaf(blade(), 0.1, 0.1)],
        ..ReferenceWorld::default()
    }
}

fn blade() -> LeafMesh {
    let mut mesh = LeafMesh::default();
    let [along, across] = QUADS;
    for i in 0..=along {
        let u = i as f64 / along as f64;
        let share = (PI * (0.02 + 0.96 * u)).sin().powf(0.8);
        for j in 0..=across {
            let v = 2.0 * j as f64 / across as f64 - 1.0;
            let (x, y) = (LEAF[0] * u, LEAF[1] * share * v);
            let wave = 0.6 * (0.4 * x).sin() * (0.3 * y).cos();
            mesh.positions.push(DVec3::new(x, y, 0.25 * y.abs() - 0.003 * x * x + wave));
            mesh.normals.push(DVec3::Z);
            mesh.uvs.push(DVec2::new(u, 0.5 + 0.5 * share * v));
        }
    }
    let row = across as u32 + 1;
    for i in 0..along as u32 {
        for j in 0..across as u32 {
            let a = i * row + j;
            mesh.indices.extend([a, a + row, a + row + 1, a, a + row + 1, a + 1]);
        }
    }
    mesh
}
