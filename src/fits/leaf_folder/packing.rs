//! W's packing for a renderer: two RGBA textures a side, and normals in the blade's tangent frame. They are made from
//! the named maps whenever they are needed, and are not stored beside them.

use crate::leaf_folder::{LeafFit, LeafFitFile, Result, filling, frames};
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Side;
use std::path::Path;

/// Four numbers a texel.
pub type Rgba = Vec<[f32; 4]>;

/// γ a colour channel, and δ, the texel's thickness less the mean thickness h (mm).
///
/// # Errors
/// [`crate::leaf_folder::Error::Input`] naming `path` and the channel that is missing.
pub fn gamma_delta(path: &Path, maps: &ChannelMaps, thickness_mm: f64) -> Result<Rgba> {
    let [r, g, b] = maps.require_three(path, Quantity::Gamma)?;
    let thickness = maps.require_scalar(path, Quantity::Thickness)?;
    let delta = |t: f32| (f64::from(t) - thickness_mm) as f32;
    Ok((0..thickness.len()).map(|k| [r[k], g[k], b[k], delta(thickness[k])]).collect())
}

/// ρs a colour channel, and the roughness m.
///
/// # Errors
/// As [`gamma_delta`].
pub fn gloss(path: &Path, maps: &ChannelMaps) -> Result<Rgba> {
    let [r, g, b] = maps.require_three(path, Quantity::RhoS)?;
    let m = maps.require_scalar(path, Quantity::M)?;
    Ok((0..m.len()).map(|k| [r[k], g[k], b[k], m[k]]).collect())
}

/// Normals as the side's camera saw them.
///
/// # Errors
/// As [`gamma_delta`].
pub fn normals(path: &Path, maps: &ChannelMaps) -> Result<Vec<[f32; 3]>> {
    let [x, y, z] = maps.require_three(path, Quantity::Normal)?;
    Ok((0..x.len()).map(|k| [x[k], y[k], z[k]]).collect())
}

/// Normals in the tangent frame of `mesh`, which is the blade that was scanned.
///
/// # Errors
/// As [`gamma_delta`], and where the mesh covers no texel.
pub fn tangent_normals(path: &Path, maps: &ChannelMaps, side: Side, mesh: &LeafMesh) -> Result<Vec<[f32; 3]>> {
    let (width, height) = (maps.width, maps.height);
    let frames = frames::frames(path, mesh, width, height)?;
    let mut seen = [normals(path, maps)?];
    // A fit itself fills its maps beyond the good texels. Values that it left undetermined take those of their
    // neighbours.
    let known = |n: &[f32; 3]| n.iter().all(|v| v.is_finite()) && n.iter().map(|v| v * v).sum::<f32>() > 0.25;
    let good: Vec<bool> = seen[0].iter().map(known).collect();
    filling::require(path, &mut seen, &good, width, height)?;
    Ok(frames::tangent_space(&seen[0], &frames, width, side))
}

/// Normals in the tangent frame of the fit's own blade; as the camera saw them where the fit made no blade.
///
/// # Errors
/// As [`tangent_normals`], and for a blade that cannot be read.
pub fn blade_normals(leaf: &LeafFit, side: Side, maps: &ChannelMaps) -> Result<Vec<[f32; 3]>> {
    let path = leaf.path(LeafFitFile::Maps, side);
    match leaf.blade()? {
        Some(mesh) => tangent_normals(&path, maps, side, &mesh),
        None => normals(&path, maps),
    }
}
