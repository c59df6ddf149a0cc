//! A fitted leaf whose reflectances were found elsewhere: it is stated, and says nothing of its tissue any more.

use super::edit::LeafSideEdit;
use super::{BLADE, LeafFit, LeafFitFile, Result};
use crate::record::{FitKind, RecordSection, STATED};
use mesophyll_files::atomic::{self, explain};
use mesophyll_files::hash;
use mesophyll_files::image::{self, Packing};
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Sides;
use std::path::Path;

/// Writes a fitted leaf as a stated look into `target`: ρd and ρt are those of the fit's slab and γ, times the factors
/// of `edits`, and `how` says where these come from. σa, σs and γ, of which ρd and ρt would no longer be those, are
/// left out.
///
/// # Errors
/// As [`super::edit::save`].
pub fn save(leaf: &LeafFit, edits: &Sides<LeafSideEdit>, target: &Path, how: &str) -> Result<()> {
    atomic::probe_folder(target)?;
    let mut record = leaf.record.clone();
    let fitted = format!("those of the fit {} ({})", record.name, record.input_hash);
    record.kind = FitKind::Look;
    record.name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    record.options.retain(|name, _| ["size", "texel_mm", "lobe"].contains(&name.as_str()));
    for (name, text) in [
        ("rho_d", format!("{fitted}, times factors that were {how}")),
        ("rho_t", format!("{fitted}, times factors that were {how}")),
        ("gloss", format!("{fitted}, times factors that were {how}")),
        ("normal", fitted.clone()),
        ("thickness", fitted),
    ] {
        record.options.insert(name.into(), format!("{STATED}{text}"));
    }
    (record.scan, record.termination, record.faults) = Default::default();
    let thickness = Quantity::Thickness.name();
    for section in record.sections.values_mut() {
        let (counts, mut params) = (std::mem::take(&mut section.counts), std::mem::take(&mut section.params));
        params.retain(|name, _| name == thickness);
        for param in params.values_mut() {
            param.stderr.iter_mut().for_each(|e| *e = f64::INFINITY);
            param.undetermined = vec![format!("{thickness}: stated, not fitted")];
        }
        *section = RecordSection { counts, params, ..RecordSection::default() };
    }
    let mut files = Vec::new();
    for side in leaf.sides() {
        let mut maps = leaf.edited(*edits).solved(side)?;
        for c in 0..3 {
            let factor = edits[side].rho_t[c];
            let plane = maps.plane_mut(Quantity::RhoT, c).unwrap_or_default();
            plane.iter_mut().for_each(|v| *v = (f64::from(*v) * factor) as f32);
        }
        let of_tissue = [Quantity::Gamma, Quantity::SigmaA, Quantity::SigmaS].map(|q| format!("{}.", q.name()));
        maps.channels.retain(|(name, _)| !of_tissue.iter().any(|prefix| name.starts_with(prefix)));
        image::write_exr(&LeafFitFile::Maps.path(target, side), &maps, Packing::Zip)?;
        files.push(LeafFitFile::Maps.name(side));
    }
    if record.files.contains_key(BLADE) {
        let from = leaf.folder.join(BLADE);
        let bytes = std::fs::read(&from).map_err(|e| super::Error::input(&from, explain(&e)))?;
        atomic::write_bytes(&target.join(BLADE), &bytes)?;
        files.push(BLADE.into());
    }
    let hashed = |name: String| Ok((name.clone(), hash::file(&target.join(&name))?));
    record.files = files.into_iter().map(hashed).collect::<Result<_>>()?;
    record.write(target)
}
