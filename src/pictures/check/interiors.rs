//! W's scalars compared with pigment maps: the bytes that each takes, how far each is from the fit's own ρd and ρt
//! maps, and how far its picture is from the picture that those maps give.

use crate::{open, told};
use mesophyll_base::error::Result;
use mesophyll_files::quantity::Quantity;
use mesophyll_fits::leaf_folder::{LeafFitFile, filling};
use mesophyll_optics::side::Side;
use mesophyll_optics::slab;
use mesophyll_scene::draw::handover;
use mesophyll_scene::draw::reference;
use mesophyll_scene::loaded::{LoadedLeaf, LoadedScene};
use mesophyll_scene::manifest::{InteriorSource, SceneManifest};
use mesophyll_scene::placed::fits::reader;
use mesophyll_scene::placed::leaf::LeafSearch;
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::{self as transport, comparison as measure};
use std::path::Path;

/// One leaf with one kind of interior.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct InteriorRow {
    /// Name of the leaf in the scene.
    pub leaf: String,
    /// `scalars` or `maps`.
    pub interior: &'static str,
    /// Bytes uploaded for the interior: γ, δ and curve, or two maps a side.
    pub bytes: u64,
    /// Root mean square of ρ/ρ_fit − 1 over the good texels of the sides in use, ρd and ρt together.
    pub fit_error: f64,
    /// 99th percentile of FLIP, compared with the picture of the fit's own maps; worst view.
    pub picture_flip_p99: f64,
    /// Largest error of a displayed value, 0 to 1, over the leaf's inner pixels.
    pub picture_max_error: f64,
}

/// Compares both interiors for every leaf that the perspective views show.
///
/// # Errors
/// As [`crate::check`].
pub fn compare(manifest: &SceneManifest, out: Option<&Path>, ledger: &Ledger) -> Result<Vec<InteriorRow>> {
    let mut renderer = open()?;
    let mut rows = Vec::new();
    for index in 0..manifest.leaves.len() {
        for (name, interior) in [("scalars", InteriorSource::Scalars), ("maps", InteriorSource::Maps)] {
            let mut variant = manifest.clone();
            variant.leaves[index].interior = interior;
            let search = LeafSearch { out, ..LeafSearch::default() };
            let scene = LoadedScene::open(variant, search, ledger)?;
            let leaf = scene.leaf(index);
            // A stated look has one interior only.
            let stated = leaf.placed.fitted.as_ref().is_some_and(|fitted| fitted.is_stated());
            if stated || leaf.placed.mesh.is_none() || !leaf.plan.sides.iter().any(|s| s.interior()) {
                continue;
            }
            renderer.set_scene(&handover::scene(&scene, ledger)?).map_err(told)?;
            let parts = ["gamma_delta", "slab curve", "rho_d", "rho_t"];
            let shown = scene.drawn().filter(|l| l.placed.index < index).count();
            let prefix = format!("leaf {shown} ");
            let of_interior = |n: &str| n.starts_with(&prefix) && parts.iter().any(|p| n.ends_with(p));
            let bytes = renderer.stats().uploads.iter().filter(|u| of_interior(&u.name)).map(|u| u.bytes).sum();
            let truth = measured_world(&scene, ledger)?;
            let stage = transport::ReferenceRenderer::new(&truth)?;
            let (mut flip, mut error): (f64, f64) = (0.0, 0.0);
            for view in manifest.perspectives() {
                let (w, h) = (manifest.check.width, manifest.check.height);
                let picture = renderer.render(&handover::camera(&view.camera), w, h).map_err(told)?;
                let options =
                    transport::Options { samples_per_pixel: manifest.check.samples, ..transport::Options::default() };
                let reference = stage.render(&view.camera, w as usize, h as usize, &options)?;
                let seen = measure::compare(&reference, &picture.ldr)?;
                (flip, error) = (flip.max(seen.flip_p99), error.max(seen.max_error.unwrap_or(0.0)));
            }
            rows.push(InteriorRow {
                leaf: manifest.leaves[index].name.clone(),
                interior: name,
                bytes,
                fit_error: fit_error(leaf, ledger)?,
                picture_flip_p99: flip,
                picture_max_error: error,
            });
        }
    }
    Ok(rows)
}

/// The reference world with the fit's own ρd and ρt maps, which both interiors approximate.
fn measured_world(scene: &LoadedScene, ledger: &Ledger) -> Result<transport::ReferenceWorld> {
    let mut world = reference::world(scene, ledger)?;
    for (leaf, drawn) in scene.drawn().zip(&mut world.leaves) {
        let Some(fitted) = &leaf.placed.fitted else { continue };
        for (s, side) in Side::ALL.into_iter().enumerate() {
            if !leaf.plan.sides[s].interior() {
                continue;
            }
            let path = fitted.path(LeafFitFile::Maps, side);
            let maps = reader::maps(fitted, side, ledger)?;
            let mut planes = maps.require_planes(&path, &[Quantity::RhoD, Quantity::RhoT, Quantity::Mask])?;
            let good: Vec<bool> = (0..maps.width * maps.height)
                .map(|k| planes[6][k] > 0.0 && planes.iter().all(|p| p[k].is_finite()))
                .collect();
            filling::require(&path, &mut planes, &good, maps.width, maps.height)?;
            let mut take = |c: usize| std::mem::take(&mut planes[c]);
            let interior = transport::ReferenceInterior::Maps {
                rho_d: [take(0), take(1), take(2)],
                rho_t: [take(3), take(4), take(5)],
            };
            if s == 0 { drawn.front.interior = interior } else { drawn.back.interior = interior }
        }
    }
    Ok(world)
}

/// Root mean square of the model's ρd and ρt divided by the fit's own, less one.
fn fit_error(leaf: LoadedLeaf, ledger: &Ledger) -> Result<f64> {
    let Some(fitted) = &leaf.placed.fitted else { return Ok(f64::NAN) };
    let (mut sum, mut count) = (0.0, 0u64);
    for (s, side) in Side::ALL.into_iter().enumerate() {
        if !leaf.plan.sides[s].interior() {
            continue;
        }
        let maps = reader::maps(fitted, side, ledger)?;
        let one = [Quantity::Mask, Quantity::Thickness];
        let three = [Quantity::Gamma, Quantity::SigmaA, Quantity::SigmaS, Quantity::RhoD, Quantity::RhoT];
        let p = maps.require_planes(&fitted.path(LeafFitFile::Maps, side), &[&one[..], &three].concat())?;
        let (sigma_a, sigma_s) = (fitted.rgb(side, Quantity::SigmaA)?, fitted.rgb(side, Quantity::SigmaS)?);
        let n = maps.width * maps.height;
        // Tens of thousands of texels are enough for a root mean square.
        for k in (0..n).step_by((n / 20_000).max(1)).filter(|&k| p[0][k] > 0.0 && p.iter().all(|q| q[k].is_finite())) {
            let h = f64::from(p[1][k]);
            for c in 0..3 {
                let f = |at: usize| f64::from(p[at + c][k]);
                let (rho_d, rho_t) = match leaf.config.interior {
                    InteriorSource::Scalars => {
                        let r = slab::response(sigma_a[c], sigma_s[c], h);
                        (f(2) * r.rho_d, r.rho_t)
                    }
                    InteriorSource::Maps => {
                        let r = slab::response(f(5), f(8), h);
                        (r.rho_d, r.rho_t)
                    }
                };
                for (model, fit) in [(rho_d, f(11)), (rho_t, f(14))] {
                    if fit > 0.0 {
                        sum += (model / fit - 1.0).powi(2);
                        count += 1;
                    }
                }
            }
        }
    }
    Ok((sum / count.max(1) as f64).sqrt())
}

/// The rows in words.
pub fn text(rows: &[InteriorRow]) -> String {
    rows.iter()
        .map(|r| {
            format!(
                "{} as {}: {} bytes, fit error {:.2e} (rms, relative), picture FLIP 99 % {:.4}, largest error {:.4}\n",
                r.leaf, r.interior, r.bytes, r.fit_error, r.picture_flip_p99, r.picture_max_error
            )
        })
        .collect()
}
