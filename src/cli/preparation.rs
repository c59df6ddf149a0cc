//! Fits as others use them: what was fitted, unchanged. A scene together with every fit that it needs.

use crate::cli::Result;
use mesophyll_fits::consistency;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_scene::placed::{PlacedScene, leaf::LeafSearch};
use std::path::Path;

/// Looks at the fit in `folder` before it is used: one that was changed since it was fitted is refused, and numbers
/// that contradict each other are said. A folder without a fit is left to the one who reads it.
///
/// # Errors
/// [`crate::cli::Error::Missed`] for a changed fit, [`crate::cli::Error::Input`] for a damaged one.
pub fn fit(folder: &Path) -> Result<()> {
    if folder.join("fit.toml").is_file() { consistency::of(folder)?.require() } else { Ok(()) }
}

/// As [`fit`] for a reader that refuses a changed or damaged fit itself: only says what else is wrong.
pub fn warn(folder: &Path) {
    if let Ok(faults) = consistency::of(folder) {
        faults.warn();
    }
}

/// Reads what a scene needs. Fits that are missing are made first and kept below `out`; Ctrl-C stops between them.
///
/// # Errors
/// Those of the fits, [`crate::cli::Error::Input`] for what is wrong in the scene or in a fit, and
/// [`crate::cli::Error::Missed`] for a fit that was changed since it was fitted.
pub fn scene(manifest: SceneManifest, out: &Path, ledger: &Ledger) -> Result<LoadedScene> {
    let search = LeafSearch { out: Some(out), compared: true, free: false };
    let mut placed = PlacedScene::new(&manifest, search, ledger)?;
    placed.make_fits(&manifest, out, search, ledger, |_| true)?;
    if placed.unfitted().is_empty() {
        placed.make_translucency(&manifest, out, search, ledger)?;
    }
    let scene = LoadedScene::new(manifest, placed, ledger)?;
    scene.require_sound_fits(ledger)?;
    Ok(scene)
}
