//! The plan of one leaf: which of its fit's files are read, which maps are uploaded, at what resolution, with how fine
//! a slab curve.

use super::accuracy;
use super::display::displayed;
use super::{LeafPlan, LeftOut, Need, Plan, Textures};
use crate::Result;
use crate::fits::fitted::{Fitted, fill};
use crate::ledger::Ledger;
use crate::manifest::{Interior, Manifest, ViewKind};
use glam::DVec3;
use mesophyll_optics::side::Side;
use mesophyll_record::Times;

/// Sides by index.
/// Bytes of a texel on the adapter: four floats, and a third more for its mips.
const TEXEL_BYTES: u64 = 16;

pub fn texture_bytes(size: [usize; 2]) -> u64 {
    (size[0] * size[1]) as u64 * TEXEL_BYTES * 4 / 3
}

/// Lists the leaf's fit itself as needed or left out.
pub fn list(manifest: &Manifest, leaf: &LeafPlan, plan: &mut Plan) {
    let name = &manifest.leaves[leaf.index].name;
    if !leaf.used {
        let folder = manifest.leaves[leaf.index].fit.as_ref().map(|f| manifest.resolve(f));
        let bytes = folder.as_ref().and_then(|f| std::fs::read_dir(f).ok()).map_or(0, |entries| {
            entries.flatten().filter_map(|e| e.metadata().ok()).filter(|m| m.is_file()).map(|m| m.len()).sum()
        });
        let ms = folder.as_ref().and_then(|f| Times::read(f).ok()).map(|t| t.total_s * 1e3);
        plan.leave_out(LeftOut::new(format!("fit {name}"), "no instance and no card shows this leaf", bytes, ms));
        return;
    }
    let Some(source) = &leaf.source else { return };
    let mut need = Need::new(format!("fit {name}"), source.why.clone());
    need.status = Some(source.status);
    need.hash = leaf.fitted.as_ref().map(|f| f.record.input_hash.clone());
    plan.need(need);
}

/// Decides everything about a leaf whose fit is there, and reads W's textures as far as they are needed.
pub fn detail(manifest: &Manifest, leaf: &mut LeafPlan, plan: &mut Plan, ledger: &Ledger) -> Result<()> {
    let Some(fitted) = leaf.fitted.clone() else { return Ok(()) };
    let config = &manifest.leaves[leaf.index];
    for (s, side) in Side::ALL.into_iter().enumerate() {
        if leaf.sides[s].any() || leaf.sides[s].mean {
            fitted.section(side)?;
        }
    }
    if leaf.mesh.is_some() {
        let file = leaf.mesh_path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        file_need(plan, &fitted, &file, "the shape that is drawn", config.mesh.is_none());
    } else {
        let bytes = fitted.file_bytes("blade.glb");
        plan.leave_out(LeftOut::new(format!("{}/blade.glb", config.name), "only a card shows this leaf", bytes, None));
    }
    for (s, side) in Side::ALL.into_iter().enumerate() {
        let task = OneSide { manifest, s, side, fitted: &fitted, ledger };
        if config.interior == Interior::Scalars && leaf.sides[s].interior() {
            task.read_gamma_delta(leaf)?;
        }
        if leaf.sides[s].any() && leaf.size == [0, 0] {
            let info = fitted.info(&format!("{}.exr", side.name()))?;
            leaf.size = [info.width, info.height];
        }
        task.slab_curve(leaf, plan)?;
        super::gloss::side(manifest, leaf, s, plan, ledger)?;
        crate::loaded::translucency::side(manifest, leaf, s, plan, ledger)?;
        task.files(leaf, plan);
    }
    resolution(manifest, leaf, plan);
    let keep: u64 = ["front_err.exr", "back_err.exr"].iter().map(|f| fitted.file_bytes(f)).sum();
    plan.leave_out(LeftOut::new(
        format!("{}: error maps and previews", config.name),
        "a picture needs no standard errors",
        keep,
        None,
    ));
    Ok(())
}

fn file_need(plan: &mut Plan, fitted: &Fitted, file: &str, why: &str, of_fit: bool) {
    let mut need = Need::new(format!("{}/{file}", fitted.name), why);
    if of_fit {
        need.hash = fitted.record.files.get(file).cloned();
        need.bytes = Some(fitted.file_bytes(file));
    }
    plan.need(need);
}

/// One of W's textures: its size, RGBA texels without holes, and which of them the fit knew.
pub struct Rgba {
    pub size: [usize; 2],
    pub texels: Vec<[f32; 4]>,
    pub good: Vec<bool>,
}

/// Interleaves four channels, filled wherever `good` does not hold.
pub fn rgba(fitted: &Fitted, file: &str, ledger: &Ledger, good: impl Fn([f32; 4]) -> bool) -> Result<Rgba> {
    let maps = fitted.maps(file, &["R", "G", "B", "A"], ledger)?;
    let size = [maps.width, maps.height];
    let mut planes: Vec<Vec<f32>> = maps.channels.into_iter().map(|(_, p)| p).collect();
    let at = |planes: &[Vec<f32>], k: usize| [planes[0][k], planes[1][k], planes[2][k], planes[3][k]];
    let mask: Vec<bool> =
        (0..size[0] * size[1]).map(|k| at(&planes, k)).map(|t| t.iter().all(|v| v.is_finite()) && good(t)).collect();
    fill(&fitted.folder.join(file), size[0], size[1], &mut planes, |k| mask[k])?;
    let texels = (0..mask.len()).map(|k| at(&planes, k)).collect();
    Ok(Rgba { size, texels, good: mask })
}

/// The size of a leaf's maps, where `size` is that of one of them and `leaf` what is known so far (zero: nothing).
///
/// # Errors
/// [`crate::Error::Input`] naming the file where they differ.
pub fn same_size(leaf: [usize; 2], size: [usize; 2], fitted: &Fitted, file: &str) -> Result<[usize; 2]> {
    if leaf != [0, 0] && leaf != size {
        let what = format!(
            "found {}x{} texels, expected {}x{} as of the leaf's other maps",
            size[0], size[1], leaf[0], leaf[1]
        );
        return Err(crate::Error::input(&fitted.folder.join(file), what));
    }
    Ok(size)
}

/// Light that reaches a surface, at most: E/π and the sky's radiance (the mean over the channels).
fn light(manifest: &Manifest) -> (f64, f64) {
    let mean = |c: &[f64; 3]| c.iter().sum::<f64>() / 3.0;
    let (sun, sky) = super::light::levels(manifest);
    (mean(&sun), mean(&sky))
}

/// One side of a leaf whose fit is there.
struct OneSide<'a> {
    manifest: &'a Manifest,
    s: usize,
    side: Side,
    fitted: &'a Fitted,
    ledger: &'a Ledger,
}

impl OneSide<'_> {
    fn read_gamma_delta(&self, leaf: &mut LeafPlan) -> Result<()> {
        let OneSide { s, side, fitted, ledger, .. } = *self;
        let file = format!("{}_gamma_delta.exr", side.name());
        let h = fitted.thickness(side)? as f32;
        // γ of a leaf texel is positive, and so is its thickness.
        let Rgba { size, texels, good } =
            rgba(fitted, &file, ledger, |t| t[0] > 0.0 && t[1] > 0.0 && t[2] > 0.0 && h + t[3] > 0.0)?;
        leaf.size = same_size(leaf.size, size, fitted, &file)?;
        leaf.textures[s] = Textures { gamma_delta: Some(texels), gloss: None, good };
        Ok(())
    }

    fn slab_curve(&self, leaf: &mut LeafPlan, plan: &mut Plan) -> Result<()> {
        let OneSide { manifest, s, side, fitted, ledger } = *self;
        let Some(texels) = &leaf.textures[s].gamma_delta else { return Ok(()) };
        let h = fitted.thickness(side)?;
        let (low, high) = texels
            .iter()
            .fold((f64::INFINITY, 0f64), |(a, b), t| (a.min(h + f64::from(t[3])), b.max(h + f64::from(t[3]))));
        // A tenth of a shortcut's share, and never more than a ten-thousandth.
        let allowed = (manifest.tolerance / 10.0).min(1e-4);
        let what = format!("{}/{} slab curve", fitted.name, side.name());
        let curve = accuracy::curve(
            fitted.rgb(side, "sigma_a")?,
            fitted.rgb(side, "sigma_s")?,
            low,
            high,
            allowed,
            &what,
            ledger,
        );
        let last = curve.rows.last().copied();
        plan.measured.insert(what.clone(), curve.rows.clone());
        let mut need = Need::new(what, "rho_d and rho_t follow the thickness h + delta of each texel");
        need.amount = last
            .map(|r| format!("{} points, interpolation error {:.1e} (measured), {:.2} ms", r.setting, r.error, r.ms));
        need.bytes = last.map(|r| r.bytes);
        plan.need(need);
        leaf.curves[s] = Some(curve);
        Ok(())
    }

    /// Lists the files of one side.
    fn files(&self, leaf: &LeafPlan, plan: &mut Plan) {
        let OneSide { manifest, s, side, fitted, ledger } = *self;
        if !fitted.has(side) {
            return;
        }
        let needs = leaf.sides[s];
        let pigment = manifest.leaves[leaf.index].interior == Interior::Maps;
        let file = |what: &str| format!("{}{what}.exr", side.name());
        let entry = |what: &str| format!("{}/{}", fitted.name, file(what));
        let texture = texture_bytes(leaf.size);
        // Measured on the maps of this leaf that were read.
        let rate = {
            let (bytes, ms) = ledger
                .entries()
                .iter()
                .filter(|e| {
                    e.action == "read" && e.what.starts_with(&format!("{}/", fitted.name)) && e.what.ends_with(".exr")
                })
                .fold((0u64, 0.0), |(b, t), e| (b + e.bytes, t + e.ms));
            (bytes > 0).then(|| ms / bytes as f64)
        };
        let skip = |plan: &mut Plan, what: &str, textures: u64, why: String| {
            let on_disk = fitted.file_bytes(&file(what));
            plan.leave_out(LeftOut::new(
                entry(what),
                why,
                on_disk + textures * texture,
                rate.map(|r| r * on_disk as f64),
            ));
        };
        let unseen = format!("no camera sees the {} or light that came through it", side.name());
        match (needs.interior(), pigment) {
            (true, false) => {
                let why = match (needs.rho_d, needs.rho_t) {
                    (true, true) => "reflectance where light falls on it, transmittance where light comes through it",
                    (true, false) => "reflectance where light falls on it",
                    _ => "transmittance where light comes through it",
                };
                file_need(plan, fitted, &file("_gamma_delta"), why, true);
                let name = format!("{}: pigment maps, {}", fitted.name, side.name());
                plan.leave_out(LeftOut::new(name, "the scene asks for W's scalars", 2 * texture, None));
            }
            (true, true) => skip(plan, "_gamma_delta", 1, "the scene asks for pigment maps".into()),
            (false, _) => skip(plan, "_gamma_delta", 1, unseen.clone()),
        }
        if needs.gloss {
            file_need(plan, fitted, &file("_rho_s_m"), "highlights of the sun or the sky show", true);
        }
        if needs.normal {
            let why = if manifest.physical_sky() {
                "the sky's light differs with where it turns"
            } else if !leaf.facing.lit[s] && needs.gloss {
                "how much a glossy side mirrors of the sky depends on where it turns"
            } else {
                "the sun falls on this side where it shows"
            };
            file_need(plan, fitted, &file("_normal"), why, true);
        } else if needs.translucency {
            // Measured against, where there are maps to measure.
            if leaf.translucency.as_ref().is_some_and(|t| t.maps[s].is_some()) {
                file_need(
                    plan,
                    fitted,
                    &file("_normal"),
                    "what the translucency maps add is measured against it; it is not uploaded",
                    true,
                );
            }
        } else {
            let why = if needs.any() {
                "no sun falls on this side, and a constant sky asks a matte side for no direction".into()
            } else {
                unseen.clone()
            };
            skip(plan, "_normal", 1, why);
        }
        if needs.any() || needs.mean {
            let why = if pigment {
                "pigment maps, and the reference renderer's own path to the leaf"
            } else {
                "the reference renderer's own path to the leaf"
            };
            file_need(plan, fitted, &file(""), why, true);
        } else {
            skip(plan, "", 0, unseen);
        }
    }
}

/// Picks the maps' resolution from the footprint of the nearest pixel.
fn resolution(manifest: &Manifest, leaf: &mut LeafPlan, plan: &mut Plan) {
    let Some(mesh) = &leaf.mesh else { return };
    if leaf.size == [0, 0] {
        return;
    }
    let (mut area, mut area_uv) = (0.0, 0.0);
    for t in 0..mesh.triangles() {
        let [a, b, c] = mesh.triangle(t);
        area += (mesh.positions[b] - mesh.positions[a]).cross(mesh.positions[c] - mesh.positions[a]).length();
        area_uv += (mesh.uvs[b] - mesh.uvs[a]).perp_dot(mesh.uvs[c] - mesh.uvs[a]).abs();
    }
    let texel_mm = (area / (area_uv * (leaf.size[0] * leaf.size[1]) as f64)).sqrt();
    let (centre, radius) = mesh.bounds();
    let mut footprint = f64::INFINITY;
    for p in plan.placements.iter().filter(|p| p.leaf == leaf.index) {
        for view in manifest.views.iter().filter(|v| v.kind == ViewKind::Perspective) {
            let (Some(eye), Some(fov)) = (view.eye_mm, view.fov_deg) else { continue };
            let at = plan.at_time(p, crate::placed::branch::time(manifest, view)).transform;
            let (scale, centre) = (at.x_axis.truncate().length(), at.transform_point3(centre));
            let nearest = (DVec3::from(eye).distance(centre) - radius * scale).max(1e-3);
            let pixel_mm = 2.0 * (fov.to_radians() / 2.0).tan() * nearest / f64::from(manifest.check.height);
            footprint = footprint.min(pixel_mm / (texel_mm * scale));
        }
    }
    if !footprint.is_finite() || footprint <= 0.0 {
        return;
    }
    let name = &manifest.leaves[leaf.index].name;
    let (sun, sky) = light(manifest);
    let power = sun / std::f64::consts::PI + sky;
    for s in [0, 1] {
        let (Some(texels), Some(curve), Some(fitted)) = (&leaf.textures[s].gamma_delta, &leaf.curves[s], &leaf.fitted)
        else {
            continue;
        };
        let Ok(h) = fitted.thickness(Side::ALL[s]) else { continue };
        let value: Vec<f32> = texels
            .iter()
            .map(|t| {
                let (rho_d, rho_t) = curve.at(h + f64::from(t[3]));
                let rho = if leaf.sides[s].rho_d { f64::from(t[1]) * rho_d[1] } else { rho_t[1] };
                displayed(rho * power, manifest.exposure) as f32
            })
            .collect();
        let good = &leaf.textures[s].good;
        let rows = accuracy::map_levels(&value, leaf.size[0], leaf.size[1], |k| good[k], footprint, TEXEL_BYTES);
        // Sampling a pixel's centre has an error of its own; a coarser map may not add the scene's tolerance to it.
        let allowed = rows.first().map_or(0.0, |r| r.error) + manifest.tolerance / 4.0;
        let what = format!("{name}/{} map resolution", Side::ALL[s].name());
        if let Some(row) = plan.choose(&what, rows, allowed) {
            leaf.block = if s == 0 || leaf.textures[0].gamma_delta.is_none() {
                row.setting
            } else {
                leaf.block.min(row.setting)
            };
        }
    }
    crate::loaded::translucency::resolution(manifest, leaf, plan, footprint);
    let (w, h) = (leaf.size[0].div_ceil(leaf.block), leaf.size[1].div_ceil(leaf.block));
    let mut need =
        Need::new(format!("{name}: maps at {w}x{h}"), format!("the nearest pixel covers {footprint:.2} texels a side"));
    need.amount = Some(format!("blocks of {0}x{0} texels", leaf.block));
    plan.need(need);
    if leaf.block > 1 {
        let maps = leaf
            .textures
            .iter()
            .map(|t| u64::from(t.gamma_delta.is_some()) + u64::from(t.gloss.is_some()))
            .sum::<u64>()
            + leaf.sides.iter().map(|s| u64::from(s.normal)).sum::<u64>();
        let saved = maps * (texture_bytes(leaf.size) - texture_bytes([w, h]));
        plan.leave_out(LeftOut::new(
            format!("{name}: map detail finer than {0}x{0} texels", leaf.block),
            "no pixel is small enough to show it",
            saved,
            None,
        ));
    }
}
