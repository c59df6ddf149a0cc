//! A card view: one leaf's mean parameters on a flat patch, whose radiance has a closed form. Renderer and reference
//! are both compared with it.

use crate::cost::timed;
use crate::pictures::save;
use crate::{Options, proof, told};
use mesophyll_base::error::Result;
use mesophyll_scene::draw::card::{self, LeafCard};
use mesophyll_scene::draw::handover;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::CardView;
use mesophyll_scene::placed::daylight::sun_direction;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_scene::verdict::{ReferenceError, ViewFigures, exceeds};
use mesophyll_transport::{self as transport, comparison};
use mesophyll_viewer as gpu;
use std::time::Instant;

/// Pixels of a card that are compared with the closed form.
const COLUMNS: usize = 24;
const ROWS: usize = 18;

pub fn one_card(
    scene: &LoadedScene,
    view: &CardView,
    renderer: &mut gpu::Renderer,
    options: &Options,
    ledger: &Ledger,
) -> Result<ViewFigures> {
    let manifest = &scene.manifest;
    let size = (manifest.check.width, manifest.check.height);
    let (w, h) = (size.0 as usize, size.1 as usize);
    let card = LeafCard::new(scene, view, ledger)?;
    renderer.set_scene(&handover::card(scene, &card, ledger)?).map_err(told)?;
    let picture = renderer.render(&handover::camera(&view.camera), size.0, size.1).map_err(told)?;
    let mut out = timed(manifest, view.into(), &view.camera, renderer)?;
    proof::judge_view(manifest, &view.camera, renderer, options, &mut out)?;
    let start = Instant::now();
    let world = card::world(manifest, &card)?;
    let sampling = transport::Options {
        samples_per_pixel: 16,
        sun_samples: 1,
        seed: manifest.check.seed,
        ..transport::Options::default()
    };
    let truth = transport::render(&world, &view.camera, w, h, &sampling)?;
    let reference_s = start.elapsed().as_secs_f64();
    // The lobe's albedo under a sky is integrated for every pixel that is compared, so only a few hundred over the
    // picture are.
    let pixels: Vec<(usize, usize)> = (0..ROWS * COLUMNS)
        .map(|k| ((2 * (k % COLUMNS) + 1) * w / (2 * COLUMNS), (2 * (k / COLUMNS) + 1) * h / (2 * ROWS)))
        .collect();
    let exact = card.closed_form(manifest, view, (w, h), &pixels)?;
    let seen = comparison::compare(&truth, &picture.ldr)?;
    let (worst, at) = relative(&picture.hdr, w, &pixels, &exact);
    // The reference spreads its rays over pixel and sun. Few pixels with many rays show its own distance from the
    // formula.
    let fine = transport::Options { samples_per_pixel: 64, sun_samples: 16, ..sampling };
    let own = transport::render(&world, &view.camera, 2 * COLUMNS, 2 * ROWS, &fine)?;
    let own_pixels: Vec<(usize, usize)> = (0..ROWS * COLUMNS).map(|k| (2 * (k % COLUMNS), 2 * (k / COLUMNS))).collect();
    let own_exact = card.closed_form(manifest, view, (2 * COLUMNS, 2 * ROWS), &own_pixels)?;
    let (reference_worst, _) = relative(&own.hdr, 2 * COLUMNS, &own_pixels, &own_exact);
    out.error = Some(ReferenceError {
        flip_mean: seen.flip_mean,
        flip_p99: seen.flip_p99,
        max_error: Some(worst),
        max_at: Some(at),
        interior_share: seen.interior_share,
        noise_max_error: Some(reference_worst),
        reference_s,
        ..ReferenceError::default()
    });
    let limit = out.threshold_max_error.unwrap_or(0.0);
    for (who, error) in [("the renderer", worst), ("the reference", reference_worst)] {
        if exceeds(error, limit) {
            out.why.push(format!("{who} is {error:.2e} (relative) from the closed form, at most {limit:.2e} allowed"));
        }
    }
    if exact.iter().flatten().all(|v| *v <= 0.0) && sun_direction(manifest).is_some() {
        out.why.push("the card is black: nothing was compared".into());
    }
    save(&mut out, options, &truth, &picture, &seen)?;
    out.passed = Some(out.why.is_empty());
    Ok(out)
}

/// Largest relative difference of the radiance from the closed form, and the pixel where it occurs. The denominator is
/// at least a tenth of a thousandth of the brightest radiance.
fn relative(found: &[[f32; 4]], width: usize, pixels: &[(usize, usize)], exact: &[[f64; 3]]) -> (f64, (usize, usize)) {
    let floor = 1e-4 * exact.iter().flatten().fold(0.0, |a: f64, b| a.max(*b));
    let mut worst = (0.0, (0, 0));
    for (&(x, y), b) in pixels.iter().zip(exact) {
        for c in 0..3 {
            let error = (f64::from(found[y * width + x][c]) - b[c]).abs() / b[c].max(floor).max(f64::MIN_POSITIVE);
            if exceeds(error, worst.0) {
                worst = (error, (x, y));
            }
        }
    }
    worst
}
