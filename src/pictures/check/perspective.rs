//! A view of the scene: the renderer's picture compared with the reference's, with translucency by the convolution or
//! as the maps store it, and with the golden picture where there is one.

use crate::blocks;
use crate::cost::timed;
use crate::pictures::save;
use crate::{Options, proof, told};
use mesophyll_base::error::Result;
use mesophyll_files::image::write_png;
use mesophyll_scene::draw::handover;
use mesophyll_scene::draw::scene_reference::SceneReference;
use mesophyll_scene::loaded::LoadedScene;
use mesophyll_scene::manifest::{PerspectiveView, TranslucencyReference};
use mesophyll_scene::verdict::{BasisError, ReferenceError, TrueLeafError, ViewFigures, exceeds};
use mesophyll_transport::comparison;
use mesophyll_viewer as gpu;
use std::time::Instant;

/// The reference, and the same with translucency maps evaluated as they are stored.
pub struct ReferencePair<'a> {
    pub truth: &'a SceneReference<'a>,
    pub by_maps: Option<&'a SceneReference<'a>>,
    /// The reference with the true leaves, where scans are synthetic.
    pub true_leaf: Option<&'a SceneReference<'a>>,
}

pub fn one_view(
    scene: &LoadedScene,
    view: &PerspectiveView,
    renderer: &mut gpu::Renderer,
    stages: &ReferencePair,
    options: &Options,
) -> Result<ViewFigures> {
    let manifest = &scene.manifest;
    let size = (manifest.check.width, manifest.check.height);
    let (w, h) = (size.0 as usize, size.1 as usize);
    let picture = renderer.render(&handover::camera(&view.camera), size.0, size.1).map_err(told)?;
    let mut out = timed(manifest, view.into(), &view.camera, renderer)?;
    let start = Instant::now();
    let seed = manifest.check.seed;
    let mut truth = stages.truth.view(scene, view, seed)?;
    let mut judged_by = TranslucencyReference::Convolution;
    if let Some(by_maps) = stages.by_maps {
        // Both use the same rays, so they differ only by the basis.
        let stored = by_maps.view(scene, view, seed)?;
        let basis = comparison::compare(&truth, &stored.ldr)?;
        out.basis = Some(BasisError { flip_p99: basis.flip_p99, max_error: basis.max_error.unwrap_or(0.0) });
        if view.judged_by == TranslucencyReference::Maps {
            (truth, judged_by) = (stored, view.judged_by);
        }
    }
    let own =
        if judged_by == TranslucencyReference::Maps { stages.by_maps.unwrap_or(stages.truth) } else { stages.truth };
    let other = own.view(scene, view, seed.wrapping_add(1))?;
    let reference_s = start.elapsed().as_secs_f64();
    let (seen, noise) = match view.blocks {
        None => (comparison::compare(&truth, &picture.ldr)?, comparison::noise_floor(&truth, &other)?),
        Some(side) => {
            let mean = |hdr: &[[f32; 4]]| blocks::picture(hdr, [w, h], side as usize, manifest.exposure);
            let right = mean(&truth.hdr);
            let against = |hdr: &[[f32; 4]]| comparison::compare(&right, &mean(hdr).ldr);
            (against(&picture.hdr)?, against(&other.hdr)?)
        }
    };
    out.blocks = view.blocks;
    let error = ReferenceError {
        flip_mean: seen.flip_mean,
        flip_p99: seen.flip_p99,
        max_error: seen.max_error,
        max_at: seen.max_at,
        interior_share: seen.interior_share,
        noise_flip_p99: Some(noise.flip_p99),
        noise_max_error: noise.max_error,
        judged_by,
        reference_s,
    };
    judge(&error, &mut out);
    out.error = Some(error);
    if let Some(stage) = stages.true_leaf {
        // Both use the same rays, so they differ only by the fit.
        let grown = stage.view(scene, view, seed)?;
        let apart = comparison::compare(&grown, &picture.ldr)?;
        let file = format!("{}-true-leaf.png", view.name);
        write_png(&options.out.join(&file), w, h, grown.ldr.as_flattened())?;
        out.true_leaf = Some(TrueLeafError {
            flip_mean: apart.flip_mean,
            flip_p99: apart.flip_p99,
            max_error: apart.max_error,
            picture: file,
        });
    }
    proof::judge_view(manifest, &view.camera, renderer, options, &mut out)?;
    save(&mut out, options, &truth, &picture, &seen)?;
    out.passed = Some(out.why.is_empty());
    Ok(out)
}

fn judge(error: &ReferenceError, out: &mut ViewFigures) {
    if let Some(limit) = out.threshold_flip_p99
        && exceeds(error.flip_p99, limit)
    {
        out.why.push(format!("99 % FLIP is {:.4} from the reference, at most {limit:.4} allowed", error.flip_p99));
    }
    let limit = out.threshold_max_error.unwrap_or(0.0);
    if let Some(e) = error.max_error.filter(|e| exceeds(*e, limit)) {
        let (x, y) = error.max_at.unwrap_or_default();
        let what = if out.blocks.is_some() { "block" } else { "pixel" };
        out.why.push(format!("{what} ({x}, {y}) is {e:.4} from the reference, at most {limit:.4} allowed"));
    }
}
