//! Makes the fits that a scene lacks: a synthetic scan where the scene describes one, an inspection of the capture, and
//! the fit.
//!
//! All results are kept in the run's folder (`captures/LEAF`, `fits/LEAF`). A run that was stopped continues from
//! there.

use super::source;
use crate::manifest::{FitOrigin, SceneManifest, StatedLeaf, StatedScan};
use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use mesophyll_capture::inspection::inspect;
use mesophyll_files::{atomic, claim, progress};
use mesophyll_fits::leaf as fit;
use mesophyll_fits::translucency as through;
use mesophyll_synth::leaf::SyntheticLeaf as Grown;
use mesophyll_synth::{
    scan,
    spec::{InteriorModel, LeafSpec},
};
use std::path::{Path, PathBuf};

/// The folder of a run's fit of a leaf.
pub fn fit_folder(manifest: &SceneManifest, index: usize, out: &Path) -> PathBuf {
    out.join("fits").join(manifest.leaves[index].data_name())
}

/// Makes the fit of leaf `index` in `folder`, or the maps of its look. Captures that must be scanned first go below
/// `out`. A folder that holds this very fit is left unchanged, unless everything is to be made `afresh`. That is for
/// another state of the program with the same version.
///
/// # Errors
/// As `fit leaf`, with these exit codes: 2 for an input that cannot be read, 130 when stopped (finished parts are
/// kept), 1 for a fit that failed as a whole.
pub fn fit(
    manifest: &SceneManifest,
    index: usize,
    out: &Path,
    folder: &Path,
    afresh: bool,
    ledger: &Ledger,
) -> Result<()> {
    let leaf = &manifest.leaves[index];
    if let Some(look) = leaf.look() {
        stop()?;
        let look = source::look_of(manifest, look);
        ledger.note("state", leaf.name.clone(), 0, || {
            mesophyll_fits::look::run(&look, leaf.data_name(), folder, afresh)
        })?;
        return Ok(());
    }
    let capture = match leaf.fit() {
        Some(FitOrigin { capture: Some(capture), .. }) => manifest.resolve(capture),
        Some(FitOrigin { scan: Some(scan), .. }) => scanned(manifest, leaf, scan, out, afresh, ledger)?,
        _ => {
            return Err(Error::field(
                &manifest.path,
                &format!("leaf \"{}\"", leaf.name),
                "there is no capture and no scan to fit it from",
            ));
        }
    };
    stop()?;
    let found = ledger.note("inspect", leaf.name.clone(), 0, || inspect(&capture, false))?;
    if let Some(problem) = found.problems.first() {
        return Err(Error::input(&capture, format!("this capture cannot be fitted: {problem}")));
    }
    for warning in &found.warnings {
        progress::say(format!("  {}: {warning}", leaf.name));
    }
    stop()?;
    ledger.note("fit", leaf.name.clone(), 0, || {
        fit::run(&capture, folder, &fit::Options { force: afresh, ..source::fit_options(leaf) })
    })?;
    Ok(())
}

/// Makes the translucency maps of leaf `index`, whose own fit is in `fitted`, in a run's folder `out`.
///
/// # Errors
/// As `fit translucency`.
pub fn translucency(manifest: &SceneManifest, index: usize, fitted: &Path, out: &Path, ledger: &Ledger) -> Result<()> {
    stop()?;
    let asked = manifest.leaves[index].translucency.clone().unwrap_or_default();
    let folder = super::translucency::folder(manifest, index, out);
    ledger
        .note("fit", format!("{} translucency", fitted.display()), 0, || {
            through::run(fitted, &folder, &asked.options())
        })
        .map(|_| ())
}

/// The scan of a leaf. It is made now, unless a complete one with the same specification exists.
fn scanned(
    manifest: &SceneManifest,
    leaf: &StatedLeaf,
    told: &StatedScan,
    out: &Path,
    afresh: bool,
    ledger: &Ledger,
) -> Result<PathBuf> {
    let folder = out.join("captures").join(leaf.data_name());
    let stamp = source::scan_stamp(out, leaf.data_name());
    let wanted = source::scan_hash(manifest, told)?;
    if !afresh
        && std::fs::read_to_string(&stamp).ok().as_deref() == Some(wanted.as_str())
        && folder.join("capture.toml").is_file()
    {
        return Ok(folder);
    }
    let _ = std::fs::remove_file(&stamp);
    // The folder may hold a scan with another specification, or one that was stopped. A measured capture is refused.
    let _claim = claim::capture(&folder, &[], true)?;
    let mut spec = LeafSpec::read(&manifest.resolve(&told.spec))?;
    if spec.model == InteriorModel::Foliar && (told.sigma_a.is_some() || told.sigma_s.is_some()) {
        let what =
            format!("given for {}, whose model is foliar; a leaf of layers has no σa and σs", told.spec.display());
        return Err(Error::field(&manifest.path, &format!("leaf \"{}\": scan.sigma_a, sigma_s", leaf.name), what));
    }
    spec.field_mm = told.field_mm.unwrap_or(spec.field_mm);
    spec.interior.sigma_a = told.sigma_a.unwrap_or(spec.interior.sigma_a);
    spec.interior.sigma_s = told.sigma_s.unwrap_or(spec.interior.sigma_s);
    let usual = scan::Options::default();
    let (width, height) = told.texels().unwrap_or((usual.width, usual.height));
    let options = scan::Options {
        width,
        height,
        frames: told.frames.unwrap_or(usual.frames),
        noise: told.noise.unwrap_or(usual.noise),
        seed: told.seed.unwrap_or(usual.seed),
        model: spec.model,
        ..usual
    };
    ledger.note("scan", leaf.name.clone(), 0, || -> Result<()> {
        let grown = Grown::grow(&spec, options.model, width, height).ok_or_else(|| {
            Error::field(
                &manifest.path,
                &format!("leaf \"{}\": scan.size", leaf.name),
                "not one texel lies on the leaf",
            )
        })?;
        claim::capturing(&folder, || scan::scan(&spec, &grown, &options, &folder)).map(|_| ())
    })?;
    atomic::write_bytes(&stamp, wanted.as_bytes())?;
    Ok(folder)
}

fn stop() -> Result<()> {
    if progress::stop_requested() {
        return Err(Error::Interrupted(
            "stopped; what was finished is kept, the same command goes on from there".into(),
        ));
    }
    Ok(())
}
