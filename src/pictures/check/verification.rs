//! Whether the fits that a scene uses are still as they were fitted: their content hashes, and whether their numbers
//! agree with each other and with the blade.

use crate::consistency;
use mesophyll_base::error::Result;
use mesophyll_fits::consistency::{ConsistencyFaults, FileChange};
use mesophyll_fits::leaf_folder::LeafFit;
use mesophyll_fits::record::RECORD;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::placed::ledger::Ledger;
use std::path::Path;

/// What the fits of a scene say against themselves: fits of leaves, of translucency maps, of branches and of lawns. A
/// file that the scene does not need is no fault of it, and is named as a note.
///
/// # Errors
/// [`mesophyll_base::error::Error::Input`] for a file that cannot be read.
pub fn verify(scene: &LoadedScene, ledger: &Ledger) -> Result<ConsistencyFaults> {
    let mut faults = scene.faults(ledger)?;
    let leaves = scene.placed.leaves.iter();
    let opened: Vec<&LeafFit> = leaves
        .flat_map(|l| [l.fitted.as_ref(), l.translucent.as_ref().and_then(|t| t.fitted.as_ref())])
        .flatten()
        .collect();
    let unneeded = |path: &Path| {
        let needed = scene.plan.needed.iter().any(|need| need.file.as_deref() == Some(path));
        !needed && !path.ends_with(RECORD) && opened.iter().any(|fit| path.starts_with(&fit.folder))
    };
    let (beside, changed): (Vec<FileChange>, _) = faults.changed.into_iter().partition(|c| unneeded(&c.path));
    faults.changed = changed;
    faults.notes.extend(beside.into_iter().map(|c| c.said));
    for leaf in scene.leaves() {
        faults.contradictions.extend(consistency::contradictions(leaf, ledger)?);
    }
    Ok(faults)
}
