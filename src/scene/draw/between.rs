//! Light between leaves on its way to the renderer: the rows of a transfer, and what vertices see of the sun. Meshes
//! and instances stand in the order of the transfer's.

use crate::Result;
use glam::{DVec3, Vec3};
use mesophyll_fit_transfer::Transfer;
use mesophyll_transport::ReferenceMesh;
use mesophyll_transport::transfer::Columns;
use mesophyll_viewer::scene as viewer;
use std::sync::Arc;

/// What arrives at the anchors.
pub fn arriving(found: &Transfer, out: &mut viewer::Scene) {
    for (mesh, of) in out.meshes.iter_mut().zip(&found.layout.leaves) {
        mesh.anchors = Some(viewer::Anchors {
            grid: of.anchors.grid.map(|n| n as u32),
            places: of.anchors.places.iter().map(|p| Vec3::from(*p)).collect(),
            rows: of.rows.count() as u32,
        });
    }
    for (instance, first) in out.instances.iter_mut().zip(&found.layout.first) {
        instance.first_row = *first as u32;
    }
    let bands = match found.columns {
        Columns::Harmonics(bands) => Some(bands),
        Columns::Light => None,
    };
    out.transfer = Some(viewer::Transfer {
        bands,
        gloss_bands: found.gloss_bands,
        scale: found.scale,
        entries: found.entries.clone(),
    });
}

/// The share of the sun that vertices see where it stands in this direction, where the transfer knows it; on the ground
/// there are shadow maps.
///
/// # Errors
/// [`Error::Usage`] for maps that cannot be decoded.
pub fn shade(found: &Transfer, towards_sun: DVec3, out: &mut viewer::Scene) -> Result<()> {
    let Some(sun) = &found.sun else { return Ok(()) };
    for (k, instance) in out.instances.iter_mut().enumerate().filter(|(k, _)| Some(*k) != found.layout.ground) {
        instance.first_share = Some(sun.receivers.of(k).start as u32);
    }
    out.sun_shares = Some(Arc::new(sun.shares(towards_sun)?));
    Ok(())
}

/// A mesh of the transfer's in the renderer's precision.
pub fn mesh(mesh: &ReferenceMesh) -> viewer::Mesh {
    viewer::Mesh {
        positions: mesh.positions.iter().map(|p| p.as_vec3()).collect(),
        normals: mesh.normals.iter().map(|p| p.as_vec3()).collect(),
        tangents: mesh.tangents.iter().map(|t| t.as_vec4()).collect(),
        uvs: mesh.uvs.iter().map(|p| p.as_vec2()).collect(),
        indices: mesh.indices.clone(),
        details: Vec::new(),
        anchors: None,
    }
}
