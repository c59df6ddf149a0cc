//! Checks views: each has a camera that sees something, and the limits that suit its kind.

use super::MOST_SECONDS;
use super::place::ManifestText;
use crate::manifest::{CaptureView, CardView, PerspectiveView, Result, SceneView};
use glam::DVec3;
use mesophyll_transport::ReferenceCamera;

/// The least number of blocks along a side of the picture. A mean over a large part of the picture would hide faults in
/// it.
const FEWEST_BLOCKS: u32 = 8;

const HEADER: &str = "[[view]]";

pub fn views(p: &ManifestText) -> Result<()> {
    if p.manifest.views.is_empty() && p.manifest.periodic.is_none() {
        return Err(p.error("", 0, "view", "missing; expected at least one [[view]]"));
    }
    let mut names = p.names(HEADER, "view");
    for (i, view) in p.manifest.views.iter().enumerate() {
        names.take(i, view.name())?;
        match view {
            SceneView::Perspective(view) => perspective(p, i, view)?,
            SceneView::Card(view) => card(p, i, view)?,
            SceneView::Capture(view) => capture(p, i, view)?,
        }
    }
    Ok(())
}

fn camera(p: &ManifestText, i: usize, camera: &ReferenceCamera) -> Result<()> {
    for (key, place) in [("eye_mm", camera.eye), ("target_mm", camera.target), ("up", camera.up)] {
        p.finite(HEADER, i, key, &DVec3::to_array(&place))?;
    }
    let forward = camera.target - camera.eye;
    if forward.length() < 1e-9 {
        return Err(p.error(HEADER, i, "target_mm", "is where the eye is, expected another point"));
    }
    if forward.normalize().cross(camera.up.normalize_or_zero()).length() < 1e-6 {
        return Err(p.error(HEADER, i, "up", "points along the line of sight, expected a direction across it"));
    }
    p.range(HEADER, i, "fov_deg", camera.fov_y_deg, [0.1, 150.0], "degrees")
}

/// Checks limits of a picture: its errors, 0 to 1, and its time.
fn limits(p: &ManifestText, i: usize, errors: &[(&str, Option<f64>)], frame_ms: Option<f64>) -> Result<()> {
    for (key, limit) in errors {
        limit.map_or(Ok(()), |limit| p.range(HEADER, i, key, limit, [0.0, 1.0], ""))?;
    }
    frame_ms.map_or(Ok(()), |ms| p.positive(HEADER, i, "frame_ms", ms, "time"))
}

fn perspective(p: &ManifestText, i: usize, view: &PerspectiveView) -> Result<()> {
    camera(p, i, &view.camera)?;
    limits(p, i, &[("max_error", view.max_error), ("flip_p99", view.flip_p99)], view.frame_ms)?;
    if let Some(side) = view.blocks {
        let [w, h] = [p.manifest.check.width, p.manifest.check.height];
        if side < 2 || w.min(h) / side < FEWEST_BLOCKS {
            let [columns, rows] = [w, h].map(|n| n / side.max(1));
            let told = format!(
                "found {side}, with which {w} x {h} pixels have {columns} x {rows} blocks; expected 2 pixels or more, \
                 and {FEWEST_BLOCKS} x {FEWEST_BLOCKS} blocks or more"
            );
            return Err(p.error(HEADER, i, "blocks", told));
        }
    }
    let Some(time) = view.time_s else { return Ok(()) };
    if p.manifest.wind.is_none() {
        return Err(p.error(HEADER, i, "time_s", "given, but the scene has no [wind]"));
    }
    p.range(HEADER, i, "time_s", time, [-MOST_SECONDS, MOST_SECONDS], "s")
}

fn card(p: &ManifestText, i: usize, view: &CardView) -> Result<()> {
    camera(p, i, &view.camera)?;
    p.fitted_leaf(HEADER, i, &view.leaf)?;
    p.finite(HEADER, i, "rotation_deg", &view.rotation_deg)?;
    limits(p, i, &[("max_error", view.max_error)], view.frame_ms)
}

fn capture(p: &ManifestText, i: usize, view: &CaptureView) -> Result<()> {
    p.fitted_leaf(HEADER, i, &view.leaf)?;
    let most = view.max_error;
    most.map_or(Ok(()), |most| p.range(HEADER, i, "max_error", most, [0.0, 10.0], "of the measurement's noise"))
}
