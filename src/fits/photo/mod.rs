//! The leaf fit of photographs (`docs/photo.md`): from ρd of both sides and ρt to σa, σs, each texel's thickness and γ,
//! by the same leaf-wide problem as a scan under a tube. It writes the same folder, so that the report, scenes and
//! exports work on either.
//!
//! What no photograph shows is stated (thickness, gloss) or left open (normals), and `fit.toml` says so by name.

mod output;

use crate::leaf::curve::Incidence;
use crate::leaf::indeterminacy;
use crate::leaf::interior::start;
use crate::leaf::leaf_wide::{self, LeafSharedErrors, LeafWideFit, LeafWideSettings, LeafWideTexel};
use crate::leaf::outliers;
use crate::leaf::sides::{InteriorEstimates, widen};
use crate::leaf::slabmaps::{FittedReading, SigmaEstimate, SlabInverter};
use crate::record::FitKind;
use crate::record::maker::{self, FitMaker, FitOutcome};
use crate::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::photo::{PhotoManifest, PhotoMaps, reduce};
use mesophyll_optics::defect::Defect;
use mesophyll_optics::side::Side;
use mesophyll_optics::slab::inverse;
use rayon::prelude::*;
use std::path::Path;
use std::time::Instant;

/// The defects that photographs can have.
pub(crate) const DEFECTS: [Defect; 7] = [
    Defect::NoReading,
    Defect::Saturated,
    Defect::Edge,
    Defect::Transmission,
    Defect::Energy,
    Defect::Dark,
    Defect::Foreign,
];

/// One fitted side, in the image of the camera that saw it. Vectors of texels run over `at`.
pub struct PhotoSideFit {
    /// Which side it is.
    pub side: Side,
    /// 1 good, 0 off the leaf, negative a defect.
    pub status: Vec<i16>,
    /// Indices of the good texels.
    pub at: Vec<u32>,
    /// Their readings.
    pub texels: Vec<LeafWideTexel>,
    /// The leaf-wide solution.
    pub wide: LeafWideFit,
    /// Relative standard errors of σa and σs; they include that of the thickness.
    pub relative: [Rgb; 2],
    /// σa and σs of every texel.
    pub sigma: Vec<Rgb<SigmaEstimate>>,
}

/// Fits the capture into the folder `out`; `force` fits again although the folder holds this very fit.
///
/// # Errors
/// Unreadable or invalid captures (exit code 2), a folder that cannot be written or holds something else (2), a fit
/// that does not converge on any side (1).
pub fn run(capture: &Path, out: &Path, force: bool) -> Result<FitOutcome> {
    let folder = capture.to_path_buf();
    maker::make(FitKind::Leaf, out, &[capture], move |maker| fit(&folder, force, maker))
}

fn fit(folder: &Path, force: bool, maker: &mut FitMaker) -> Result<FitOutcome> {
    let step = Instant::now();
    let manifest = PhotoManifest::read(folder)?;
    let input = maker::input_hash([("capture", manifest.hash(folder)?.as_str())]);
    if let Some(found) = maker.up_to_date(input, force)? {
        return Ok(found);
    }
    maker.times.capture = Some(folder.display().to_string());
    maker.times.phase("open and hash the capture", step);
    let reduced = maker.phase("reduce to maps", || reduce(folder, &manifest))?;
    let mut record = maker.record(&manifest.name);
    let [front, back] = maker
        .phase("interior", || Ok([Side::Front, Side::Back].map(|side| interior(folder, &manifest, &reduced, side))))?;
    let mut sides = [front?, back?];
    share(&manifest, &reduced, &mut sides, &mut record);
    let step = Instant::now();
    let out = maker.begin()?.to_path_buf();
    output::write(&out, folder, &manifest, &reduced, &sides, &mut record)?;
    maker.times.phase("blade and maps", step);
    let record = maker.finish(record)?;
    if sides.iter().all(|s| !s.wide.termination.converged()) {
        return Err(Error::Missed(format!(
            "{}: the leaf-wide fit did not converge on any side; maps are written, σa and σs are not to be used",
            out.join("fit.toml").display()
        )));
    }
    Ok(FitOutcome::Done(record))
}

/// The interior of one side.
fn interior(folder: &Path, manifest: &PhotoManifest, reduced: &PhotoMaps, side: Side) -> Result<PhotoSideFit> {
    let seen = &reduced.sides[side];
    let [h, h_err] = manifest.thickness();
    let mut status = seen.status.clone();
    let texel = |k: usize| LeafWideTexel {
        rho_d: seen.rho_d[k].map(|d| d.max(0.0)),
        rho_d_err: seen.rho_d_err[k],
        rho_t: seen.rho_t[k],
        rho_t_floor: seen.rho_t_err[k].map(|e| e.max(1e-9)),
        covariance: Rgb::default(),
    };
    let gather = |status: &[i16]| {
        let at: Vec<u32> = (0..status.len() as u32).filter(|&k| status[k as usize] == 1).collect();
        let texels: Vec<LeafWideTexel> = at.iter().map(|&k| texel(k as usize)).collect();
        (at, texels)
    };
    let (mut at, mut texels) = gather(&status);
    let none = |status: &[i16]| {
        let count = |d: Defect| status.iter().filter(|s| **s == d.code()).count();
        let list: Vec<String> = DEFECTS.iter().map(|d| format!("{} {}", count(*d), d.name())).collect();
        Error::input(folder, format!("no texel of the {} is good: {}", side.name(), list.join(", ")))
    };
    if texels.len() < 16 {
        return Err(none(&status));
    }
    let mean =
        |texels: &[LeafWideTexel], c: usize| texels.iter().map(|t| t.rho_d[c]).sum::<f64>() / texels.len() as f64;
    // Errors of ρd that no average takes away, relative to its mean: the stated ones, and what cutting at zero lifts it
    // by.
    let common = |texels: &[LeafWideTexel]| {
        let lifted = indeterminacy::common(texels, seen.alike);
        let own = Rgb::of(|c| (seen.shared[c] / mean(texels, c).max(1e-12)).hypot(lifted.own[c]).min(1e3));
        LeafSharedErrors { own, ..lifted }
    };
    let solve = |texels: &[LeafWideTexel]| {
        let common = common(texels);
        let settings =
            LeafWideSettings { h, incidence: Incidence(1.0), relative: 0.0, robust: true, iterations: 80, common };
        leaf_wide::fit(texels, &[], start(texels, h), &settings)
    };
    let mut wide = solve(&texels);
    for (k, _) in outliers::of_leaf(&texels, &wide, h) {
        status[at[k] as usize] = Defect::Foreign.code();
    }
    if status.iter().filter(|s| **s == 1).count() < 16 {
        return Err(none(&status));
    }
    if status.iter().filter(|s| **s == 1).count() < texels.len() {
        (at, texels) = gather(&status);
        wide = solve(&texels);
    }
    let inverter = SlabInverter::new(Incidence(1.0));
    let sigma = (0..texels.len())
        .into_par_iter()
        .map(|k| {
            let (x, local) = (&texels[k], &wide.locals[k]);
            Rgb::of(|c| {
                let error = [x.rho_d_err[c], x.rho_t_floor[c]];
                let reading = FittedReading { rho_d: x.rho_d[c], rho_t: x.rho_t[c], error, covariance: 0.0 };
                let own = inverter.invert_fitted(reading, local.thickness, local, c);
                // What all texels share moves this one as well. It does not move its thickness, whose mean is stated.
                let shared = [seen.shared[c].hypot(seen.alike * x.rho_d[c]), seen.rho_t_shared[c] * x.rho_t[c]];
                let shared = inverter.invert(x.rho_d[c], x.rho_t[c], local.thickness, shared);
                let error = [0, 1].map(|q: usize| {
                    let error = own.error[q].hypot(shared.error[q]).hypot(own.value[q] * h_err / h);
                    if error.is_nan() { f64::INFINITY } else { error }
                });
                SigmaEstimate { error, ..own }
            })
        })
        .collect();
    let own = |q: usize| Rgb::of(|c| wide.covariance[(2 * c + q, 2 * c + q)].sqrt());
    let mut relative = [own(0), own(1)];
    for c in (0..3).filter(|&c| indeterminacy::opaque(&texels, c, |x, c| x.rho_t_floor[c])) {
        // All that came through in this channel may be noise. Then the curvature where the fit stopped says nothing
        // about thicker slabs, and the mean texel's slab is the best estimate there is.
        let found = indeterminacy::mean_texel(&texels, c, h, |x, c| x.rho_t_floor[c], &common(&texels));
        relative.iter_mut().zip(indeterminacy::relative(&found)).for_each(|(of, share)| of[c] = share);
        for (value, estimate) in [(&mut wide.sigma_a[c], found.sigma_a), (&mut wide.sigma_s[c], found.sigma_s)] {
            if estimate.is_finite() {
                *value = estimate;
            }
        }
    }
    Ok(PhotoSideFit { side, status, at, texels, wide, relative, sigma })
}

fn of(side: &mut PhotoSideFit) -> InteriorEstimates<'_> {
    let [sigma_a_rel, sigma_s_rel] = &mut side.relative;
    InteriorEstimates { sigma_a: side.wide.sigma_a, sigma_s: side.wide.sigma_s, sigma_a_rel, sigma_s_rel }
}

/// Adds to the relative errors what both sides share: first the part of their difference that noise does not explain,
/// then the common error of ρt and that of the thickness.
fn share(
    manifest: &PhotoManifest,
    reduced: &PhotoMaps,
    sides: &mut [PhotoSideFit; 2],
    record: &mut crate::record::FitRecord,
) {
    let [front, back] = sides;
    widen(of(front), of(back), 0.0, record);
    let [h, h_err] = manifest.thickness();
    for side in sides {
        let n = side.texels.len() as f64;
        for c in 0..3 {
            let mean = |f: &dyn Fn(&LeafWideTexel) -> f64| side.texels.iter().map(f).sum::<f64>() / n;
            let (d, t) = (mean(&|x| x.rho_d[c]), mean(&|x| x.rho_t[c]));
            let moved = |t: f64| inverse::invert(d, t, h, 1e-4, 1e-4);
            // Half the difference between a ρt that is one common error too high and one that is too low.
            let step = reduced.sides[side.side].rho_t_shared[c].min(0.5);
            let (up, down) = (moved(t * (1.0 + step)), moved(t * (1.0 - step)));
            for (q, [u, v]) in [[up.sigma_a, down.sigma_a], [up.sigma_s, down.sigma_s]].into_iter().enumerate() {
                let by_table = 0.5 * (u / v).ln().abs();
                let all = side.relative[q][c].hypot(by_table).hypot(h_err / h);
                side.relative[q][c] = if all.is_finite() { all } else { f64::INFINITY };
            }
        }
    }
}

#[cfg(test)]
mod tests;
