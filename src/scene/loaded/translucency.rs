//! Translucency maps of a scene's leaf: where they come from, whether the sun ever comes through where a camera looks,
//! what they add.
//!
//! A folder of `fit translucency` holds `front.exr` and `back.exr`, for light that enters that side, in the columns of
//! that side's camera and of the size of the leaf's other maps: channels `translucency.1` to `.3`, coefficients of f on
//! the Half-Life 2 functions (straight or bent), or `translucency.R1` to `.B3`, those of M = ρt·f a colour. Directions
//! are in the lit side's tangent frame.

use crate::draw::sunlit::Inside;
use crate::fits::fitted::{Fitted, fill};
use crate::fits::source::{Source, Status};
use crate::ledger::Ledger;
use crate::manifest::{Basis, Manifest, Tissue, Translucency as Asked, ViewKind};
use crate::placed::branch;
use crate::plan::display::displayed;
use crate::plan::{LeafPlan, LeftOut, Need, Plan, sun_direction};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use mesophyll_files::hash;
use mesophyll_leaf::frames;
use mesophyll_optics::side::{Side, behind};
use mesophyll_optics::translucency::basis;
use mesophyll_record::FitRecord;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Bytes of a texel on the adapter, a layer: four half floats.
const TEXEL_BYTES: u64 = 8;
/// Placements whose light is looked at, at most.
const PLACEMENTS: usize = 48;

/// What a scene's leaf has of it.
#[derive(Debug, Clone)]
pub struct Translucent {
    pub source: Source,
    /// Open when it is there; its files are called `LEAF/translucency/…`.
    pub fitted: Option<Fitted>,
    /// Coefficients for light that enters the front and the back, without holes; only of sides that are back-lit where
    /// a camera looks. [`crate::plan::SideNeeds`] says which of them the renderer gets.
    pub maps: [Option<Coefficients>; 2],
    /// For the reference renderer, made when it first asks.
    inside: Arc<OnceLock<Option<Inside>>>,
}

impl Translucent {
    /// What the reference renderer evaluates; `leaf` is the one this belongs to.
    ///
    /// # Errors
    /// As [`Inside::new`].
    pub fn inside(&self, leaf: &LeafPlan) -> Result<Option<&Inside>> {
        if self.inside.get().is_none() {
            let made = Inside::new(leaf)?;
            let _ = self.inside.set(made);
        }
        Ok(self.inside.get().and_then(Option::as_ref))
    }
}

/// Three coefficients a texel, and the functions they belong to.
#[derive(Debug, Clone, PartialEq)]
pub struct Coefficients {
    pub basis: Basis,
    pub of: Of,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Of {
    /// f.
    Factor(Vec<[f32; 3]>),
    /// M, a channel each.
    Colour([Vec<[f32; 3]>; 3]),
}

impl Coefficients {
    pub fn layers(&self) -> &[Vec<[f32; 3]>] {
        match &self.of {
            Of::Factor(map) => std::slice::from_ref(map),
            Of::Colour(maps) => maps,
        }
    }

    /// Σ h_i φ_i(ω), which may be negative: renderers interpolate first and cut off at 0 after.
    pub fn sum(&self, h: [f32; 3], omega: DVec3) -> f64 {
        let at = self.basis.functions().argument(omega.to_array());
        DVec3::from(basis::vector(h.map(f64::from))).dot(DVec3::from(at))
    }

    /// Light through texel `k`, a channel each, where `rho_t` is ρt there.
    fn through(&self, k: usize, omega: DVec3, rho_t: [f64; 3]) -> [f64; 3] {
        match &self.of {
            Of::Factor(map) => {
                let f = self.sum(map[k], omega).max(0.0);
                rho_t.map(|r| r * f)
            }
            Of::Colour(maps) => [0, 1, 2].map(|c| self.sum(maps[c][k], omega).max(0.0)),
        }
    }
}

/// Where a run's own translucency maps of a leaf go.
pub fn folder(manifest: &Manifest, index: usize, out: &Path) -> PathBuf {
    out.join("fits").join(format!("{}-translucency", manifest.leaves[index].data_name()))
}

/// Looks for a leaf's maps; `None` where the scene asks for none.
///
/// # Errors
/// [`Error::Input`] for a folder of another kind of fit.
pub fn find(
    manifest: &Manifest,
    index: usize,
    out: Option<&Path>,
    fitted_leaf: Option<&Fitted>,
) -> Result<Option<Translucent>> {
    let leaf = &manifest.leaves[index];
    let Some(asked) = &leaf.translucency else { return Ok(None) };
    let named = asked.fit.as_ref().map(|f| manifest.resolve(f));
    let made = out.map(|o| folder(manifest, index, o));
    let exists = |f: &Option<PathBuf>| f.clone().filter(|f| f.join("fit.toml").is_file());
    // What the maps were made from, where they say it, must be the leaf's fit as it is now.
    let now = fitted_leaf.map(|f| hash::file(&f.folder.join("fit.toml"))).transpose()?;
    let mut stale = false;
    let mut found = None;
    for (place, is_named) in [(exists(&made), false), (exists(&named), true)] {
        let Some(place) = place else { continue };
        let said = FitRecord::read(&place)?.options;
        let from = said.get("leaf");
        if (from.is_some() && now.is_some() && from != now.as_ref()) || !as_asked(asked, &said, is_named) {
            stale = true;
        } else if found.is_none() {
            found = Some((place, is_named));
        }
    }
    let Some((place, is_named)) = found else {
        let (status, why) = match stale {
            true => (Status::Stale, "the leaf's fit, or what the scene asks of it, changed since the maps were made"),
            false => (Status::Missing, "not made yet; `mesophyll run` and `check` make it from the leaf's fit"),
        };
        let source = Source { status, folder: made, named: false, why: why.into() };
        return Ok(Some(Translucent { source, fitted: None, maps: Default::default(), inside: Default::default() }));
    };
    let fitted = Fitted::open_as(&format!("{}/translucency", leaf.name), &place, "translucency")?;
    let source =
        Source { status: Status::Reuse, folder: Some(place), named: is_named, why: "the scene asks for it".into() };
    Ok(Some(Translucent { source, fitted: Some(fitted), maps: Default::default(), inside: Default::default() }))
}

/// Whether maps that say how they were made were made as the scene asks. Of a basis that it does not ask for, what it
/// names may have any.
fn as_asked(asked: &Asked, said: &BTreeMap<String, String>, named: bool) -> bool {
    // The slab of a fit lets all light in, the table's tissue what is not reflected.
    let entry = match asked.tissue {
        Tissue::Fit => "matched",
        Tissue::Table => "albedo",
    };
    let wanted = asked.basis.or_else(|| (!named).then(Basis::default));
    let of = |b: Basis| said.get("basis").map_or(b == Basis::default(), |s| *s == b.functions().name());
    said.get("colour").is_none_or(|c| c == asked.colour.name())
        && said.get("entry").is_none_or(|e| e == entry)
        && wanted.is_none_or(of)
}

/// Lists the maps themselves as needed or left out.
pub fn list(manifest: &Manifest, leaf: &LeafPlan, plan: &mut Plan) {
    let Some(translucent) = &leaf.translucency else { return };
    if leaf.sides.iter().any(|s| s.translucency) {
        let mut need =
            Need::new(format!("fit {} translucency", manifest.leaves[leaf.index].name), translucent.source.why.clone());
        need.status = Some(translucent.source.status);
        need.hash = translucent.fitted.as_ref().map(|f| f.record.input_hash.clone());
        plan.need(need);
    }
}

/// Decides about one side of a leaf whose own maps have been looked at, and reads the coefficients as far as they are
/// needed.
///
/// # Errors
/// [`Error::Input`] for a map that is missing, damaged or of another size.
pub fn side(manifest: &Manifest, leaf: &mut LeafPlan, s: usize, plan: &mut Plan, ledger: &Ledger) -> Result<()> {
    let (Some(translucent), Some(fitted)) = (&leaf.translucency, &leaf.fitted) else { return Ok(()) };
    let (side, name) = (Side::ALL[s], &manifest.leaves[leaf.index].name);
    if !fitted.has(side) {
        return Ok(());
    }
    let file = format!("{}.exr", side.name());
    let what = format!("{name}/translucency/{file}");
    let on_disk = translucent.fitted.as_ref().map_or(0, |f| f.file_bytes(&file));
    let layer = (leaf.size[0] * leaf.size[1]) as u64 * TEXEL_BYTES * 4 / 3;
    if !leaf.sides[s].translucency {
        let why = if manifest.sun.is_none() {
            "there is no sun: a sky's light comes through by rho_t alone".to_string()
        } else {
            format!("never back-lit: no camera sees sunlight that entered the {}", side.name())
        };
        plan.leave_out(LeftOut::new(what, why, layer + on_disk, None));
        return Ok(());
    }
    let Some(maps) = &translucent.fitted else {
        let mut need = Need::new(what, format!("sunlight that enters the {} shows on the other side", side.name()));
        need.status = Some(translucent.source.status);
        plan.need(need);
        return Ok(());
    };
    let read = read(leaf, s, maps, &file, ledger)?;
    let cost = cost(manifest, leaf, s, &read, plan, ledger)?;
    if cost.largest < manifest.tolerance && !plan.free {
        leaf.sides[s].translucency = false;
        leaf.sides[s].normal = true;
        let why = format!(
            "by rho_t and the mapped normal a displayed value is off by {:.1e} at most (measured at every texel), the \
             scene tolerates {:.1e}",
            cost.largest, manifest.tolerance
        );
        plan.leave_out(LeftOut::new(what, why, read.layers().len() as u64 * layer + on_disk, None));
        // The reference renderer draws them all the same.
        if let Some(translucent) = &mut leaf.translucency {
            translucent.maps[s] = Some(read);
        }
        return Ok(());
    }
    let mut need = Need::new(what, format!("sunlight that enters the {} shows on the other side", side.name()));
    need.amount = Some(format!(
        "{}, {}; without it a displayed value is off by {:.3} (99 % of the texels), {:.3} at most (measured)",
        if read.layers().len() == 1 { "three coefficients a texel" } else { "three coefficients a texel and channel" },
        read.basis.functions().name(),
        cost.p99,
        cost.largest
    ));
    need.hash = maps.record.files.get(&file).cloned();
    need.bytes = Some(on_disk);
    plan.need(need);
    if let Some(translucent) = &mut leaf.translucency {
        translucent.maps[s] = Some(read);
    }
    Ok(())
}

/// Coefficients of one side, filled beyond the outline.
fn read(leaf: &LeafPlan, s: usize, fitted: &Fitted, file: &str, ledger: &Ledger) -> Result<Coefficients> {
    let path = fitted.folder.join(file);
    let info = fitted.info(file)?;
    if [info.width, info.height] != leaf.size {
        let what = format!(
            "found {}x{} texels, expected {}x{} as of the leaf's other maps",
            info.width, info.height, leaf.size[0], leaf.size[1]
        );
        return Err(Error::input(&path, what));
    }
    let basis = match fitted.record.options.get("basis") {
        None => Basis::default(),
        Some(said) => Basis::ALL.into_iter().find(|b| b.functions().name() == *said).ok_or_else(|| {
            let known = Basis::ALL.map(|b| format!("\"{}\"", b.functions().name())).join(" or ");
            let what = format!("found \"{said}\", expected {known}, which the renderers evaluate");
            Error::field(&fitted.folder.join("fit.toml"), "options.basis", what)
        })?,
    };
    let colour = info.channels.iter().any(|c| c == "translucency.R1");
    let names: Vec<String> = if colour {
        ["R", "G", "B"].iter().flat_map(|c| (1..=3).map(move |i| format!("translucency.{c}{i}"))).collect()
    } else {
        (1..=3).map(|i| format!("translucency.{i}")).collect()
    };
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let maps = fitted.maps(file, &names, ledger)?;
    let mut planes: Vec<Vec<f32>> = maps.channels.into_iter().map(|(_, p)| p).collect();
    let on_leaf = on_leaf(leaf, s);
    let good: Vec<bool> =
        on_leaf.iter().enumerate().map(|(k, on)| *on && planes.iter().all(|p| p[k].is_finite())).collect();
    fill(&path, leaf.size[0], leaf.size[1], &mut planes, |k| good[k])?;
    let three = |first: usize| {
        (0..good.len()).map(|k| [planes[first][k], planes[first + 1][k], planes[first + 2][k]]).collect()
    };
    let of = if colour { Of::Colour([three(0), three(3), three(6)]) } else { Of::Factor(three(0)) };
    Ok(Coefficients { basis, of })
}

/// Texels of a side's maps on the blade.
fn on_leaf(leaf: &LeafPlan, s: usize) -> Vec<bool> {
    let [w, h] = leaf.size;
    if leaf.textures[s].good.len() == w * h {
        return leaf.textures[s].good.clone();
    }
    let Some(mesh) = &leaf.mesh else { return vec![true; w * h] };
    let front = frames::covered(mesh, w, h);
    (0..w * h).map(|k| front[front_texel(k, s, w)]).collect()
}

/// The front's texel behind texel `k` of a side's maps.
pub fn front_texel(k: usize, s: usize, width: usize) -> usize {
    if s == 0 { k } else { behind(k, width) }
}

/// Displayed error of doing without.
struct Cost {
    p99: f64,
    largest: f64,
}

/// Compares the maps' light with that of ρt and the mapped normal, texel by texel and channel by channel, for the suns
/// that the scene's placements see: for some of them first, and for all where those would do without the maps.
fn cost(
    manifest: &Manifest,
    leaf: &LeafPlan,
    s: usize,
    maps: &Coefficients,
    plan: &Plan,
    ledger: &Ledger,
) -> Result<Cost> {
    let none = Cost { p99: 0.0, largest: 0.0 };
    let (Some(mesh), Some(fitted)) = (&leaf.mesh, &leaf.fitted) else { return Ok(none) };
    let [w, h] = leaf.size;
    let file = format!("{}_normal.exr", Side::ALL[s].name());
    let normals = fitted.maps(&file, &["X", "Y", "Z"], ledger)?;
    let rho_t = transmittance(leaf, s, Side::ALL[s], fitted, ledger)?;
    let frames = frames::frames(&leaf.mesh_path, mesh, w, h)?;
    let on_leaf = on_leaf(leaf, s);
    let suns = suns(manifest, leaf, plan);
    let out = if s == 0 { 1.0 } else { -1.0 };
    let error = |k: usize, sun: DVec3, level: [f64; 3]| {
        let [t, b, n] = frames[front_texel(k, s, w)];
        let omega = DVec3::new(out * t.dot(sun), b.dot(sun), out * n.dot(sun));
        let normal = DVec3::from([0, 1, 2].map(|c| f64::from(normals.channels[c].1[k])));
        if omega.z <= 0.0 || !normal.is_finite() {
            return None;
        }
        let rho_t = rho_t[k].map(f64::from);
        let (by_maps, cosine) = (maps.through(k, omega, rho_t), normal.normalize_or(DVec3::Z).dot(omega).max(0.0));
        let shown = |c: usize, v: f64| displayed(level[c] * v, manifest.exposure);
        Some((0..3).map(|c| (shown(c, by_maps[c]) - shown(c, rho_t[c] * cosine)).abs()).fold(0.0, f64::max))
    };
    let texels: Vec<usize> = (0..w * h).filter(|&k| on_leaf[k]).collect();
    let stride = suns.len().div_ceil(PLACEMENTS).max(1);
    let some: Vec<_> = suns.iter().step_by(stride).collect();
    let mut errors: Vec<f64> = some
        .into_par_iter()
        .flat_map_iter(|(sun, level)| texels.iter().filter_map(|k| error(*k, *sun, *level)))
        .collect();
    errors.sort_by(f64::total_cmp);
    let Some(mut largest) = errors.last().copied() else { return Ok(none) };
    if largest < manifest.tolerance && stride > 1 {
        let of = |(sun, level): &(DVec3, [f64; 3])| {
            texels.iter().filter_map(|k| error(*k, *sun, *level)).fold(0.0, f64::max)
        };
        largest = suns.par_iter().map(of).reduce(|| 0.0, f64::max);
    }
    Ok(Cost { p99: errors[((errors.len() - 1) as f64 * 0.99).round() as usize], largest })
}

/// Suns in the leaf's own frame and what they would give a white surface that faces them: one for each placement and
/// time, or a spread over both sides where the sun moves.
fn suns(manifest: &Manifest, leaf: &LeafPlan, plan: &Plan) -> Vec<(DVec3, [f64; 3])> {
    let Some(sun) = sun_direction(manifest) else { return Vec::new() };
    let level = crate::plan::light::levels(manifest).0.map(|e| e / PI);
    if manifest.sun_moves() || plan.free {
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
    let mut times: Vec<f64> = match plan.bends {
        Some(_) => manifest
            .views
            .iter()
            .filter(|v| v.kind == ViewKind::Perspective)
            .map(|v| branch::time(manifest, v))
            .collect(),
        None => vec![0.0],
    };
    times.dedup();
    let own = plan.placements.iter().filter(|p| p.leaf == leaf.index);
    own.flat_map(|p| times.iter().map(move |t| plan.at_time(p, *t).transform))
        .map(|transform| ((DMat3::from_mat4(transform).inverse() * sun).normalize_or_zero(), level))
        .collect()
}

/// ρt of every texel.
fn transmittance(leaf: &LeafPlan, s: usize, side: Side, fitted: &Fitted, ledger: &Ledger) -> Result<Vec<[f32; 3]>> {
    if let (Some(texels), Some(curve)) = (&leaf.textures[s].gamma_delta, &leaf.curves[s]) {
        let h = fitted.thickness(side)?;
        return Ok(texels.iter().map(|t| curve.at(h + f64::from(t[3])).1.map(|v| v as f32)).collect());
    }
    let maps = fitted.maps(&format!("{}.exr", side.name()), &["rho_t.R", "rho_t.G", "rho_t.B"], ledger)?;
    let at = |k: usize| [0, 1, 2].map(|c: usize| maps.channels[c].1[k]).map(|v| if v.is_finite() { v } else { 0.0 });
    Ok((0..maps.width * maps.height).map(at).collect())
}

/// Lets the maps' own detail say how coarse the leaf's maps may be.
pub fn resolution(manifest: &Manifest, leaf: &mut LeafPlan, plan: &mut Plan, footprint: f64) {
    let level = crate::plan::light::levels(manifest).0[1] / PI;
    for s in [0, 1] {
        let Some(maps) =
            leaf.translucency.as_ref().and_then(|t| t.maps[s].as_ref()).filter(|_| leaf.sides[s].translucency)
        else {
            continue;
        };
        let mean_rho = leaf.curves[s].as_ref().map_or([1.0; 3], |c| c.at((c.min + c.max) / 2.0).1);
        // At half the height of the sky both relief and level count.
        let omega = DVec3::new(0.5f64.sqrt(), 0.0, 0.5f64.sqrt());
        let [w, h] = leaf.size;
        let values: Vec<f32> = (0..w * h)
            .map(|k| displayed(level * maps.through(k, omega, mean_rho)[1], manifest.exposure) as f32)
            .collect();
        let good = on_leaf(leaf, s);
        let rows = crate::plan::accuracy::map_levels(&values, w, h, |k| good[k], footprint, TEXEL_BYTES);
        let allowed = rows.first().map_or(0.0, |r| r.error) + manifest.tolerance / 4.0;
        let what = format!("{}/translucency {} resolution", manifest.leaves[leaf.index].name, Side::ALL[s].name());
        if let Some(row) = plan.choose(&what, rows, allowed) {
            leaf.block = leaf.block.min(row.setting);
        }
    }
}
