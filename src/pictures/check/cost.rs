//! The cost of a frame: a view's times, and the share of the translucency maps, measured by drawing with and without
//! them in turns.

use crate::told;
use mesophyll_base::error::Result;
use mesophyll_base::statistics::median_of;
use mesophyll_scene::draw::handover;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_scene::verdict::{AdapterUpload, CheckVerdict, FrameCost, TranslucencyCost, ViewFigures, exceeds};
use mesophyll_transport::ReferenceCamera;
use mesophyll_viewer as gpu;

/// A view's report with its times, which are judged on real GPUs.
pub fn timed(
    manifest: &SceneManifest,
    view: ViewFigures,
    camera: &ReferenceCamera,
    renderer: &mut gpu::Renderer,
) -> Result<ViewFigures> {
    let (w, h) = (manifest.check.width, manifest.check.height);
    let timing = renderer.time(&handover::camera(camera), w, h, manifest.check.frames as usize).map_err(told)?;
    Ok(of(view, &timing, renderer))
}

/// A view's report with these times.
pub fn of(mut out: ViewFigures, timing: &gpu::FrameTiming, renderer: &gpu::Renderer) -> ViewFigures {
    // A pass that was timed less often than the frames was kept in them.
    let frames = timing.frame_ms.len();
    let cost = FrameCost {
        frame_ms_median: timing.quantile(0.5).unwrap_or(f64::NAN),
        frame_ms_p95: timing.quantile(0.95).unwrap_or(f64::NAN),
        triangles: renderer.stats().triangles,
        pass_ms: timing.passes.iter().map(|(n, t)| (n.clone(), middle(t))).collect(),
        kept_passes: timing.passes.iter().filter(|(_, t)| t.len() < frames).map(|(n, _)| n.clone()).collect(),
    };
    if let Some(limit) = judged(out.threshold_frame_ms, renderer)
        && exceeds(cost.frame_ms_median, limit)
    {
        out.why.push(format!("a frame takes {:.2} ms (median), at most {limit:.2} ms allowed", cost.frame_ms_median));
    }
    out.cost = Some(cost);
    out
}

/// The limit by which the time of a frame is judged, unless a CPU draws.
pub fn judged(frame_ms: Option<f64>, renderer: &gpu::Renderer) -> Option<f64> {
    frame_ms.filter(|_| !renderer.adapter().is_software)
}

/// Notes what is on the adapter: buffers, textures and pipelines.
pub fn on_adapter(renderer: &gpu::Renderer, report: &mut CheckVerdict) {
    let uploads = renderer.stats().uploads.iter();
    report.uploads = uploads.map(|u| AdapterUpload { name: u.name.clone(), bytes: u.bytes }).collect();
    report.uploaded_bytes = Some(report.uploads.iter().map(|u| u.bytes).sum());
    report.pipelines = renderer.stats().pipelines.clone();
}

/// Draws the first view with and without the translucency maps, by turns, and gives the maps back.
pub fn term(
    manifest: &SceneManifest,
    scene: &gpu::scene::Scene,
    renderer: &mut gpu::Renderer,
    timed: bool,
) -> Result<Option<TranslucencyCost>> {
    let has = |l: &gpu::scene::LeafMaterial| l.sides.iter().any(|(_, s)| s.translucency.is_some());
    let own: Vec<usize> = (0..scene.materials.len()).filter(|&k| scene.leaf(k).is_some_and(has)).collect();
    let view = manifest.perspectives().next();
    let (Some(view), false) = (view, own.is_empty()) else { return Ok(None) };
    let mut plain = scene.clone();
    for &k in &own {
        plain.leaf_mut(k).into_iter().flat_map(|l| l.sides.iter_mut()).for_each(|(_, s)| s.translucency = None);
    }
    let longest = |scene: &gpu::scene::Scene, renderer: &gpu::Renderer| {
        own.iter().filter_map(|&k| renderer.operations(scene, k)).max().unwrap_or_default()
    };
    let mut cost = TranslucencyCost {
        operations: longest(scene, renderer),
        operations_without: longest(&plain, renderer),
        ..TranslucencyCost::default()
    };
    if !timed {
        return Ok(Some(cost));
    }
    let mut times = [Vec::new(), Vec::new()];
    for turn in 0..4 {
        let which = turn % 2;
        let drawn = if which == 0 { scene } else { &plain };
        for &k in &own {
            renderer.set_material(drawn, k).map_err(told)?;
        }
        let (w, h) = (manifest.check.width, manifest.check.height);
        let timing = renderer
            .time(&handover::camera(&view.camera), w, h, (manifest.check.frames as usize).min(10))
            .map_err(told)?;
        let main = timing.passes.iter().find(|(n, _)| n == "main").map_or(&timing.frame_ms, |(_, t)| t);
        times[which].extend(main);
    }
    for &k in &own {
        renderer.set_material(scene, k).map_err(told)?;
    }
    [cost.main_ms, cost.main_ms_without] = times.map(|t| Some(middle(&t)));
    Ok(Some(cost))
}

/// The median; 0 of nothing.
fn middle(list: &[f64]) -> f64 {
    median_of(list.iter().copied()).unwrap_or(0.0)
}
