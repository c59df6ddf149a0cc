//! Every view, drawn small and compared with its golden picture, or written as one.

use crate::{CheckVerdict, Options, told};
use crate::{day, golden};
use mesophyll_base::error::Result;
use mesophyll_files::{image, progress};
use mesophyll_scene::draw::card::LeafCard;
use mesophyll_scene::draw::handover;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::{SceneManifest, ViewKind};
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_scene::verdict::{ViewFigures, ViewScope};
use mesophyll_transport::ReferenceCamera;
use mesophyll_viewer as gpu;

/// The name that the hours of a day have among the golden pictures.
const HOURS: &str = "hours";

/// Every view of the scene, and the hours of its day, by their goldens alone.
///
/// # Errors
/// As [`crate::check`].
pub fn all(
    scene: &LoadedScene,
    renderer: &mut gpu::Renderer,
    options: &Options,
    ledger: &Ledger,
    report: &mut CheckVerdict,
) -> Result<()> {
    let manifest = &scene.manifest;
    if manifest.perspectives().next().is_some() {
        let mut drawn = handover::scene(scene, ledger)?;
        renderer.set_scene(&drawn).map_err(told)?;
        for view in manifest.perspectives() {
            if let Some(wind) = &mut drawn.wind {
                wind.time_s = manifest.time_of(view);
                renderer.set_time(wind);
            }
            report.views.push(alone(manifest, (&view.name, ViewKind::Perspective), &view.camera, renderer, options)?);
        }
        hours(scene, &drawn, renderer, options, ledger, report)?;
    }
    for view in manifest.cards() {
        let card = LeafCard::new(scene, view, ledger)?;
        renderer.set_scene(&handover::card(scene, &card, ledger)?).map_err(told)?;
        report.views.push(alone(manifest, (&view.name, ViewKind::Card), &view.camera, renderer, options)?);
    }
    Ok(())
}

fn alone(
    manifest: &SceneManifest,
    (name, kind): (&str, ViewKind),
    camera: &ReferenceCamera,
    renderer: &mut gpu::Renderer,
    options: &Options,
) -> Result<ViewFigures> {
    let mut out = ViewFigures { name: name.into(), kind, scope: ViewScope::Golden, ..ViewFigures::default() };
    judge_view(manifest, camera, renderer, options, &mut out)?;
    out.passed = judged(&out);
    Ok(out)
}

/// Draws small the view that the renderer holds, and judges it by its golden where that applies.
pub fn judge_view(
    manifest: &SceneManifest,
    camera: &ReferenceCamera,
    renderer: &mut gpu::Renderer,
    options: &Options,
    out: &mut ViewFigures,
) -> Result<()> {
    if !options.goldens_only && !golden::applies(manifest) {
        return Ok(());
    }
    let (w, h) = golden::size(manifest);
    let picture = renderer.render(&handover::camera(camera), w, h).map_err(told)?;
    judge(manifest, &picture, options, out)
}

/// The hours of the scene's day as one more picture, where the scene has a day and a golden of it exists or will be
/// written.
pub fn hours(
    scene: &LoadedScene,
    drawn: &gpu::scene::Scene,
    renderer: &mut gpu::Renderer,
    options: &Options,
    ledger: &Ledger,
    report: &mut CheckVerdict,
) -> Result<()> {
    let manifest = &scene.manifest;
    let wanted = options.update_golden || golden::path(manifest, HOURS).is_file();
    if !(options.goldens_only || wanted && golden::applies(manifest)) {
        return Ok(());
    }
    let (w, h) = golden::size(manifest);
    if let Some(strip) = day::draw(scene, drawn, renderer, (w / 2, h / 2), ledger)? {
        let mut out = ViewFigures { name: HOURS.into(), scope: ViewScope::Golden, ..ViewFigures::default() };
        judge(manifest, &strip.picture, options, &mut out)?;
        out.passed = judged(&out);
        report.views.push(out);
    }
    Ok(())
}

/// Writes the picture as the golden of `out.name`, or compares the two. Only a check of the goldens alone requires a
/// golden that does not exist.
fn judge(manifest: &SceneManifest, picture: &gpu::Picture, options: &Options, out: &mut ViewFigures) -> Result<()> {
    let path = golden::path(manifest, &out.name);
    let (w, h) = (picture.width as usize, picture.height as usize);
    image::write_png(&options.out.join(format!("{}-small.png", out.name)), w, h, picture.ldr.as_flattened())?;
    if options.update_golden {
        golden::write(&path, w, h, &picture.ldr)?;
        progress::say(format!("wrote {}", path.display()));
    } else if path.is_file() {
        let seen = golden::compare(&path, picture, manifest.exposure)?;
        out.golden = Some(seen.figures);
        if let Some(why) = seen.figures.missed() {
            let difference = options.out.join(format!("{}-small-difference.png", out.name));
            image::write_png(&difference, w, h, &seen.difference)?;
            out.why.push(format!(
                "{why} from the golden {} (eightfold difference: {})",
                path.display(),
                difference.display()
            ));
        }
    } else if options.goldens_only {
        let scene = manifest.path.display();
        let command = format!("`mesophyll check {scene} --goldens-only --update-golden`");
        out.why.push(format!("there is no golden picture {}; {command} writes it", path.display()));
    }
    Ok(())
}

/// Whether a picture is as its golden is; `None` where there was none to compare it with, and none is missed.
fn judged(out: &ViewFigures) -> Option<bool> {
    (out.golden.is_some() || !out.why.is_empty()).then_some(out.why.is_empty())
}
