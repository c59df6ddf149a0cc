//! The true leaves of a scene whose scans are synthetic. In the reference's world, ρd, ρt, ρs, m and normals come from
//! the scan's `truth/` instead of the fit, and everything else (mesh, placement, light) is unchanged. Comparing its
//! picture with the picture from the fit shows the error of the fit.

use crate::loaded::LoadedScene;
use crate::manifest::FitOrigin;
use crate::{Error, Result};
use mesophyll_capture::truth_path;
use mesophyll_files::image::{ChannelMaps, read_exr};
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{filling, packing};
use mesophyll_optics::side::Side;
use mesophyll_transport::{self as transport, NormalFrame};
use std::path::Path;

/// Puts the true maps of every leaf that has some into `world`, which [`super::reference::world`] made. Returns the
/// names of these leaves. Translucency maps have no such truth, so their light stays that of the fit.
///
/// # Errors
/// [`Error::Input`] for a truth that exists and cannot be read.
pub fn replace(world: &mut transport::ReferenceWorld, scene: &LoadedScene, out: &Path) -> Result<Vec<String>> {
    let manifest = &scene.manifest;
    let mut names = Vec::new();
    for (k, leaf) in scene.drawn().enumerate() {
        let config = leaf.config;
        let capture = match config.fit() {
            Some(FitOrigin { capture: Some(capture), .. }) => manifest.resolve(capture),
            Some(FitOrigin { scan: Some(_), .. }) => out.join("captures").join(config.data_name()),
            _ => continue,
        };
        let (Some(mesh), Some(drawn)) = (&leaf.placed.mesh, world.leaves.get_mut(k)) else { continue };
        let mut replaced = false;
        for side in Side::ALL.into_iter().filter(|side| leaf.plan.needs(*side).any()) {
            // What stands for a side is no measurement that a truth could be held against.
            if leaf.placed.fitted.as_ref().and_then(|fit| fit.unmeasured()).is_some_and(|(own, _)| own == side) {
                continue;
            }
            let path = truth_path(&capture, side);
            let Some(truth) = open(&path, drawn)? else { continue };
            let place = if side == Side::Front { &mut drawn.front } else { &mut drawn.back };
            if leaf.plan.needs(side).interior() {
                place.interior = transport::ReferenceInterior::Maps {
                    rho_d: three(&truth, &path, Quantity::RhoD)?,
                    rho_t: three(&truth, &path, Quantity::RhoT)?,
                };
            }
            if let Some(gloss) = &mut place.gloss {
                *gloss = transport::ReferenceGloss {
                    rho_s: three(&truth, &path, Quantity::RhoS)?,
                    m: planes(&truth, &path, Quantity::M)?.remove(0),
                };
            }
            if let Some(normal) = place.normal.as_mut().filter(|n| n.frame == NormalFrame::Tangent) {
                normal.values = packing::tangent_normals(&path, &truth, side, mesh)?;
            }
            replaced = true;
        }
        if replaced {
            names.push(config.name.clone());
        }
    }
    Ok(names)
}

/// The truth of a side, where there is one with the size of the drawn maps.
fn open(path: &Path, drawn: &transport::ReferenceLeaf) -> Result<Option<ChannelMaps>> {
    if !path.is_file() {
        return Ok(None);
    }
    Ok(Some(read_exr(path)?).filter(|t| (t.width, t.height) == (drawn.width, drawn.height)))
}

fn three(truth: &ChannelMaps, path: &Path, quantity: Quantity) -> Result<[Vec<f32>; 3]> {
    let found = planes(truth, path, quantity)?;
    found.try_into().map_err(|_| Error::input(path, "expected three channels"))
}

/// Channels, which are filled beyond the leaf like those of a fit.
fn planes(truth: &ChannelMaps, path: &Path, quantity: Quantity) -> Result<Vec<Vec<f32>>> {
    let mut found = truth.require_planes(path, &[quantity])?;
    let mask = truth.scalar(Quantity::Mask);
    let good: Vec<bool> = (0..found[0].len())
        .map(|k| mask.is_none_or(|m| m[k] != 0.0) && found.iter().all(|p| p[k].is_finite()))
        .collect();
    filling::require(path, &mut found, &good, truth.width, truth.height)?;
    Ok(found)
}
