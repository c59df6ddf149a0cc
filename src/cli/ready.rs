//! A scene together with every fit that it needs.

use crate::Result;
use mesophyll_files::progress;
use mesophyll_manifest::Manifest;
use mesophyll_placed::fits::missing;
use mesophyll_placed::ledger::Ledger;
use mesophyll_placed::{Placed, leaf::Search};
use mesophyll_scene::loaded::Scene;
use std::path::Path;

/// Reads what a scene needs. Fits that are missing are made first and kept below `out`; Ctrl-C stops between them.
///
/// # Errors
/// Those of the fits, and [`crate::Error::Input`] for what is wrong in the scene or in a fit.
pub fn scene(manifest: Manifest, out: &Path, ledger: &Ledger) -> Result<Scene> {
    let search = Search { out: Some(out), input_hash: Some(&missing::input_hash), free: false };
    let mut placed = Placed::new(&manifest, search, ledger)?;
    for index in placed.unfitted() {
        progress::go_on()?;
        let folder = missing::fit_folder(&manifest, index, out);
        missing::fit(&manifest, index, out, &folder, false, ledger)?;
        placed.find_again(&manifest, index, search, ledger)?;
    }
    if placed.unfitted().is_empty() {
        placed.make_translucency(&manifest, out, search, ledger)?;
    }
    Scene::new(manifest, placed, ledger)
}
