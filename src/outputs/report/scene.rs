//! `check.json` and `plan.json` as rows. Both are read leniently: what they do not state is left empty, never invented.

use crate::captures;
use crate::colour::data_uri;
use crate::model::{CheckReport, PictureTexels, PlanItem, PlanReport, ReportPicture, ViewReport};
use crate::packing::repacked;
use crate::size::ReportDetail;
use crate::{Error, Result};
use mesophyll_files::atomic::explain;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// `FOLDER/check.json` with the pictures beside it; `None` when there is none.
///
/// # Errors
/// [`Error::Input`] when the file exists and is not JSON.
pub(crate) fn read_check(folder: &Path, pictures: Option<ReportDetail>) -> Result<Option<CheckReport>> {
    let Some(json) = read_json(&folder.join("check.json"))? else { return Ok(None) };
    let mut missing = Vec::new();
    let views = json.get("views").and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
    let views = views.iter().enumerate().map(|(k, v)| view(folder, k, v, pictures, &mut missing)).collect();
    let (captures, skipped) = captures::read(folder, &json, pictures);
    Ok(Some(CheckReport {
        folder: folder.display().to_string(),
        passed: json.get("passed").and_then(Value::as_bool),
        adapter: json.get("adapter").map(text).filter(|a| !a.is_empty()).unwrap_or_else(|| "adapter not named".into()),
        views,
        captures,
        skipped,
        missing,
    }))
}

fn view(
    folder: &Path,
    index: usize,
    json: &Value,
    pictures: Option<ReportDetail>,
    missing: &mut Vec<String>,
) -> ViewReport {
    let name = json.get("name").map_or_else(|| format!("view {}", index + 1), text);
    let figures: BTreeMap<String, f64> = json
        .as_object()
        .map(|o| o.iter().filter_map(|(k, v)| Some((k.clone(), v.as_f64()?))).collect())
        .unwrap_or_default();
    let mut find = |kind: &str, endings: &[&str]| {
        let step = if matches!(kind, "flip" | "difference") { pictures?.aside } else { pictures?.shots };
        let named = json.get(kind).and_then(Value::as_str);
        let found = picture(folder, named, &name, endings, &format!("{name}: {kind}"), step);
        if found.is_none() {
            missing.push(format!("view {name}: no {kind} picture"));
        }
        found
    };
    let image = find("image", &["", "-image", "_image", ".image"]);
    let reference = find("reference", &["-reference", "_reference", ".reference"]);
    let difference = find("difference", &["-difference", "_difference", ".difference", "-diff", "_diff", ".diff"]);
    let flip = find("flip", &["-flip", "_flip", ".flip"]);
    let kind = json.get("kind").map(text).unwrap_or_default();
    let why = json.get("why").and_then(Value::as_array).map(|w| w.iter().map(text).collect()).unwrap_or_default();
    let true_leaf = json.get("true_leaf").and_then(Value::as_str).zip(pictures);
    let alt = format!("{name}: the true leaf");
    let true_leaf = true_leaf.and_then(|(file, detail)| picture(folder, Some(file), &name, &[], &alt, detail.shots));
    ViewReport {
        passed: json.get("passed").and_then(Value::as_bool),
        kind,
        why,
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
        let texels = PictureTexels { columns: width, rows: height, step };
        let uri = data_uri("image/png", &repacked(&bytes, step)?);
        let [width, height] = [width, height].map(|side| side.div_ceil(step));
        Some(ReportPicture { uri, width, height, alt: alt.into(), texels, values: None })
    })
}

/// `FOLDER/plan.json`; `None` when there is none.
pub(crate) fn read_plan(folder: &Path) -> Result<Option<PlanReport>> {
    let Some(json) = read_json(&folder.join("plan.json"))? else { return Ok(None) };
    let list = |key: &str| {
        let items = json.get(key).and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
        items.iter().map(item).collect()
    };
    Ok(Some(PlanReport { folder: folder.display().to_string(), needed: list("needed"), left_out: list("left_out") }))
}

fn item(json: &Value) -> PlanItem {
    let field = |key: &str| json.get(key).map(text).unwrap_or_default();
    match json {
        Value::Object(_) => PlanItem { name: field("name"), reason: field("reason"), saved: field("saved") },
        other => PlanItem { name: text(other), ..PlanItem::default() },
    }
}

fn text(value: &Value) -> String {
    match value {
        Value::String(s) => s.clone(),
        Value::Null => String::new(),
        other => other.to_string(),
    }
}

fn read_json(path: &Path) -> Result<Option<Value>> {
    if !path.exists() {
        return Ok(None);
    }
    let content = std::fs::read_to_string(path).map_err(|e| Error::input(path, explain(&e)))?;
    serde_json::from_str(&content).map(Some).map_err(|e| Error::input(path, format!("not readable as JSON: {e}")))
}
