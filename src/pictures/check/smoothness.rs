//! Whether a film of the scene is smooth: no shortcut may make a part of it pop from one frame to the next.
//!
//! Leaves that move change a picture's pixels abruptly in any case, so the means of blocks are judged. The film is
//! drawn as always, and again in full: without levels of detail, and with all leaves. What these shortcuts add to a
//! block is the difference of both. They may change a displayed value by the scene's `tolerance`, so the second
//! difference of that in time, e(t−1) − 2e(t) + e(t+1), may be four times as large. A leaf that is suddenly drawn in
//! another way shows in it at once. What both films share is not judged by it: the samples at edges, and those of
//! shadow maps.

use crate::{blocks, told};
use mesophyll_base::error::{Error, Result};
use mesophyll_files::progress::TaskProgress;
use mesophyll_scene::draw::handover;
use mesophyll_scene::manifest::{CheckSettings, PerspectiveView, SceneManifest};
use mesophyll_scene::verdict::FilmSmoothness;
use mesophyll_transport::tone;
use mesophyll_viewer as gpu;
use mesophyll_viewer::scene as viewer;

/// Pixels along a side of a block.
const BLOCK: usize = CheckSettings::FILM_BLOCK as usize;

/// Displayed means of the blocks of one frame.
type Frame = Vec<[f64; 3]>;

/// Draws the film of `[check]` seen in `view`; `None` where the scene asks for none.
///
/// # Errors
/// [`Error::Input`] where nothing moves; those of drawing, and [`Error::Interrupted`] after a stop.
pub fn film(
    manifest: &SceneManifest,
    view: &PerspectiveView,
    drawn: &viewer::Scene,
    renderer: &mut gpu::Renderer,
) -> Result<Option<FilmSmoothness>> {
    let check = &manifest.check;
    if check.seconds == 0.0 {
        return Ok(None);
    }
    if drawn.wind.is_none() {
        return Err(Error::field(&manifest.path, "check.seconds", "given, but the scene's wind moves nothing"));
    }
    let frames = check.film_frames();
    let size = [check.width, check.height].map(|n| n as usize / BLOCK * BLOCK);
    let bar = TaskProgress::new("film", 2 * u64::from(frames));
    let mut shoot = |scene: &viewer::Scene| -> Result<Vec<Frame>> {
        renderer.set_scene(scene).map_err(told)?;
        let [w, h] = size;
        let frame = |k: u32| -> Result<Frame> {
            renderer.set_time(&viewer::WindState { time_s: manifest.time_of(view) + f64::from(k) / check.fps });
            let picture = renderer.render(&handover::camera(&view.camera), w as u32, h as u32).map_err(told)?;
            bar.step()?;
            let means = blocks::means(&picture.hdr, [w, h], BLOCK);
            let shown = |c: f32| tone::display(f64::from(c), manifest.exposure);
            Ok(means.iter().map(|m| [0, 1, 2].map(|c| shown(m[c]))).collect())
        };
        (0..frames).map(frame).collect()
    };
    let as_always = shoot(drawn)?;
    let in_full = shoot(&viewer::Scene { in_full: true, ..drawn.clone() })?;
    renderer.set_scene(drawn).map_err(told)?;
    let allowed = 4.0 * manifest.tolerated();
    Ok(Some(compared(&as_always, &in_full, check.fps, allowed, size[0] / BLOCK)))
}

/// The largest absolute second difference of films, with frame and block.
fn largest(films: impl Fn(usize, usize, usize) -> f64, frames: usize, blocks: usize) -> (f64, [usize; 2]) {
    let mut worst = (0.0, [0; 2]);
    for t in 1..frames.saturating_sub(1) {
        for block in 0..blocks {
            for c in 0..3 {
                let second = (films(t - 1, block, c) - 2.0 * films(t, block, c) + films(t + 1, block, c)).abs();
                // A number that is not finite is the worst, and stays so.
                if second.is_nan() {
                    return (second, [t, block]);
                }
                if second > worst.0 {
                    worst = (second, [t, block]);
                }
            }
        }
    }
    worst
}

fn compared(drawn: &[Frame], full: &[Frame], fps: f64, allowed: f64, columns: usize) -> FilmSmoothness {
    let (frames, blocks) = (drawn.len(), drawn.first().map_or(0, Vec::len));
    let of = |film: &[Frame]| largest(|t, b, c| film[t][b][c], frames, blocks).0;
    let (apart, [frame, block]) = largest(|t, b, c| drawn[t][b][c] - full[t][b][c], frames, blocks);
    let at = [frame, block % columns.max(1), block / columns.max(1)];
    FilmSmoothness { frames: frames as u32, fps, drawn: of(drawn), in_full: of(full), apart, allowed, at }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn film(value: impl Fn(f64, f64) -> f64) -> Vec<Frame> {
        (0..60).map(|t| (0..12).map(|b| [value(f64::from(t) / 30.0, f64::from(b)); 3]).collect()).collect()
    }

    /// A film that only moves smoothly passes whatever a constant error it has. A leaf that flickers in one block of
    /// one frame is found, and so is a level of detail that changes for good.
    #[test]
    fn what_pops_is_found_where_it_pops() {
        let smooth = |t: f64, b: f64| 0.4 + 0.2 * (4.0 * t + b).sin();
        let full = film(smooth);
        let fine = compared(&film(|t, b| smooth(t, b) + 0.003), &full, 30.0, 0.016, 4);
        assert!(fine.why().is_none() && fine.apart < 1e-12, "{fine:?}");
        // The second derivative of the sine, .2 · 16, over 30².
        assert!((fine.in_full / (0.2 * 16.0 / 900.0) - 1.0).abs() < 0.01, "{fine:?}");
        let mut flicker = full.clone();
        flicker[31][6][1] += 0.01;
        let found = compared(&flicker, &full, 30.0, 0.016, 4);
        assert!((found.apart - 0.02).abs() < 1e-12 && found.at == [31, 2, 1], "{found:?}");
        assert!(found.why().unwrap().contains("frame 31: something pops in the block at column 2 and row 1"));
        let changed = film(|t, b| smooth(t, b) + if t > 1.0 && b == 3.0 { 0.02 } else { 0.0 });
        let found = compared(&changed, &full, 30.0, 0.016, 4);
        assert!(found.why().is_some() && found.at[1..] == [3, 0] && (found.apart - 0.02).abs() < 1e-12, "{found:?}");
        let mut lost = full.clone();
        lost[5][2][0] = f64::NAN;
        assert!(compared(&lost, &full, 30.0, 0.016, 4).why().is_some());
    }
}
