//! Views of kind `capture` as rows: pictures from a fit compared with frames that the fit did not see, from
//! `check.json`.

use crate::model::{QualityLevel, ReportPicture, VerdictReason};
use crate::number::significant;
use crate::scene::picture;
use crate::size::ReportDetail;
use serde::Serialize;
use serde_json::Value;
use std::path::Path;

/// A leaf as its scan saw it. Errors are in units of the measurement's noise.
#[derive(Debug, Clone, Default, Serialize)]
pub struct CaptureRow {
    pub name: String,
    pub leaf: String,
    pub side: String,
    pub pass: String,
    pub frame: Option<u64>,
    pub readings: Option<u64>,
    pub passed: Option<bool>,
    pub allowed: Option<f64>,
    pub expected: Option<f64>,
    pub renderer_off: Option<f64>,
    pub renderer_chi2: Option<f64>,
    pub reference_off: Option<f64>,
    pub reference_chi2: Option<f64>,
    /// How far the renderer's picture is from the exact tube integral (RMS).
    pub from_model: Option<f64>,
    /// The same with the V-cavity factor that scenes have and the fit does not.
    pub bounded_off: Option<f64>,
    pub why: Vec<String>,
    /// Pictures: measured, the renderer's, the reference's, and the residuals.
    #[serde(skip)]
    pub pictures: Vec<(String, ReportPicture)>,
}

/// The rows of a `check.json`; what was skipped, in sentences.
pub fn read(folder: &Path, json: &Value, pictures: Option<ReportDetail>) -> (Vec<CaptureRow>, Vec<String>) {
    let list = |key: &str| json.get(key).and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default();
    let skipped = list("skipped").iter().filter_map(|s| s.as_str().map(str::to_string)).collect();
    (list("captures").iter().map(|c| row(folder, c, pictures)).collect(), skipped)
}

fn row(folder: &Path, json: &Value, pictures: Option<ReportDetail>) -> CaptureRow {
    let text = |key: &str| json.get(key).and_then(Value::as_str).unwrap_or_default().to_string();
    let of = |who: &str, key: &str| json.get(who).and_then(|v| v.get(key)).and_then(Value::as_f64);
    let whole = |key: &str| json.get(key).and_then(Value::as_u64);
    let name = text("name");
    let shown = [
        ("measured_image", "Measured; the fit did not see it."),
        ("image", "Renderer."),
        ("reference_image", "Reference."),
        ("residual_image", "Measured less the renderer's, green: blue −4 σ, white 0, red +4 σ."),
    ];
    let find = |(key, caption): (&str, &str)| {
        let file = json.get(key).and_then(Value::as_str)?;
        Some((
            caption.to_string(),
            picture(folder, Some(file), &name, &[], &format!("{name}: {caption}"), pictures?.aside)?,
        ))
    };
    CaptureRow {
        leaf: text("leaf"),
        side: text("side"),
        pass: text("pass"),
        frame: whole("frame"),
        readings: whole("readings"),
        passed: json.get("passed").and_then(Value::as_bool),
        allowed: json.get("allowed").and_then(Value::as_f64),
        expected: json.get("expected").and_then(Value::as_f64),
        renderer_off: of("renderer", "off"),
        renderer_chi2: of("renderer", "reduced_chi2"),
        reference_off: of("reference", "off"),
        reference_chi2: of("reference", "reduced_chi2"),
        bounded_off: of("bounded", "off"),
        from_model: of("renderer", "from_model"),
        why: json
            .get("why")
            .and_then(Value::as_array)
            .into_iter()
            .flatten()
            .filter_map(|w| w.as_str().map(str::to_string))
            .collect(),
        pictures: shown.into_iter().filter_map(find).collect(),
        name,
    }
}

/// The verdict's sentence about these rows; `None` where there are none.
pub fn reason(rows: &[CaptureRow]) -> Option<VerdictReason> {
    let missed: Vec<&str> = rows.iter().filter(|r| r.passed != Some(true)).map(|r| r.name.as_str()).collect();
    if !missed.is_empty() {
        return Some(VerdictReason {
            level: QualityLevel::Bad,
            text: format!("pictures from the fit miss what was measured in {}", missed.join(", ")),
        });
    }
    let worst = rows.iter().filter_map(|r| r.renderer_off).fold(f64::NAN, f64::max);
    let frames = if rows.len() == 1 { "a frame".to_string() } else { format!("{} frames", rows.len()) };
    (!rows.is_empty()).then(|| VerdictReason {
        level: QualityLevel::Good,
        text: format!(
            "pictures give back {frames} that no fit saw, off by at most {} of the measurement's noise",
            significant(worst, 2)
        ),
    })
}
