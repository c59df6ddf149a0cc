//! Makes the fits a scene still lacks: a synthetic scan where the scene asks for one, a look at the capture, the fit.
//!
//! Everything lands under the run's folder (`captures/LEAF`, `fits/LEAF`) and is kept: a run that was stopped goes on
//! where it was.

use super::source;
use crate::ledger::Ledger;
use crate::loaded::translucency;
use crate::manifest::{Leaf, Manifest, Scan, Tissue, Translucency};
use crate::plan::Plan;
use crate::{Error, Result};
use mesophyll_capture::inspect::inspect;
use mesophyll_capture::manifest::Travel;
use mesophyll_capture::reader::Capture;
use mesophyll_capture::synth::leaf::Leaf as Grown;
use mesophyll_capture::synth::{scan, spec::Spec};
use mesophyll_files::{atomic, claim, progress};
use mesophyll_fit::leaf as fit;
use mesophyll_fit::translucency as through;
use std::path::{Path, PathBuf};

/// What the fit of a scene's leaf is told: the lobe that it will be drawn with.
pub fn fit_options(leaf: &Leaf) -> fit::Options {
    fit::Options { lobe: leaf.lobe(), ..fit::Options::default() }
}

/// What `fit.toml` would record as its input if `capture` were fitted now.
pub fn input_hash(leaf: &Leaf, capture: &Path) -> Result<String> {
    fit::input_hash(&Capture::open(capture)?, &fit_options(leaf))
}

/// Where a run's fit of a leaf goes.
pub fn fit_folder(manifest: &Manifest, index: usize, out: &Path) -> PathBuf {
    out.join("fits").join(manifest.leaves[index].data_name())
}

/// Makes the fit of leaf `index` into `folder`; captures that have to be scanned first lie under `out`. A folder that
/// holds this very fit is left as it is unless all is to be made `afresh` (by another state of the program, whose
/// version says nothing of it).
///
/// # Errors
/// As `fit leaf`: 2 for an input that cannot be read, 130 when stopped (finished parts are kept), 1 for a fit that as a
/// whole failed.
pub fn fit(manifest: &Manifest, index: usize, out: &Path, folder: &Path, afresh: bool, ledger: &Ledger) -> Result<()> {
    let leaf = &manifest.leaves[index];
    let capture = match (&leaf.capture, &leaf.scan) {
        (Some(capture), _) => manifest.resolve(capture),
        (None, Some(scan)) => scanned(manifest, leaf, scan, out, afresh, ledger)?,
        (None, None) => {
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
        fit::run(&capture, folder, &fit::Options { force: afresh, ..fit_options(leaf) })
    })?;
    Ok(())
}

/// Makes what translucency maps a plan still lacks, of leaves whose own fits are there, into a run's folder `out`.
/// Whether any were made, so that the plan is to be made again.
///
/// # Errors
/// As `fit translucency`.
pub fn translucencies(manifest: &Manifest, plan: &Plan, out: &Path, ledger: &Ledger) -> Result<bool> {
    let lacking = plan.untranslucent();
    for &index in &lacking {
        let Some(fitted) = &plan.leaves[index].fitted else { continue };
        stop()?;
        let asked = manifest.leaves[index].translucency.clone().unwrap_or_default();
        translucency(&fitted.folder, &translucency::folder(manifest, index, out), &asked, ledger)?;
    }
    Ok(!lacking.is_empty())
}

/// Makes the translucency maps of the leaf fitted into `leaf`.
fn translucency(leaf: &Path, folder: &Path, asked: &Translucency, ledger: &Ledger) -> Result<()> {
    let tissue = match asked.tissue {
        Tissue::Fit => through::TissueFrom::Fit,
        Tissue::Table => through::TissueFrom::Table,
    };
    let basis = asked.basis.unwrap_or_default().functions();
    let options = through::Options { tissue, colour: asked.colour, basis, ..through::Options::default() };
    ledger
        .note("fit", format!("{} translucency", leaf.display()), 0, || through::run(leaf, folder, &options))
        .map(|_| ())
}

/// The scan of a leaf, made now unless a whole one of the same specification is there.
fn scanned(
    manifest: &Manifest,
    leaf: &Leaf,
    told: &Scan,
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
    // What is there may be a scan of another specification, or one that was stopped half way; a measured capture is
    // refused.
    claim::capture(&folder, &[], true)?;
    let mut spec = Spec::read(&manifest.resolve(&told.spec))?;
    spec.field_mm = told.field_mm.unwrap_or(spec.field_mm);
    let (width, height) = size(told).unwrap_or((720, 540));
    let options = scan::Options {
        width,
        height,
        frames: told.frames.unwrap_or(100),
        passes: vec![Travel::X, Travel::Y],
        noise: told.noise.unwrap_or(0.01),
        seed: told.seed.unwrap_or(1),
        model: spec.model,
        raw_exposures: false,
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

/// `240x180`, where it is one.
pub fn size(scan: &Scan) -> Option<(usize, usize)> {
    let (w, h) = scan.size.as_deref()?.split_once('x')?;
    let one = |t: &str| t.trim().parse::<usize>().ok().filter(|v| (1..=16_384).contains(v));
    Some((one(w)?, one(h)?))
}

fn stop() -> Result<()> {
    if progress::stop_requested() {
        return Err(Error::Interrupted(
            "stopped; what was finished is kept, the same command goes on from there".into(),
        ));
    }
    Ok(())
}
