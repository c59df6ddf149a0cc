//! The data of one leaf: W's textures, slab curves and translucency coefficients, as far as the plan needs them.

use super::curve::{ResponseCurve, curve};
use super::map_levels::map_levels;
use super::translucency;
use super::{LeafData, LoadedTextures, Stand, gloss};
use crate::Result;
use crate::manifest::InteriorSource;
use crate::placed::fits::reader;
use crate::placed::ledger::Ledger;
use crate::placed::{self as placed, daylight};
use crate::plan::LeafPlan;
use crate::plan::accuracy::AccuracyRow;
use crate::plan::findings::{GlossFinding, LeafFindings, MapDetail};
use crate::plan::leaf::{TEXEL_BYTES, curve_name};
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile, filling, packing};
use mesophyll_optics::side::Side;
use mesophyll_transport::tone::display;
use std::path::Path;

/// Reads the needed textures of a leaf whose fit exists. Also returns what they told.
pub(super) fn load(at: Stand, leaf: &placed::leaf::PlacedLeaf, mut plan: LeafPlan) -> Result<(LeafData, LeafFindings)> {
    let (mut out, mut found) = (LeafData::default(), LeafFindings::default());
    let Some(fitted) = &leaf.fitted else { return Ok((out, found)) };
    let (manifest, config) = (at.manifest, &at.manifest.leaves[leaf.index]);
    for side in Side::ALL {
        let needs = plan.needs(side);
        let told = &mut found.sides[side];
        if leaf.interior(config) == InteriorSource::Scalars && needs.interior() {
            plan.size = read_gamma_delta(fitted, side, plan.size, &mut out, at.ledger)?;
        }
        if needs.any() && plan.size == [0, 0] {
            let info = fitted.info(side)?;
            plan.size = [info.width, info.height];
        }
        if let Some(texels) = &out.textures[side].gamma_delta {
            // A tenth of the tolerance for one shortcut, and at most a ten-thousandth.
            let allowed = (manifest.tolerated() / 10.0).min(1e-4);
            let (made, rows) = of_side(fitted, side, texels, allowed, &curve_name(fitted, side), at.ledger)?;
            told.curve = Some(rows);
            out.curves[side] = Some(made);
        }
        if needs.gloss {
            told.gloss = Some(read_gloss(at, leaf, fitted, side, &mut out, &mut plan)?);
        }
        if plan.reads_translucency(leaf, side) {
            told.translucency = translucency::read_side(at, leaf, side, &mut out, &plan)?;
        }
        if let Some(loss) = &told.translucency {
            plan.maps_show(manifest, side, loss, at.placed.free);
        }
        told.size = plan.size;
    }
    resolution(at, leaf, &out, &plan, &mut found);
    Ok((out, found))
}

fn read_gamma_delta(
    fitted: &LeafFit,
    side: Side,
    known: [usize; 2],
    out: &mut LeafData,
    ledger: &Ledger,
) -> Result<[usize; 2]> {
    let maps = reader::maps(fitted, side, ledger)?;
    let (path, thickness) = (fitted.path(LeafFitFile::Maps, side), fitted.thickness(side)?);
    let h = thickness as f32;
    // γ and thickness of a texel on the leaf are positive.
    let known_texel = |t: &[f32; 4]| t[0] > 0.0 && t[1] > 0.0 && t[2] > 0.0 && h + t[3] > 0.0;
    let texels = packing::gamma_delta(&path, maps, thickness)?;
    let (texels, good) = without_holes(&path, maps, texels, known_texel)?;
    out.textures[side] = LoadedTextures { gamma_delta: Some(texels), gloss: None, good };
    reader::same_size(fitted, side, known, [maps.width, maps.height])
}

/// The slab curve over the range of thicknesses of a side's texels.
fn of_side(
    fitted: &LeafFit,
    side: Side,
    texels: &[[f32; 4]],
    allowed: f64,
    what: &str,
    ledger: &Ledger,
) -> Result<(ResponseCurve, Vec<AccuracyRow>)> {
    let h = fitted.thickness(side)?;
    let (low, high) =
        texels.iter().fold((f64::INFINITY, 0f64), |(a, b), t| (a.min(h + f64::from(t[3])), b.max(h + f64::from(t[3]))));
    Ok(curve(
        fitted.rgb(side, Quantity::SigmaA)?,
        fitted.rgb(side, Quantity::SigmaS)?,
        [low, high],
        allowed,
        what,
        ledger,
    ))
}

/// Reads a side's gloss, keeps it where it is visible, and says what it adds to a picture.
fn read_gloss(
    at: Stand,
    leaf: &placed::leaf::PlacedLeaf,
    fitted: &LeafFit,
    side: Side,
    out: &mut LeafData,
    plan: &mut LeafPlan,
) -> Result<GlossFinding> {
    let maps = reader::maps(fitted, side, at.ledger)?;
    let path = fitted.path(LeafFitFile::Maps, side);
    let (texels, _) = without_holes(&path, maps, packing::gloss(&path, maps)?, |t| t[3] > 0.0)?;
    plan.size = reader::same_size(fitted, side, plan.size, [maps.width, maps.height])?;
    let found = if texels.iter().all(|t| t[..3].iter().all(|v| *v <= 0.0)) {
        GlossFinding::Matte
    } else {
        GlossFinding::AtMost(gloss::most(at, at.leaf(leaf, out, plan), side, &texels, fitted)?)
    };
    if plan.gloss_shows(at.manifest, side, found) {
        out.textures[side].gloss = Some(texels);
    }
    Ok(found)
}

/// A texture whose numbers are filled wherever they are not finite or `good` does not hold, and which texels the fit
/// knew.
fn without_holes(
    path: &Path,
    maps: &ChannelMaps,
    texels: packing::Rgba,
    good: impl Fn(&[f32; 4]) -> bool,
) -> Result<(packing::Rgba, Vec<bool>)> {
    let known: Vec<bool> = texels.iter().map(|t| t.iter().all(|v| v.is_finite()) && good(t)).collect();
    let mut planes = [texels];
    filling::require(path, &mut planes, &known, maps.width, maps.height)?;
    let [texels] = planes;
    Ok((texels, known))
}

/// Measures how coarse the maps may be for the footprint of the nearest pixel.
fn resolution(
    at: Stand,
    leaf: &placed::leaf::PlacedLeaf,
    loaded: &LeafData,
    plan: &LeafPlan,
    found: &mut LeafFindings,
) {
    let Stand { manifest, placed, .. } = at;
    let index = leaf.index;
    let (Some(mesh), Some(fitted)) = (&leaf.mesh, &leaf.fitted) else { return };
    let size = plan.size;
    if size == [0, 0] {
        return;
    }
    let (mut area, mut area_uv) = (0.0, 0.0);
    for t in 0..mesh.triangles() {
        let [a, b, c] = mesh.triangle(t);
        area += (mesh.positions[b] - mesh.positions[a]).cross(mesh.positions[c] - mesh.positions[a]).length();
        area_uv += (mesh.uvs[b] - mesh.uvs[a]).perp_dot(mesh.uvs[c] - mesh.uvs[a]).abs();
    }
    let texel_mm = (area / (area_uv * (size[0] * size[1]) as f64)).sqrt();
    let (centre, radius) = mesh.bounds();
    let mut footprint = f64::INFINITY;
    for p in placed.placements.iter().filter(|p| p.leaf == index) {
        for view in manifest.perspectives() {
            let at = placed.at_time(p, manifest.time_of(view)).transform;
            let (scale, centre) = (at.x_axis.truncate().length(), at.transform_point3(centre));
            let nearest = (view.camera.eye.distance(centre) - radius * scale).max(1e-3);
            let pixel_mm = 2.0 * view.camera.half_height() * nearest / f64::from(manifest.check.height);
            footprint = footprint.min(pixel_mm / (texel_mm * scale));
        }
    }
    if !footprint.is_finite() || footprint <= 0.0 {
        return;
    }
    // The largest light that reaches a surface: E/π and the sky's radiance.
    let mean = |c: [f64; 3]| c.iter().sum::<f64>() / 3.0;
    let (sun, sky) = daylight::levels(manifest);
    let power = mean(sun) / std::f64::consts::PI + mean(sky);
    found.footprint = Some(footprint);
    for (side, told) in found.sides.iter_mut() {
        told.translucency_detail = translucency::detail(at, at.leaf(leaf, loaded, plan), side, footprint);
        let (Some(texels), Some(curve)) = (&loaded.textures[side].gamma_delta, &loaded.curves[side]) else { continue };
        let Ok(h) = fitted.thickness(side) else { continue };
        let value: Vec<f32> = texels
            .iter()
            .map(|t| {
                let (rho_d, rho_t) = curve.at(h + f64::from(t[3]));
                let rho = if plan.needs(side).rho_d { f64::from(t[1]) * rho_d[1] } else { rho_t[1] };
                display(rho * power, manifest.exposure) as f32
            })
            .collect();
        let good = &loaded.textures[side].good;
        let rows = map_levels(&value, size[0], size[1], |k| good[k], footprint, TEXEL_BYTES);
        // Sampling at a pixel's centre has an error itself. A coarser map may add only a part of the scene's tolerance
        // to it.
        let allowed = rows.first().map_or(0.0, |r| r.error) + manifest.tolerated() / 4.0;
        told.detail = Some(MapDetail { rows, allowed });
    }
}
