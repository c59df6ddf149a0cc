//! Whether the fits that a scene uses are what was fitted, and agree with themselves.

use super::LoadedScene;
use crate::Result;
use crate::placed::ledger::Ledger;
use mesophyll_fits::consistency::{self, ConsistencyFaults};
use std::collections::BTreeSet;
use std::path::PathBuf;

impl LoadedScene {
    /// Folders of the fits that the scene uses: of leaves, their translucency maps, branches and lawns. A fit of light
    /// between leaves is looked after when it is opened.
    fn fits(&self) -> BTreeSet<PathBuf> {
        let leaves = self.placed.leaves.iter();
        let opened = leaves.flat_map(|l| [l.fitted.as_ref(), l.translucent.as_ref().and_then(|t| t.fitted.as_ref())]);
        let branches = self.manifest.plants.iter().flat_map(|p| &p.branches).filter_map(|b| b.fit.as_ref());
        let lawns = self.manifest.grass.iter().filter_map(|g| g.fit.as_ref());
        let named = branches.chain(lawns).map(|folder| self.manifest.resolve(folder));
        opened.flatten().map(|fit| fit.folder.clone()).chain(named).collect()
    }

    /// What the fits of the scene say against themselves.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a record or a map that cannot be read.
    pub fn faults(&self, ledger: &Ledger) -> Result<ConsistencyFaults> {
        let mut out = ConsistencyFaults::default();
        for folder in self.fits() {
            let name = folder.display().to_string();
            let found = ledger.note("look for faults", name, 0, || consistency::of(&folder))?;
            out.changed.extend(found.changed);
            out.contradictions.extend(found.contradictions);
            out.notes.extend(found.notes);
            out.unseen.extend(found.unseen);
        }
        Ok(out)
    }

    /// For those that draw or export the scene without judging it: a fit that is not what was fitted is refused, and
    /// what its numbers say against each other is said.
    ///
    /// # Errors
    /// As [`ConsistencyFaults::require`] and [`LoadedScene::faults`].
    pub fn require_sound_fits(&self, ledger: &Ledger) -> Result<()> {
        self.faults(ledger)?.require()
    }
}
