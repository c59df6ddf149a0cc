//! Translucency maps of a scene's leaf: the data that are read, and their effect on a picture.
//!
//! A folder of `fit translucency` holds `front.exr` and `back.exr`, for light that enters that side. They have the
//! columns of that side's camera, and the size of the leaf's other maps. The channels `translucency.1` to `.3` are
//! coefficients of f for the Half-Life 2 functions (straight or bent). Or `translucency.R1` to `.B3` are those of M =
//! ρt·f for each colour. Directions are in the lit side's tangent frame.

use super::map_levels::map_levels;
use super::{LeafData, LoadedLeaf, Stand};
use crate::manifest::TranslucencyBasis;
use crate::placed;
use crate::placed::daylight::{levels, sun_direction};
use crate::placed::fits::reader;
use crate::placed::ledger::Ledger;
use crate::plan::LeafPlan;
use crate::plan::findings::{MapDetail, MapLoss};
use crate::plan::leaf::TRANSLUCENCY_TEXEL_BYTES;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use mesophyll_base::statistics::quantile;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::frames;
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile, filling};
use mesophyll_optics::side::Side;
use mesophyll_optics::translucency::basis;
use mesophyll_optics::translucency::basis::HemisphereBasis as Functions;
use mesophyll_transport::tone::display;
use rayon::prelude::*;
use std::f64::consts::PI;

/// The largest number of placements whose light is evaluated.
const PLACEMENTS: usize = 48;

/// Three coefficients for each texel, and their functions.
#[derive(Debug, Clone, PartialEq)]
pub struct TranslucencyCoefficients {
    /// The basis of functions.
    pub basis: TranslucencyBasis,
    /// The coefficients for these functions.
    pub of: TranslucencyQuantity,
}

/// The quantity that the coefficients describe. A list has an entry for each texel.
#[derive(Debug, Clone, PartialEq)]
pub enum TranslucencyQuantity {
    /// The factor f.
    Factor(Vec<[f32; 3]>),
    /// M for each channel.
    Colour([Vec<[f32; 3]>; 3]),
}

impl TranslucencyCoefficients {
    /// Σ h_i φ_i(ω), which may be negative. Renderers interpolate first, and limit to 0 afterwards.
    pub fn sum(&self, h: [f32; 3], omega: DVec3) -> f64 {
        let at = Functions::from(self.basis).argument(omega.to_array());
        DVec3::from(basis::vector(h.map(f64::from))).dot(DVec3::from(at))
    }

    /// The transmitted light at texel `k` for each channel, where `rho_t` is ρt there.
    fn through(&self, k: usize, omega: DVec3, rho_t: [f64; 3]) -> [f64; 3] {
        match &self.of {
            TranslucencyQuantity::Factor(map) => {
                let f = self.sum(map[k], omega).max(0.0);
                rho_t.map(|r| r * f)
            }
            TranslucencyQuantity::Colour(maps) => [0, 1, 2].map(|c| self.sum(maps[c][k], omega).max(0.0)),
        }
    }
}

/// Reads the coefficients of one side. Returns what a picture would lose without them.
///
/// # Errors
/// [`Error::Input`] for a map that is missing, damaged or of another size.
pub(super) fn read_side(
    at: Stand,
    leaf: &placed::leaf::PlacedLeaf,
    side: Side,
    out: &mut LeafData,
    plan: &LeafPlan,
) -> Result<Option<MapLoss>> {
    let Some(maps) = leaf.translucent.as_ref().and_then(|t| t.fitted.as_ref()) else { return Ok(None) };
    let now = at.leaf(leaf, out, plan);
    let read = read(now, side, maps, at.ledger)?;
    let cost = cost(at, now, side, &read)?;
    out.coefficients[side] = Some(read);
    Ok(Some(cost))
}

/// Coefficients of one side, filled beyond the outline.
fn read(leaf: LoadedLeaf, side: Side, fitted: &LeafFit, ledger: &Ledger) -> Result<TranslucencyCoefficients> {
    let path = fitted.path(LeafFitFile::Maps, side);
    let maps = reader::maps(fitted, side, ledger)?;
    reader::same_size(fitted, side, leaf.plan.size, [maps.width, maps.height])?;
    let basis = match fitted.record.options.get("basis") {
        None => TranslucencyBasis::default(),
        Some(said) => Functions::named(said).and_then(Functions::drawn).ok_or_else(|| {
            let known = TranslucencyBasis::ALL.map(|b| format!("\"{}\"", Functions::from(b).name())).join(" or ");
            let what = format!("found \"{said}\", expected {known}, which the renderers evaluate");
            Error::field(&fitted.record_path(), "options.basis", what)
        })?,
    };
    let colour = maps.get("translucency.R1").is_some();
    let names: Vec<String> = if colour {
        ["R", "G", "B"].iter().flat_map(|c| (1..=3).map(move |i| format!("translucency.{c}{i}"))).collect()
    } else {
        (1..=3).map(|i| format!("translucency.{i}")).collect()
    };
    let mut planes: Vec<Vec<f32>> =
        names.iter().map(|n| maps.require(&path, n).map(<[f32]>::to_vec)).collect::<Result<_>>()?;
    let on_leaf = on_leaf(leaf, side);
    let good: Vec<bool> =
        on_leaf.iter().enumerate().map(|(k, on)| *on && planes.iter().all(|p| p[k].is_finite())).collect();
    filling::require(&path, &mut planes, &good, leaf.plan.size[0], leaf.plan.size[1])?;
    let three = |first: usize| {
        (0..good.len()).map(|k| [planes[first][k], planes[first + 1][k], planes[first + 2][k]]).collect()
    };
    let of = if colour {
        TranslucencyQuantity::Colour([three(0), three(3), three(6)])
    } else {
        TranslucencyQuantity::Factor(three(0))
    };
    Ok(TranslucencyCoefficients { basis, of })
}

/// Whether each texel of a side's maps is on the blade.
fn on_leaf(leaf: LoadedLeaf, side: Side) -> Vec<bool> {
    let [w, h] = leaf.plan.size;
    if leaf.loaded.textures[side].good.len() == w * h {
        return leaf.loaded.textures[side].good.clone();
    }
    let Some(mesh) = &leaf.placed.mesh else { return vec![true; w * h] };
    let front = frames::covered(mesh, w, h);
    (0..w * h).map(|k| front[side.in_front(k, w)]).collect()
}

/// Compares the light by the maps with the light by ρt and the mapped normal, for each texel and channel, and for the
/// suns that the scene's placements see. First only some suns are compared, and all of them where those would not need
/// the maps.
fn cost(at: Stand, leaf: LoadedLeaf, side: Side, maps: &TranslucencyCoefficients) -> Result<MapLoss> {
    let Stand { manifest, ledger, .. } = at;
    let layers = if matches!(maps.of, TranslucencyQuantity::Colour(_)) { 3 } else { 1 };
    let none = MapLoss { p99: 0.0, largest: 0.0, layers, basis: Functions::from(maps.basis).name() };
    let (Some(mesh), Some(fitted)) = (&leaf.placed.mesh, &leaf.placed.fitted) else { return Ok(none) };
    let [w, h] = leaf.plan.size;
    let normals = reader::normals(fitted, side, ledger)?;
    let rho_t = transmittance(leaf, side, fitted, ledger)?;
    let frames = frames::frames(&leaf.placed.mesh_path, mesh, w, h)?;
    let on_leaf = on_leaf(leaf, side);
    let suns = suns(at, leaf);
    let out = if side == Side::Front { 1.0 } else { -1.0 };
    let error = |k: usize, sun: DVec3, level: [f64; 3]| {
        let [t, b, n] = frames[side.in_front(k, w)];
        let omega = DVec3::new(out * t.dot(sun), b.dot(sun), out * n.dot(sun));
        let normal = DVec3::from(normals[k].map(f64::from));
        if omega.z <= 0.0 || !normal.is_finite() {
            return None;
        }
        let rho_t = rho_t[k].map(f64::from);
        let (by_maps, cosine) = (maps.through(k, omega, rho_t), normal.normalize_or(DVec3::Z).dot(omega).max(0.0));
        let shown = |c: usize, v: f64| display(level[c] * v, manifest.exposure);
        Some((0..3).map(|c| (shown(c, by_maps[c]) - shown(c, rho_t[c] * cosine)).abs()).fold(0.0, f64::max))
    };
    let texels: Vec<usize> = (0..w * h).filter(|&k| on_leaf[k]).collect();
    let stride = suns.len().div_ceil(PLACEMENTS).max(1);
    let some: Vec<_> = suns.iter().step_by(stride).collect();
    let mut errors: Vec<f64> = some
        .into_par_iter()
        .flat_map_iter(|(sun, level)| texels.iter().filter_map(|k| error(*k, *sun, *level)))
        .collect();
    let Some(p99) = quantile(&mut errors, 0.99) else { return Ok(none) };
    let mut largest = errors.iter().copied().max_by(f64::total_cmp).unwrap_or(p99);
    if largest < manifest.tolerated() && stride > 1 {
        let of = |(sun, level): &(DVec3, [f64; 3])| {
            texels.iter().filter_map(|k| error(*k, *sun, *level)).fold(0.0, f64::max)
        };
        largest = suns.par_iter().map(of).reduce(|| 0.0, f64::max);
    }
    Ok(MapLoss { p99, largest, ..none })
}

/// The suns in the leaf's own frame, with the irradiance of each on a surface that faces it. There is one for each
/// placement and time, or a set over both sides where the sun moves.
fn suns(at: Stand, leaf: LoadedLeaf) -> Vec<(DVec3, [f64; 3])> {
    let Stand { manifest, placed, .. } = at;
    let Some(sun) = sun_direction(manifest) else { return Vec::new() };
    let level = levels(manifest).0.map(|e| e / PI);
    if manifest.sun_moves() || placed.free {
        let golden = PI * (3.0 - 5f64.sqrt());
        return (0..32)
            .map(|k| {
                let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 32.0;
                let (sin, cos) = (golden * f64::from(k)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                (DVec3::new(r * cos, r * sin, z), level)
            })
            .collect();
    }
    let mut times: Vec<f64> = match placed.moves().plants() {
        true => manifest.perspectives().map(|v| manifest.time_of(v)).collect(),
        false => vec![0.0],
    };
    times.dedup();
    let own = placed.placements.iter().filter(|p| p.leaf == leaf.placed.index);
    own.flat_map(|p| times.iter().map(move |t| placed.at_time(p, *t).transform))
        .map(|transform| ((DMat3::from_mat4(transform).inverse() * sun).normalize_or_zero(), level))
        .collect()
}

/// ρt of every texel.
fn transmittance(leaf: LoadedLeaf, side: Side, fitted: &LeafFit, ledger: &Ledger) -> Result<Vec<[f32; 3]>> {
    if let (Some(texels), Some(curve)) = (&leaf.loaded.textures[side].gamma_delta, &leaf.loaded.curves[side]) {
        let h = fitted.thickness(side)?;
        return Ok(texels.iter().map(|t| curve.at(h + f64::from(t[3])).1.map(|v| v as f32)).collect());
    }
    let maps = reader::maps(fitted, side, ledger)?;
    let rho_t = maps.require_three(&fitted.path(LeafFitFile::Maps, side), Quantity::RhoT)?;
    let at = |k: usize| rho_t.map(|p| p[k]).map(|v| if v.is_finite() { v } else { 0.0 });
    Ok((0..maps.width * maps.height).map(at).collect())
}

/// How coarse the leaf's maps may be by the detail of a side's translucency maps, where these are shown.
pub(super) fn detail(at: Stand, leaf: LoadedLeaf, side: Side, footprint: f64) -> Option<MapDetail> {
    let manifest = at.manifest;
    let level = levels(manifest).0[1] / PI;
    let maps = leaf.loaded.coefficients[side].as_ref().filter(|_| leaf.plan.needs(side).translucency)?;
    let mean_rho = leaf.loaded.curves[side].as_ref().map_or([1.0; 3], |c| c.at((c.min + c.max) / 2.0).1);
    // At 45° above the horizon, both relief and level count.
    let omega = DVec3::new(0.5f64.sqrt(), 0.0, 0.5f64.sqrt());
    let [w, h] = leaf.plan.size;
    let values: Vec<f32> =
        (0..w * h).map(|k| display(level * maps.through(k, omega, mean_rho)[1], manifest.exposure) as f32).collect();
    let good = on_leaf(leaf, side);
    let rows = map_levels(&values, w, h, |k| good[k], footprint, TRANSLUCENCY_TEXEL_BYTES);
    let allowed = rows.first().map_or(0.0, |r| r.error) + manifest.tolerated() / 4.0;
    Some(MapDetail { rows, allowed })
}
