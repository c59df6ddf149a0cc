//! Values changed by hand: how an edit changes a leaf's record and its maps. The window, the hand-over to renderers and
//! the saved fit all use it.

use crate::leaf_folder::{BLADE, Error, LeafFit, LeafFitFile, Result};
use crate::record::RecordSection;
use mesophyll_files::atomic::{self, explain};
use mesophyll_files::hash;
use mesophyll_files::image::{self, ChannelMaps, Packing};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::slab;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// The changes of one side: factors on σa, σs, ρd and ρt (a colour channel each), on ρs and on m, and an addition to
/// the thickness (mm). ρd of a fitted leaf is that of its slab times γ, so that the factor on ρd is one on γ; its ρt
/// is its slab's, and only that of a stated look has a factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafSideEdit {
    /// Factor on σa, a colour channel.
    pub sigma_a: [f64; 3],
    /// Factor on σs, a colour channel.
    pub sigma_s: [f64; 3],
    /// Factor on ρd, a colour channel.
    pub rho_d: [f64; 3],
    /// Factor on ρt, a colour channel.
    pub rho_t: [f64; 3],
    /// Added to the thickness of every texel and to the mean (mm).
    pub thickness_mm: f64,
    /// Factor on ρs.
    pub rho_s: f64,
    /// Factor on the roughness m.
    pub m: f64,
}

/// What changed a value that was set by hand.
const BY_HAND: &str = "set by hand";

impl Default for LeafSideEdit {
    /// Changes nothing.
    fn default() -> Self {
        let one = [1.0; 3];
        LeafSideEdit { sigma_a: one, sigma_s: one, rho_d: one, rho_t: one, thickness_mm: 0.0, rho_s: 1.0, m: 1.0 }
    }
}

impl LeafSideEdit {
    /// Changes the side's parameters. A value that is set by hand has no standard error, and what was measured on the
    /// fitted leaf does not apply to this one.
    pub fn record(&self, section: &mut RecordSection) {
        for (quantity, factor) in [
            (Quantity::SigmaA, Some(self.sigma_a)),
            (Quantity::SigmaS, Some(self.sigma_s)),
            (Quantity::Thickness, None),
        ] {
            let name = quantity.name();
            let Some(param) = section.params.get_mut(name) else { continue };
            for (c, v) in param.value.iter_mut().enumerate() {
                *v = factor.map_or(*v + self.thickness_mm, |f| *v * f[c.min(2)]);
            }
            param.stderr.iter_mut().for_each(|e| *e = f64::INFINITY);
            param.undetermined = vec![format!("{name}: {BY_HAND}")];
        }
        (section.residuals, section.truth, section.figures) = Default::default();
        (section.held_out, section.light_box) = Default::default();
    }

    /// Changes the side's maps of σa, σs, thickness, ρd, ρt, ρs and m, on a leaf whose mean thickness is then
    /// `thickness_mm`. Where an edit takes away more than a thin texel has, a thousandth of the mean is left.
    pub fn maps(&self, maps: &mut ChannelMaps, thickness_mm: f64) {
        let mut change = |quantity: Quantity, c: usize, factor: f64, more: f64| {
            if let Some(plane) = maps.plane_mut(quantity, c) {
                plane.iter_mut().for_each(|v| *v = (f64::from(*v) * factor + more) as f32);
            }
        };
        for c in 0..3 {
            change(Quantity::SigmaA, c, self.sigma_a[c], 0.0);
            change(Quantity::SigmaS, c, self.sigma_s[c], 0.0);
            change(Quantity::RhoD, c, self.rho_d[c], 0.0);
            change(Quantity::Gamma, c, self.rho_d[c], 0.0);
            change(Quantity::RhoT, c, self.rho_t[c], 0.0);
            change(Quantity::RhoS, c, self.rho_s, 0.0);
        }
        change(Quantity::M, 0, self.m, 0.0);
        if self.thickness_mm != 0.0 {
            change(Quantity::Thickness, 0, 1.0, self.thickness_mm);
            let thinnest = (1e-3 * thickness_mm) as f32;
            let plane = maps.plane_mut(Quantity::Thickness, 0).unwrap_or_default();
            plane.iter_mut().filter(|t| **t < thinnest).for_each(|t| *t = thinnest);
        }
    }
}

/// Replaces the ρd and ρt of `maps` by γ · slab and slab, for a leaf of σa and σs (1/mm); NaN where the thickness is
/// not positive.
///
/// # Errors
/// [`crate::leaf_folder::Error::Input`] naming `path` and the channel that is missing.
pub(crate) fn solve(path: &Path, maps: &mut ChannelMaps, sigma_a: [f64; 3], sigma_s: [f64; 3]) -> Result<()> {
    let thickness = maps.require_scalar(path, Quantity::Thickness)?.to_vec();
    let gamma = maps.require_three(path, Quantity::Gamma)?.map(<[f32]>::to_vec);
    for c in 0..3 {
        let texel = |(h, g): (&f32, &f32)| {
            if !(*h > 0.0) {
                return (f32::NAN, f32::NAN);
            }
            let r = slab::response(sigma_a[c], sigma_s[c], f64::from(*h));
            ((f64::from(*g) * r.rho_d) as f32, r.rho_t as f32)
        };
        let (rho_d, rho_t): (Vec<f32>, Vec<f32>) = thickness.par_iter().zip(&gamma[c]).map(texel).unzip();
        maps.replace(Quantity::RhoD, c, rho_d);
        maps.replace(Quantity::RhoT, c, rho_t);
    }
    Ok(())
}

/// Writes an edited leaf as a separate fit, `NAME-edit-N` under `folder`, and returns its folder. Its `fit.toml` states
/// what was set by hand; what was measured on the fitted leaf is left out.
///
/// # Errors
/// [`crate::leaf_folder::Error::Write`] or [`crate::leaf_folder::Error::Usage`] when the folder cannot be written,
/// [`crate::leaf_folder::Error::Input`] for a map of the fit that cannot be read.
pub fn save(leaf: &LeafFit, folder: &Path) -> Result<PathBuf> {
    let free = (1..).map(|n| folder.join(format!("{}-edit-{n}", leaf.name))).find(|p| !p.exists());
    let target = free.unwrap_or_else(|| folder.join(&leaf.name));
    save_to(leaf, &target, BY_HAND)?;
    Ok(target)
}

/// As [`save`], into the folder `target`. `how` says what changed the leaf.
///
/// # Errors
/// As [`save`].
pub fn save_to(leaf: &LeafFit, target: &Path, how: &str) -> Result<()> {
    atomic::probe_folder(target)?;
    let mut record = leaf.record.clone();
    for param in record.sections.values_mut().flat_map(|section| section.params.values_mut()) {
        param.undetermined.iter_mut().for_each(|why| *why = why.replace(BY_HAND, how));
    }
    record.scan = None;
    // Files that no edit changes are copied. Other files that the folder lists are not part of an edited leaf.
    let copied = leaf.sides().map(|s| LeafFitFile::Errors.name(s)).chain([BLADE.to_string()]);
    let copied: Vec<String> = copied.filter(|name| record.files.contains_key(name)).collect();
    for name in &copied {
        let from = leaf.folder.join(name);
        let bytes = std::fs::read(&from).map_err(|e| Error::input(&from, explain(&e)))?;
        atomic::write_bytes(&target.join(name), &bytes)?;
    }
    record.options.insert("edited_from".into(), format!("{} ({})", record.name, record.input_hash));
    record.name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    record.termination = None;
    for name in ["gloss", "thickness"].into_iter().filter(|_| leaf.is_stated()) {
        record.options.entry(name.into()).and_modify(|said| said.push_str("; changed by hand since"));
    }
    for side in leaf.sides() {
        image::write_exr(&LeafFitFile::Maps.path(target, side), &leaf.solved(side)?, Packing::Zip)?;
    }
    let all = leaf.sides().map(|s| LeafFitFile::Maps.name(s)).chain(copied);
    record.files = all.map(|name| hash::file(&target.join(&name)).map(|hash| (name, hash))).collect::<Result<_>>()?;
    record.write(target)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thicker_leaf_reflects_and_transmits_as_its_slab_says() {
        let mut maps = ChannelMaps::new(2, 1);
        for c in 0..3 {
            maps.add(Quantity::Gamma, c, vec![1.0, 0.9]);
            maps.add(Quantity::SigmaA, c, vec![2.0, 3.0]);
            maps.add(Quantity::RhoS, c, vec![0.1; 2]);
        }
        maps.add(Quantity::Thickness, 0, vec![0.2, f32::NAN]);
        let edit = LeafSideEdit { sigma_a: [1.0, 2.0, 1.0], thickness_mm: 0.1, rho_s: 0.5, ..LeafSideEdit::default() };
        edit.maps(&mut maps, 0.3);
        assert_eq!(maps.plane(Quantity::SigmaA, 1), Some(&[4.0, 6.0][..]));
        assert_eq!(maps.plane(Quantity::SigmaA, 0), Some(&[2.0, 3.0][..]));
        assert_eq!(maps.plane(Quantity::RhoS, 2), Some(&[0.05; 2][..]));
        solve(Path::new("a.exr"), &mut maps, [2.0; 3], [5.0; 3]).unwrap();
        let r = slab::response(2.0, 5.0, f64::from(0.2f32 + 0.1f32));
        assert!((f64::from(maps.plane(Quantity::RhoD, 0).unwrap()[0]) - r.rho_d).abs() < 1e-6);
        assert!((f64::from(maps.plane(Quantity::RhoT, 0).unwrap()[0]) - r.rho_t).abs() < 1e-6);
        assert!(maps.plane(Quantity::RhoT, 0).unwrap()[1].is_nan());
    }
}
