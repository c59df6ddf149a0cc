//! Surfaces that are the same everywhere, each with maps of one texel.

use super::lobe::Lobe;
use super::world::{ReferenceGloss, ReferenceInterior, ReferenceLeaf, ReferenceSide};
use mesophyll_files::mesh::LeafMesh;

/// Maps of one texel, for each channel.
fn one(of: [f64; 3]) -> [Vec<f32>; 3] {
    of.map(|v| vec![v as f32])
}

impl ReferenceGloss {
    /// A gloss that is the same everywhere.
    pub fn even(rho_s: [f64; 3], m: f64) -> ReferenceGloss {
        ReferenceGloss { rho_s: one(rho_s), m: vec![m as f32] }
    }
}

impl ReferenceSide {
    /// A side that is the same everywhere.
    pub fn even(rho_d: [f64; 3], rho_t: [f64; 3], gloss: Option<ReferenceGloss>) -> ReferenceSide {
        let interior = ReferenceInterior::Maps { rho_d: one(rho_d), rho_t: one(rho_t) };
        ReferenceSide { interior, gloss, normal: None }
    }

    /// A side that reflects and transmits nothing, with maps of so many texels.
    pub fn black(texels: usize) -> ReferenceSide {
        let none = || [0, 1, 2].map(|_| vec![0.0; texels]);
        ReferenceSide { interior: ReferenceInterior::Maps { rho_d: none(), rho_t: none() }, gloss: None, normal: None }
    }
}

impl ReferenceLeaf {
    /// A leaf whose sides are the same everywhere.
    pub fn even(mesh: LeafMesh, [front, back]: [ReferenceSide; 2], lobe: Lobe) -> ReferenceLeaf {
        ReferenceLeaf { mesh, width: 1, height: 1, front, back, mask: None, lobe }
    }

    /// Bark, ground or another matte surface that transmits nothing; its inside is black.
    pub fn opaque(mesh: LeafMesh, albedo: [f64; 3]) -> ReferenceLeaf {
        let front = ReferenceSide::even(albedo, [0.0; 3], None);
        ReferenceLeaf::even(mesh, [front, ReferenceSide::black(1)], Lobe::Beckmann)
    }
}
