//! Saves an edit as a new fit folder: the maps that follow from the edit are computed anew, everything else is copied.

use crate::draw::handover::Scaling;
use crate::fits::fitted::Fitted;
use crate::{Error, Result};
use mesophyll_files::atomic::{self, explain};
use mesophyll_files::hash;
use mesophyll_files::image::{self, Maps, Packing};
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What an edit does to one side.
#[derive(Debug, Clone, Copy)]
pub struct Change {
    pub scaling: Scaling,
    /// Factors on ρs and m.
    pub rho_s: f64,
    pub m: f64,
}

/// Writes `NAME-edit-N` under `folder` and returns where; `fit.toml` says that its σ and h were set by hand.
///
/// # Errors
/// [`Error::Write`] or [`Error::Usage`] when the folder cannot be written, [`Error::Input`] for a map of the fit that
/// cannot be read.
pub fn edited(fitted: &Fitted, changes: &[Change; 2], folder: &Path) -> Result<PathBuf> {
    let free = (1..).map(|n| folder.join(format!("{}-edit-{n}", fitted.name))).find(|p| !p.exists());
    let target = free.unwrap_or_else(|| folder.join(&fitted.name));
    atomic::probe_folder(&target)?;
    let mut record = fitted.record.clone();
    // What was measured is no measurement of an edited leaf.
    record.files.retain(|name, _| !name.ends_with("_held_out.exr"));
    record.scan = None;
    for name in record.files.keys() {
        let (from, to) = (fitted.folder.join(name), target.join(name));
        let bytes = std::fs::read(&from).map_err(|e| Error::input(&from, explain(&e)))?;
        atomic::write_bytes(&to, &bytes)?;
    }
    record.name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    record.options.insert("edited_from".into(), format!("{} ({})", fitted.record.name, fitted.record.input_hash));
    record.termination = None;
    for (s, side) in Side::ALL.into_iter().enumerate() {
        let Some(section) = record.sections.get_mut(side.name()) else { continue };
        let change = &changes[s];
        for (name, factor) in
            [("sigma_a", Some(change.scaling.sigma_a)), ("sigma_s", Some(change.scaling.sigma_s)), ("thickness", None)]
        {
            if let Some(param) = section.params.get_mut(name) {
                for (c, v) in param.value.iter_mut().enumerate() {
                    *v = factor.map_or(*v + change.scaling.thickness_mm, |f| *v * f[c.min(2)]);
                }
                param.stderr.iter_mut().for_each(|e| *e = f64::INFINITY);
                param.undetermined = vec![format!("{name}: set by hand")];
            }
        }
        // Residuals, errors to the truth and figures belong to the fit that was measured.
        (section.residuals, section.truth, section.figures) = Default::default();
        (section.held_out, section.light_box) = Default::default();
        let shared = |n: &str| section.params.get(n).map(|p| p.value.clone()).unwrap_or_default();
        let (sigma_a, sigma_s) = (shared("sigma_a"), shared("sigma_s"));
        change_maps(&target.join(format!("{}.exr", side.name())), change, &sigma_a, &sigma_s)?;
        let gloss = target.join(format!("{}_rho_s_m.exr", side.name()));
        if gloss.is_file() && (change.rho_s != 1.0 || change.m != 1.0) {
            let mut maps = image::read_exr(&gloss)?;
            for (name, plane) in &mut maps.channels {
                let factor = if name == "A" { change.m } else { change.rho_s } as f32;
                plane.iter_mut().for_each(|v| *v *= factor);
            }
            image::write_exr(&gloss, &maps, Packing::Zip)?;
        }
    }
    for (name, hash) in &mut record.files {
        *hash = hash::file(&target.join(name))?;
    }
    record.write(&target)?;
    Ok(target)
}

/// `{side}.exr` after the edit: σ maps scaled, thickness moved, gloss scaled, ρd = γ·slab and ρt solved anew.
fn change_maps(path: &Path, change: &Change, sigma_a: &[f64], sigma_s: &[f64]) -> Result<()> {
    let mut maps = image::read_exr(path)?;
    for (name, plane) in &mut maps.channels {
        let channel = match name.rsplit('.').next() {
            Some("G") => 1,
            Some("B") => 2,
            _ => 0,
        };
        let (factor, more) = match name.split('.').next() {
            Some("sigma_a") => (change.scaling.sigma_a[channel], 0.0),
            Some("sigma_s") => (change.scaling.sigma_s[channel], 0.0),
            Some("thickness") => (1.0, change.scaling.thickness_mm),
            Some("rho_s") => (change.rho_s, 0.0),
            Some("m") => (change.m, 0.0),
            _ => continue,
        };
        plane.iter_mut().for_each(|v| *v = (f64::from(*v) * factor + more) as f32);
    }
    let thickness = maps.require(path, "thickness.Y")?.to_vec();
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        let (Some(&sa), Some(&ss)) = (sigma_a.get(c), sigma_s.get(c)) else { continue };
        let gamma = maps.require(path, &format!("gamma.{name}"))?.to_vec();
        let solved: Vec<(f32, f32)> = thickness
            .par_iter()
            .zip(&gamma)
            .map(|(h, g)| {
                if h.is_nan() || *h <= 0.0 {
                    return (f32::NAN, f32::NAN);
                }
                let r = slab::response(sa, ss, f64::from(*h));
                ((f64::from(*g) * r.rho_d) as f32, r.rho_t as f32)
            })
            .collect();
        let (rho_d, rho_t): (Vec<f32>, Vec<f32>) = solved.into_iter().unzip();
        replace(&mut maps, &format!("rho_d.{name}"), rho_d);
        replace(&mut maps, &format!("rho_t.{name}"), rho_t);
    }
    image::write_exr(path, &maps, Packing::Zip)
}

fn replace(maps: &mut Maps, name: &str, samples: Vec<f32>) {
    if let Some((_, plane)) = maps.channels.iter_mut().find(|(n, _)| n == name) {
        *plane = samples;
    }
}
