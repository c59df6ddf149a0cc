//! `check.json` and `plan.json` as rows. What they do not state is left empty, never invented.

use crate::captures;
use crate::colour::data_uri;
use crate::model::{CheckReport, PictureTexels, PlanReport, ReportPicture, ViewReport};
use crate::packing::repacked;
use crate::size::ReportDetail;
use crate::{Error, Result};
use mesophyll_files::atomic::explain;
use mesophyll_scene::verdict::{CheckVerdict, ViewFigures};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::Path;

/// `FOLDER/check.json` with the pictures beside it; `None` when there is none.
///
/// # Errors
/// [`Error::Input`] when the file exists and is not what a check writes.
pub(crate) fn read_check(folder: &Path, pictures: Option<ReportDetail>) -> Result<Option<CheckReport>> {
    let Some(verdict) = read_json::<CheckVerdict>(&folder.join("check.json"))? else { return Ok(None) };
    let mut missing = Vec::new();
    let views = verdict.views.iter().map(|v| view(folder, v, pictures, &mut missing)).collect();
    let named = !verdict.adapter.is_empty();
    Ok(Some(CheckReport {
        folder: folder.display().to_string(),
        passed: verdict.passed,
        adapter: if named { verdict.adapter } else { "adapter not named".into() },
        views,
        captures: captures::rows(folder, verdict.captures, pictures),
        skipped: verdict.skipped,
        missing,
    }))
}

fn view(folder: &Path, of: &ViewFigures, pictures: Option<ReportDetail>, missing: &mut Vec<String>) -> ViewReport {
    let name = of.name.clone();
    let files = of.pictures.as_ref();
    let mut find = |kind: &str, named: Option<&String>, endings: &[&str]| {
        let step = if matches!(kind, "flip" | "difference") { pictures?.aside } else { pictures?.shots };
        let found = picture(folder, named.map(String::as_str), &name, endings, &format!("{name}: {kind}"), step);
        if found.is_none() {
            missing.push(format!("view {name}: no {kind} picture"));
        }
        found
    };
    let image = find("image", files.map(|f| &f.image), &["", "-image", "_image", ".image"]);
    let reference = find("reference", files.map(|f| &f.reference), &["-reference", "_reference", ".reference"]);
    let difference = find(
        "difference",
        files.map(|f| &f.difference),
        &["-difference", "_difference", ".difference", "-diff", "_diff", ".diff"],
    );
    let flip = find("flip", files.map(|f| &f.flip), &["-flip", "_flip", ".flip"]);
    let alt = format!("{name}: the true leaf");
    let true_leaf = of.true_leaf.as_ref().zip(pictures);
    let true_leaf = true_leaf.and_then(|(t, detail)| picture(folder, Some(&t.picture), &name, &[], &alt, detail.shots));
    // The tables of the page name the figures as the file does.
    let json = serde_json::to_value(of).unwrap_or_default();
    let numbers = json.as_object().into_iter().flatten().filter_map(|(k, v)| Some((k.clone(), v.as_f64()?)));
    let figures: BTreeMap<String, f64> = numbers.collect();
    ViewReport {
        passed: of.passed,
        kind: of.kind,
        why: of.why.clone(),
        name,
        figures,
        image,
        reference,
        difference,
        flip,
        true_leaf,
    }
}

/// The PNG that the view names, otherwise `NAME-reference.png` and the like. Names never lead out of the folder.
pub(super) fn picture(
    folder: &Path,
    named: Option<&str>,
    view: &str,
    endings: &[&str],
    alt: &str,
    step: usize,
) -> Option<ReportPicture> {
    let inside = |name: &str| {
        let path = Path::new(name);
        path.components().all(|c| matches!(c, std::path::Component::Normal(_))).then(|| folder.join(path))
    };
    let guesses = endings.iter().map(|e| format!("{view}{e}.png"));
    named.map(str::to_string).into_iter().chain(guesses).filter_map(|n| inside(&n)).find_map(|path| {
        let bytes = std::fs::read(&path).ok()?;
        let decoder = png::Decoder::new(std::io::Cursor::new(&bytes));
        let reader = decoder.read_info().ok()?;
        let (width, height) = (reader.info().width as usize, reader.info().height as usize);
        let texels = PictureTexels { columns: width, rows: height, step, scale: None };
        let uri = data_uri("image/png", &repacked(&bytes, step)?);
        let [width, height] = [width, height].map(|side| side.div_ceil(step));
        Some(ReportPicture { uri, width, height, alt: alt.into(), texels, values: None })
    })
}

/// `FOLDER/plan.json`; `None` when there is none.
pub(crate) fn read_plan(folder: &Path) -> Result<Option<PlanReport>> {
    let found = read_json::<PlanReport>(&folder.join("plan.json"))?;
    Ok(found.map(|plan| PlanReport { folder: folder.display().to_string(), ..plan }))
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    if !path.exists() {
        return Ok(None);
    }
    let content = std::fs::read_to_string(path).map_err(|e| Error::input(path, explain(&e)))?;
    serde_json::from_str(&content).map(Some).map_err(|e| {
        let what = if e.is_data() { "not what this program writes there" } else { "not readable as JSON" };
        Error::input(path, format!("{what}: {e}"))
    })
}
