//! Leaves along the shoots, with their fronts towards the sky.

use super::spec::{self, FoliageSpec, PlantSpec};
use super::{Chance, shares, side};
use crate::form::{Blade, Joint, Leaf, Plant};
use glam::{DMat3, DMat4, DQuat, DVec2, DVec3};
use mesophyll_files::mesh::{LeafMesh, vertex_normals, vertex_tangents};
use std::f64::consts::PI;

/// Hangs `leaves.count` leaves on the last orders of a plant.
pub fn grow(spec: &PlantSpec, leaves: &FoliageSpec, plant: &mut Plant, chance: &mut Chance) {
    let first = spec.levels.len().saturating_sub(leaves.levels);
    let bearing: Vec<usize> = (0..plant.branches.len()).filter(|k| plant.branches[*k].level >= first).collect();
    let weights: Vec<f64> = bearing.iter().map(|k| plant.branches[*k].length()).collect();
    let mut out = Vec::with_capacity(leaves.count);
    for (branch, count) in bearing.into_iter().zip(shares(leaves.count, &weights)) {
        let shoot = &plant.branches[branch];
        let turned = PI * chance.stray();
        for k in 0..count {
            let at = leaves.bare + (1.0 - leaves.bare) * (k + 1) as f64 / count as f64;
            let (place, t) = shoot.point(at);
            let across = side(leaves.arrangement, t, k, turned);
            // The last leaf stands on the tip of the shoot.
            let spread = leaves.spread_deg.to_radians();
            let angle =
                if k + 1 == count { 0.35 } else { 1.0 } * leaves.angle_deg.to_radians() + 0.5 * spread * chance.stray();
            let out_of = t * angle.cos() + across * angle.sin();
            let droop = leaves.droop_deg.to_radians() + spread * chance.stray();
            let hinge = DVec3::Z.cross(out_of).try_normalize().unwrap_or_else(|| out_of.any_orthonormal_vector());
            let x = (DQuat::from_axis_angle(hinge, droop) * out_of).normalize();
            let up = (DVec3::Z - x * x.z).try_normalize().unwrap_or_else(|| x.any_orthonormal_vector());
            let z = DQuat::from_axis_angle(x, spread * chance.stray()) * up;
            let size = 1.0 + leaves.size_spread * chance.stray();
            let stalk = shoot.radius(at) + leaves.petiole_mm * size;
            let middle = place + out_of * stalk + x * (0.5 * leaves.length_mm * size);
            let turn = DMat3::from_cols(x, z.cross(x), z) * size;
            out.push(Leaf {
                blade: 0,
                joint: Joint { branch, at },
                transform: DMat4::from_translation(middle) * DMat4::from_mat3(turn),
            });
        }
    }
    plant.leaves = out;
    plant.blades = vec![Blade { material: leaves.material.clone(), mesh: blade(leaves) }];
}

/// A flat blade with its tip along +x and its front up, with two corners at every place of its profile.
fn blade(leaves: &FoliageSpec) -> LeafMesh {
    let rectangle = [[0.0, 1.0], [1.0, 1.0]];
    let profile: &[[f64; 2]] = if leaves.profile.len() >= 2 { &leaves.profile } else { &rectangle };
    let mut mesh = LeafMesh::default();
    for [x, _] in profile {
        // A width of 0 would make a triangle without an area.
        let half = 0.5 * leaves.width_mm * spec::at(profile, *x).max(0.01);
        for sign in [-1.0, 1.0] {
            mesh.positions.push(DVec3::new((x - 0.5) * leaves.length_mm, sign * half, 0.0));
            mesh.uvs.push(DVec2::new(*x, 0.5 - sign * half / leaves.width_mm));
        }
    }
    for k in 0..profile.len() as u32 - 1 {
        let a = 2 * k;
        mesh.indices.extend([a, a + 2, a + 1, a + 2, a + 3, a + 1]);
    }
    mesh.normals = vertex_normals(&mesh);
    mesh.tangents = vertex_tangents(&mesh);
    mesh
}
