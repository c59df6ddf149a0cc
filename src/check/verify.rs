//! Whether the fits that a scene uses are still as they were fitted: their content hashes, the record hash of their
//! numbers, and whether their maps agree with each other.

use crate::consistency;
use mesophyll_error::Result;
use mesophyll_leaf::LeafFit;
use mesophyll_placed::fits::reads;
use mesophyll_placed::ledger::Ledger;
use mesophyll_record::FitRecord;
use mesophyll_scene::loaded::Scene;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// One sentence for every fit that was changed since it was written: fits of leaves, of translucency maps and of
/// branches.
///
/// # Errors
/// [`mesophyll_error::Error::Input`] for a file that cannot be read.
pub fn verify(scene: &Scene, ledger: &Ledger) -> Result<Vec<String>> {
    let Scene { manifest, placed, plan, .. } = scene;
    let fits: Vec<&LeafFit> = placed
        .leaves
        .iter()
        .flat_map(|l| [l.fitted.as_ref(), l.translucent.as_ref().and_then(|t| t.fitted.as_ref())])
        .flatten()
        .collect();
    let branches = manifest
        .plants
        .iter()
        .flat_map(|p| &p.branches)
        .filter_map(|b| b.fit.as_ref())
        .map(|folder| manifest.resolve(folder));
    let folders: BTreeSet<PathBuf> = fits.iter().map(|f| f.folder.clone()).chain(branches).collect();
    let mut out: Vec<String> =
        folders.iter().filter_map(|f| FitRecord::verify_numbers(f).err()).map(|e| e.to_string()).collect();
    for fitted in fits {
        let prefix = format!("{}/", fitted.name);
        for need in &plan.needed {
            if let Some(file) = need.name.strip_prefix(&prefix)
                && need.bytes.is_some()
                && fitted.folder.join(file).is_file()
                && let Err(e) = reads::verify(fitted, file, ledger)
            {
                out.push(e.to_string());
            }
        }
    }
    for leaf in scene.leaves() {
        out.extend(consistency::contradictions(leaf, ledger)?);
    }
    Ok(out)
}
