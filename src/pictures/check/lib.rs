//! The check. Every view of a scene is drawn by the GPU renderer. It is compared with the CPU reference (a card: with
//! its closed form), with golden pictures where the scene has them, and with the thresholds that the scene states. A
//! check of the goldens alone needs no reference and takes seconds.
//!
//! Errors are those of displayed values, 0 to 1. The noise of the reference is measured with a second seed and printed
//! beside each threshold. Frame times are judged only on real GPUs.

#![warn(missing_docs)]

pub mod blocks;
mod capture;
mod card;
pub mod consistency;
pub mod cost;
pub mod day;
mod frames;
pub mod golden;
pub mod interiors;
pub mod methods;
mod perspective;
mod pictures;
mod proof;
mod smoothness;
pub mod sun_shares;

pub use consistency::verify;

use mesophyll_base::error::{Error, Result};
use mesophyll_files::{atomic, progress};
use mesophyll_scene::draw::scene_reference::SceneReference;
use mesophyll_scene::draw::{handover, reference, sunlight, true_leaf};
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::placed::ledger::Ledger;
pub use mesophyll_scene::verdict::{CheckVerdict, ViewFigures};
use mesophyll_transport as transport;
use mesophyll_viewer as gpu;
use std::path::PathBuf;
use std::time::Instant;

/// The options of a check, besides the scene.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Where pictures and `check.json` go.
    pub out: PathBuf,
    /// Write the scene's golden pictures anew instead of comparing with them.
    pub update_golden: bool,
    /// Only draw every view small, for its golden picture: no reference, no frame times.
    pub goldens_only: bool,
    /// Only time so many frames of every perspective view: no reference, no goldens.
    pub frames: Option<usize>,
    /// When the program began, for the time until the first frame.
    pub begun: Option<Instant>,
}

/// Opens the adapter.
///
/// # Errors
/// [`Error::Missed`] when there is none: a check never passes without having looked.
pub fn open() -> Result<gpu::Renderer> {
    gpu::Renderer::headless(&gpu::Options::default())
        .map_err(|e| Error::Missed(format!("nothing was checked: {e}{}", too_little_memory(&e))))
}

/// Drivers that find too little memory are not found themselves.
fn too_little_memory(e: &gpu::Error) -> String {
    if matches!(e, gpu::Error::NoAdapter) { mesophyll_files::memory::hint() } else { String::new() }
}

/// A renderer's error in our words.
pub fn told(e: gpu::Error) -> Error {
    Error::Missed(format!("the renderer failed: {e}{}", too_little_memory(&e)))
}

/// Checks every view.
///
/// # Errors
/// [`Error::Missed`] without an adapter; [`Error::Input`] for a leaf that is not fitted or a damaged file. A missed
/// threshold is no error here: see [`CheckVerdict::passed`].
pub fn check(scene: &LoadedScene, options: &Options, ledger: &Ledger) -> Result<CheckVerdict> {
    let LoadedScene { manifest, placed, plan, .. } = scene;
    if let Some(missing) = placed.unfitted().first() {
        let name = &manifest.leaves[*missing].name;
        return Err(Error::field(
            &manifest.path,
            &format!("leaf \"{name}\""),
            "not fitted yet; `mesophyll run` fits what a scene needs",
        ));
    }
    atomic::probe_folder(&options.out)?;
    let mut renderer = open()?;
    let adapter = renderer.adapter().clone();
    let faults = verify(scene, ledger)?;
    let mut report = CheckVerdict {
        scene: manifest.name.clone(),
        adapter: format!("{} ({}, {})", adapter.name, adapter.backend, adapter.driver),
        software: adapter.is_software,
        size: (!options.goldens_only).then_some([manifest.check.width, manifest.check.height]),
        reference_samples: (!options.goldens_only && options.frames.is_none()).then_some(manifest.check.samples),
        failures: faults.all().cloned().collect(),
        warnings: plan.warnings.iter().chain(&faults.notes).cloned().collect(),
        ..CheckVerdict::default()
    };
    progress::say(format!("drawn by {}", report.adapter));
    if let Some(count) = options.frames {
        frames::all(scene, &mut renderer, count, options.begun, ledger, &mut report)?;
    } else if options.goldens_only {
        proof::all(scene, &mut renderer, options, ledger, &mut report)?;
    } else {
        against_reference(scene, &mut renderer, options, ledger, &mut report)?;
    }
    report.judge();
    let path = options.out.join("check.json");
    atomic::write_bytes(&path, serde_json::to_string_pretty(&report).unwrap_or_default().as_bytes())?;
    Ok(report)
}

/// Every view against the reference or its closed form, and against its golden where there is one.
fn against_reference(
    scene: &LoadedScene,
    renderer: &mut gpu::Renderer,
    options: &Options,
    ledger: &Ledger,
    report: &mut CheckVerdict,
) -> Result<()> {
    let LoadedScene { manifest, placed, plan, .. } = scene;
    let mut left = manifest.perspectives().peekable();
    if left.peek().is_some() {
        let mut drawn = handover::scene(scene, ledger)?;
        // The path tracer follows light through everything, not only through what a view sees. Only the path tracer
        // draws leaves by their layers, and a lawn's blades in each other's shade.
        let layers = scene.drawn().any(|leaf| leaf.config.layers().is_some());
        let traced = plan.light.between.is_some() || !placed.grass.is_empty() || layers;
        let mut world = if traced { transport::ReferenceWorld::default() } else { reference::world(scene, ledger)? };
        renderer.set_scene(&drawn).map_err(told)?;
        cost::on_adapter(renderer, report);
        // Views of the same time share the reference's trees.
        let mut times: Vec<f64> = manifest.perspectives().map(|v| manifest.time_of(v)).collect();
        times.dedup();
        if !placed.moves().any() {
            times.truncate(1);
        }
        for time in times {
            if let Some(wind) = &mut drawn.wind {
                wind.time_s = time;
                renderer.set_time(wind);
            }
            match traced {
                true => world = reference::traced(scene, time, ledger)?,
                false => reference::move_to(&mut world, scene, time)?,
            }
            let mut by_maps = world.clone();
            let stored = sunlight::relight_as_stored(&mut by_maps, scene, &placed.eyes)?;
            let mut as_grown = world.clone();
            let known = !true_leaf::replace(&mut as_grown, scene, &options.out)?.is_empty();
            let as_grown = if known { Some(SceneReference::new(&as_grown, traced)?) } else { None };
            let stage = SceneReference::new(&world, traced)?;
            let by_maps = if stored { Some(SceneReference::new(&by_maps, traced)?) } else { None };
            while let Some(view) = left.next_if(|v| !placed.moves().any() || manifest.time_of(v) == time) {
                let _bar = progress::TaskProgress::of(format!("view {}", view.name));
                let stages = perspective::ReferencePair {
                    truth: &stage,
                    by_maps: by_maps.as_ref(),
                    true_leaf: as_grown.as_ref(),
                };
                report.views.push(perspective::one_view(scene, view, renderer, &stages, options)?);
            }
        }
        if let Some(view) = manifest.perspectives().next() {
            report.film = smoothness::film(manifest, view, &drawn, renderer)?;
            report.failures.extend(report.film.and_then(|f| f.why()));
        }
        let slow = report.views.iter().find_map(|v| v.cost.as_ref()).is_some_and(|c| c.frame_ms_median > 2000.0);
        report.translucency = cost::term(manifest, &drawn, renderer, !slow)?;
        let tile = (manifest.check.width.div_ceil(2), manifest.check.height.div_ceil(2));
        if let Some(strip) = day::draw(scene, &drawn, renderer, tile, ledger)? {
            strip.write(&options.out.join("day.png"))?;
            report.day = strip.hours;
            proof::hours(scene, &drawn, renderer, options, ledger, report)?;
        }
    }
    for view in manifest.cards() {
        report.views.push(card::one_card(scene, view, renderer, options, ledger)?);
    }
    (report.captures, report.skipped) = capture::all(scene, renderer, options)?;
    Ok(())
}
