//! Views of kind `capture` as rows: pictures from a fit compared with frames that the fit did not see, from
//! `check.json`.

use crate::model::{QualityLevel, ReportPicture, VerdictReason};
use crate::number::significant;
use crate::scene::picture;
use crate::size::ReportDetail;
use mesophyll_scene::verdict::CaptureFigures;
use serde::Serialize;
use std::path::Path;

/// A leaf as its scan saw it. Errors are in units of the measurement's noise.
#[derive(Debug, Clone, Default, Serialize)]
pub struct CaptureRow {
    pub name: String,
    pub leaf: String,
    pub side: String,
    pub pass: String,
    pub frame: u64,
    pub readings: u64,
    pub passed: bool,
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

/// The rows of a `check.json`.
pub fn rows(folder: &Path, captures: Vec<CaptureFigures>, pictures: Option<ReportDetail>) -> Vec<CaptureRow> {
    captures.into_iter().map(|c| row(folder, c, pictures)).collect()
}

fn row(folder: &Path, c: CaptureFigures, pictures: Option<ReportDetail>) -> CaptureRow {
    let shown = [
        (&c.measured_image, "Measured; the fit did not see it."),
        (&c.image, "Renderer."),
        (&c.reference_image, "Reference."),
        (&c.residual_image, "Measured less the renderer's, green: blue −4 σ, white 0, red +4 σ."),
    ];
    let find = |(file, caption): (&Option<String>, &str)| {
        let alt = format!("{}: {caption}", c.name);
        Some((caption.to_string(), picture(folder, file.as_deref(), &c.name, &[], &alt, pictures?.aside)?))
    };
    let pictures = shown.into_iter().filter(|(file, _)| file.is_some()).filter_map(find).collect();
    let known = |v: f64| v.is_finite().then_some(v);
    CaptureRow {
        frame: c.frame as u64,
        readings: c.readings as u64,
        passed: c.passed,
        allowed: known(c.allowed),
        expected: known(c.expected),
        renderer_off: known(c.renderer.off),
        renderer_chi2: known(c.renderer.reduced_chi2),
        reference_off: known(c.reference.off),
        reference_chi2: known(c.reference.reduced_chi2),
        bounded_off: known(c.bounded.off),
        from_model: known(c.renderer.from_model),
        pictures,
        name: c.name,
        leaf: c.leaf,
        side: c.side,
        pass: c.pass,
        why: c.why,
    }
}

/// The verdict's sentence about these rows; `None` where there are none.
pub fn reason(rows: &[CaptureRow]) -> Option<VerdictReason> {
    let missed: Vec<&str> = rows.iter().filter(|r| !r.passed).map(|r| r.name.as_str()).collect();
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
