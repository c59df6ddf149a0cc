//! What a scene states about single branches of a plant instead of the plant's file: a measured taper and load, and how
//! the wind moves them. H9 Fig. 4.17 changes the same quantities for a level and for one branch.

use crate::manifest::{BranchOverride, SceneManifest};
use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use mesophyll_fits::record::FitRecord;
use mesophyll_plants::form::Plant;
use std::path::Path;

/// The largest number of names that an error lists.
const LISTED: usize = 8;

/// Changes a plant by what plant `index` of the manifest states about its branches. What is stated for a branch goes
/// before what is stated for its level.
///
/// # Errors
/// [`Error::Input`] for a branch or level that the plant lacks, and for a fit that cannot be read or that did not
/// determine a needed quantity.
pub fn apply(manifest: &SceneManifest, index: usize, plant: &mut Plant, ledger: &Ledger) -> Result<()> {
    let (levels, names): (Vec<_>, Vec<_>) = manifest.plants[index].branches.iter().partition(|o| o.level.is_some());
    for own in levels.into_iter().chain(names) {
        let mine = |b: &mesophyll_plants::form::Branch| match (&own.name, own.level) {
            (Some(name), _) => b.name == *name,
            (None, level) => level == Some(b.level),
        };
        let found: Vec<usize> = (0..plant.branches.len()).filter(|k| mine(&plant.branches[*k])).collect();
        if found.is_empty() {
            return Err(unknown(manifest, index, plant, own));
        }
        let (taper, load) = match &own.fit {
            None => (own.taper, own.load_over_stiffness_mm),
            Some(folder) => {
                let (taper, load) = fitted(manifest, own, &manifest.resolve(folder), ledger)?;
                (Some(taper), Some(load))
            }
        };
        for k in found {
            let branch = &mut plant.branches[k];
            if let Some(taper) = taper {
                branch.set_taper(taper);
            }
            if let Some(load) = load {
                (branch.load, branch.bending_load) = (load, load);
            }
            let to = &mut branch.stated;
            to.lean_per_m_s = own.lean_per_m_s.or(to.lean_per_m_s);
            to.resonance_hz = own.resonance_hz.or(to.resonance_hz);
            to.damping = own.damping.or(to.damping);
        }
    }
    Ok(())
}

/// The error for a branch or level that the plant lacks.
fn unknown(manifest: &SceneManifest, index: usize, plant: &Plant, own: &BranchOverride) -> Error {
    let (key, found, expected) = match (&own.name, own.level) {
        (Some(name), _) => {
            let mut names: Vec<&str> = plant.branches.iter().take(LISTED).map(|b| b.name.as_str()).collect();
            if plant.branches.len() > LISTED {
                names.push("…");
            }
            ("name", format!("\"{name}\""), format!("a branch of the plant ({})", names.join(", ")))
        }
        (None, level) => {
            let most = plant.branches.iter().map(|b| b.level).max().unwrap_or(0);
            ("level", level.unwrap_or(0).to_string(), format!("a level of the plant, 0 to {most}"))
        }
    };
    Error::unexpected(&manifest.path, &format!("plant {}: branch.{key}", index + 1), found, expected)
}

/// Taper and load of a measured branch.
fn fitted(manifest: &SceneManifest, own: &BranchOverride, folder: &Path, ledger: &Ledger) -> Result<(f64, f64)> {
    let measured = own.measured.as_ref().or(own.name.as_ref()).map_or("", String::as_str);
    let record = ledger.note("read", format!("{measured}/fit.toml"), 0, || FitRecord::read(folder))?;
    let name = format!("branch {measured}");
    let place = folder.join("fit.toml");
    let Some(section) = record.sections.get(&name) else {
        let known: Vec<&str> = record.sections.keys().filter_map(|k| k.strip_prefix("branch ")).collect();
        let what = format!(
            "found no branch \"{measured}\", expected one of {} ({})",
            known.join(", "),
            manifest.path.display()
        );
        return Err(Error::field(&place, &name, what));
    };
    let one = |key: &str| match section.params.get(key) {
        Some(p) if p.undetermined.is_empty() && p.value.first().is_some_and(|v| v.is_finite()) => Ok(p.value[0]),
        Some(p) if !p.undetermined.is_empty() => {
            Err(Error::field(&place, &format!("{name}, {key}"), p.undetermined.join("; ")))
        }
        _ => Err(Error::field(&place, &format!("{name}, {key}"), "missing, expected a fitted number")),
    };
    Ok((one("alpha")?, one("load_over_stiffness")?))
}
