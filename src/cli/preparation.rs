//! Fits as others use them: what was fitted, unchanged. A scene together with every fit that it needs.

use crate::cli::{Error, Result};
use mesophyll_fits::consistency;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::placed::fits::source::FitFreshness;
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
    let placed = PlacedScene::new(&manifest, search, ledger)?;
    completed(manifest, placed, out, ledger)
}

/// As [`scene`], with the fits of an earlier run of this scene in the folder `run`. What they lack is made there. A fit
/// of something else there is refused, because the one of this scene would take its place.
///
/// # Errors
/// As [`scene`]; [`crate::cli::Error::Usage`] for no folder, or one with a fit of something else.
pub fn scene_of_run(manifest: SceneManifest, run: &Path, ledger: &Ledger) -> Result<LoadedScene> {
    if !run.is_dir() {
        return Err(Error::argument("--run", run.display(), "the folder of an earlier run, check or render"));
    }
    let search = LeafSearch { out: Some(run), compared: true, free: false };
    let placed = PlacedScene::new(&manifest, search, ledger)?;
    let mut sources =
        placed.leaves.iter().flat_map(|l| l.source.iter().chain(l.translucent.as_ref().map(|t| &t.source)));
    if let Some(other) = sources.find(|source| source.status == FitFreshness::Stale) {
        let found = format!("{} ({})", run.display(), other.why);
        let expected = "a run of this scene as it is; without --run the fits are made in the folder of -o";
        return Err(Error::argument("--run", found, expected));
    }
    completed(manifest, placed, run, ledger)
}

/// Makes what a scene lacks in the folder `out`, where it was searched, and reads everything.
fn completed(manifest: SceneManifest, mut placed: PlacedScene, out: &Path, ledger: &Ledger) -> Result<LoadedScene> {
    let search = LeafSearch { out: Some(out), compared: true, free: false };
    placed.make_fits(&manifest, out, search, ledger, |_| true)?;
    if placed.unfitted().is_empty() {
        placed.make_translucency(&manifest, out, search, ledger)?;
    }
    let scene = LoadedScene::new(manifest, placed, ledger)?;
    scene.require_sound_fits(ledger)?;
    Ok(scene)
}
