//! Leaves and worlds for tests.

use crate::lobe::Lobe;
use crate::world::{ReferenceGloss, ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceWorld};
use glam::{DMat4, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;

/// A level square of this half width at height 0, with its front up.
pub fn square(reach: f64) -> LeafMesh {
    let at = |x: f64, y: f64| DVec3::new(x * reach, y * reach, 0.0);
    LeafMesh {
        positions: vec![at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)],
        normals: vec![DVec3::Z; 4],
        tangents: Vec::new(),
        uvs: vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y],
        indices: vec![0, 1, 2, 0, 2, 3],
        discs: false,
    }
}

/// A side that is the same everywhere. Gloss is given by its ρs and m.
pub fn side(rho_d: f64, rho_t: f64, gloss: Option<(f64, f64)>) -> ReferenceSide {
    let gloss = gloss.map(|(rho_s, m)| ReferenceGloss::even([rho_s; 3], m));
    ReferenceSide::even([rho_d; 3], [rho_t; 3], gloss)
}

/// A leaf that is the same everywhere, with ρd of its two sides.
pub fn leaf(mesh: LeafMesh, rho_d: [f64; 2], rho_t: f64, gloss: Option<(f64, f64)>) -> ReferenceLeaf {
    ReferenceLeaf::even(mesh, rho_d.map(|rho_d| side(rho_d, rho_t, gloss)), Lobe::Beckmann)
}

/// Squares of half width `reach`, each with its height, the ρd of its two sides, and its ρt.
pub fn plates(reach: f64, of: &[(f64, [f64; 2], f64)]) -> ReferenceWorld {
    ReferenceWorld {
        leaves: of.iter().map(|(_, rho_d, rho_t)| leaf(square(reach), *rho_d, *rho_t, None)).collect(),
        instances: of
            .iter()
            .enumerate()
            .map(|(k, (z, ..))| ReferencePlacement { leaf: k, transform: DMat4::from_translation(DVec3::Z * *z) })
            .collect(),
        ..ReferenceWorld::default()
    }
}
