//! Checks views: each has a camera that sees something, and the limits that suit its kind.

use super::MOST_SECONDS;
use super::place::ManifestText;
use crate::manifest::{Result, SceneView, ViewKind};

/// The least number of blocks along a side of the picture. A mean over a large part of the picture would hide faults in
/// it.
const FEWEST_BLOCKS: u32 = 8;

pub fn views(p: &ManifestText) -> Result<()> {
    const HEADER: &str = "[[view]]";
    if p.manifest.views.is_empty() && p.manifest.periodic.is_none() {
        return Err(p.error("", 0, "view", "missing; expected at least one [[view]]"));
    }
    let mut names = p.names(HEADER, "view");
    for (i, view) in p.manifest.views.iter().enumerate() {
        names.take(i, &view.name)?;
        one_view(p, i, view)?;
    }
    Ok(())
}

fn one_view(p: &ManifestText, i: usize, view: &SceneView) -> Result<()> {
    const HEADER: &str = "[[view]]";
    let missing = |key: &str| p.error(HEADER, i, key, format!("missing; view \"{}\" needs it", view.name));
    if view.kind == ViewKind::Capture {
        return capture(p, i, view);
    }
    for (key, given) in [("side", view.side.is_some()), ("pass", view.pass.is_some()), ("frame", view.frame.is_some())]
    {
        if given {
            return Err(p.error(HEADER, i, key, "given, but only capture views have one"));
        }
    }
    let (Some(eye), Some(target)) = (view.eye_mm, view.target_mm) else {
        return Err(missing(if view.eye_mm.is_none() { "eye_mm" } else { "target_mm" }));
    };
    p.finite(HEADER, i, "eye_mm", &eye)?;
    p.finite(HEADER, i, "target_mm", &target)?;
    let forward = glam::DVec3::from(target) - glam::DVec3::from(eye);
    if forward.length() < 1e-9 {
        return Err(p.error(HEADER, i, "target_mm", "is where the eye is, expected another point"));
    }
    let up = glam::DVec3::from(view.up.unwrap_or([0.0, 0.0, 1.0]));
    p.finite(HEADER, i, "up", &up.to_array())?;
    if forward.normalize().cross(up.normalize_or_zero()).length() < 1e-6 {
        return Err(p.error(HEADER, i, "up", "points along the line of sight, expected a direction across it"));
    }
    p.range(HEADER, i, "fov_deg", view.fov_deg.ok_or_else(|| missing("fov_deg"))?, [0.1, 150.0], "degrees")?;
    for (key, limit) in [("max_error", view.max_error), ("flip_p99", view.flip_p99)] {
        limit.map_or(Ok(()), |limit| p.range(HEADER, i, key, limit, [0.0, 1.0], ""))?;
    }
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
        if view.kind != ViewKind::Perspective {
            return Err(p.error(HEADER, i, "blocks", "given, but only perspective views have them"));
        }
    }
    match view.kind {
        ViewKind::Perspective => {
            for (key, given) in [("leaf", view.leaf.is_some()), ("rotation_deg", view.rotation_deg.is_some())] {
                if given {
                    return Err(p.error(HEADER, i, key, "given, but only card views have one"));
                }
            }
        }
        ViewKind::Capture => {}
        ViewKind::Card => {
            p.fitted_leaf(HEADER, i, view.leaf.as_deref().ok_or_else(|| missing("leaf"))?)?;
            p.finite(HEADER, i, "rotation_deg", &view.rotation_deg.unwrap_or_default())?;
            if view.flip_p99.is_some() {
                return Err(p.error(HEADER, i, "flip_p99", "given, but a card is judged by max_error alone"));
            }
        }
    }
    if let Some(time) = view.time_s {
        let what = match (&p.manifest.wind, view.kind) {
            (_, ViewKind::Card | ViewKind::Capture) => "given, but a card does not move",
            (None, _) => "given, but the scene has no [wind]",
            _ => "",
        };
        if !what.is_empty() {
            return Err(p.error(HEADER, i, "time_s", what));
        }
        p.range(HEADER, i, "time_s", time, [-MOST_SECONDS, MOST_SECONDS], "s")?;
    }
    if let Some(ms) = view.frame_ms {
        p.positive(HEADER, i, "frame_ms", ms, "time")?;
    }
    Ok(())
}

/// Checks a view of a scan, which takes its camera and its light from the scan.
fn capture(p: &ManifestText, i: usize, view: &SceneView) -> Result<()> {
    const HEADER: &str = "[[view]]";
    p.fitted_leaf(
        HEADER,
        i,
        view.leaf
            .as_deref()
            .ok_or_else(|| p.error(HEADER, i, "leaf", format!("missing; view \"{}\" needs it", view.name)))?,
    )?;
    let given = [
        ("eye_mm", view.eye_mm.is_some()),
        ("target_mm", view.target_mm.is_some()),
        ("up", view.up.is_some()),
        ("fov_deg", view.fov_deg.is_some()),
        ("rotation_deg", view.rotation_deg.is_some()),
        ("time_s", view.time_s.is_some()),
        ("flip_p99", view.flip_p99.is_some()),
        ("frame_ms", view.frame_ms.is_some()),
        ("blocks", view.blocks.is_some()),
    ];
    if let Some((key, _)) = given.iter().find(|g| g.1) {
        return Err(p.error(HEADER, i, key, "given, but a capture view has the camera and the light of its scan"));
    }
    if let Some(most) = view.max_error {
        p.range(HEADER, i, "max_error", most, [0.0, 10.0], "of the measurement's noise")?;
    }
    Ok(())
}
