//! Times of frames alone: every perspective view is drawn again and again as by a program that shows frames, without a
//! reference and without goldens.

use crate::{cost, told};
use mesophyll_base::error::Result;
use mesophyll_files::progress;
use mesophyll_scene::draw::handover;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_scene::verdict::{CheckVerdict, ViewScope};
use mesophyll_viewer as gpu;
use std::time::Instant;

/// The time between two frames of what moves (s).
const STEP: f64 = 1.0 / 30.0;
/// Frames of which the adapter's own clock times the passes.
const CLOCKED: usize = 3;

/// Draws `count` frames of every perspective view, each prepared while the adapter draws the one before, and notes
/// their times. `begun` is when the program began.
///
/// # Errors
/// Those of handing over and of drawing, and a stop that was asked for.
pub fn all(
    scene: &LoadedScene,
    renderer: &mut gpu::Renderer,
    count: usize,
    begun: Option<Instant>,
    ledger: &Ledger,
    report: &mut CheckVerdict,
) -> Result<()> {
    let manifest = &scene.manifest;
    let (w, h) = (manifest.check.width, manifest.check.height);
    let mut drawn = handover::scene(scene, ledger)?;
    renderer.set_scene(&drawn).map_err(told)?;
    cost::on_adapter(renderer, report);
    let views: Vec<_> = manifest.perspectives().collect();
    let bar = progress::TaskProgress::new("frames", (views.len() * count) as u64);
    for view in views {
        let camera = handover::camera(&view.camera);
        let mut show = |renderer: &mut gpu::Renderer, k: usize| {
            if let Some(wind) = &mut drawn.wind {
                wind.time_s = manifest.time_of(view) + STEP * k as f64;
                renderer.set_time(wind);
            }
            renderer.draw_ahead(&camera, w, h).map_err(told)
        };
        // The first frame draws what is kept, and is waited for.
        show(renderer, 0)?;
        gpu::readback::wait(renderer.gpu()).map_err(told)?;
        if report.first_frame_s.is_none() {
            report.first_frame_s = begun.map(|begun| begun.elapsed().as_secs_f64());
        }
        let mut frame_ms = Vec::with_capacity(count);
        // One frame ahead is under way before the first that is timed.
        show(renderer, 1)?;
        for k in 2..2 + count {
            let start = Instant::now();
            show(renderer, k)?;
            frame_ms.push(start.elapsed().as_secs_f64() * 1e3);
            bar.step()?;
        }
        gpu::readback::wait(renderer.gpu()).map_err(told)?;
        // The adapter's own clock needs frames that are waited for.
        let passes = renderer.time(&camera, w, h, CLOCKED).map_err(told)?.passes;
        let mut out = cost::of(view.into(), &gpu::FrameTiming { frame_ms, passes }, renderer);
        out.scope = ViewScope::Time;
        out.passed = cost::judged(view.frame_ms, renderer).is_some().then_some(out.why.is_empty());
        report.views.push(out);
    }
    Ok(())
}
