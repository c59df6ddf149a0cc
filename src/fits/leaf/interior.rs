//! From the ρd and ρt of each texel to the leaf's σa and σs and each texel's thickness h + δ and relative reflectance
//! γ, by the exact or the paper's reduction, with what each leaves unexplained. h is the caliper's reading of the mean
//! thickness.

use super::texels;
use crate::Result;
use crate::leaf::curve::{Incidence, ThicknessCurve};
use crate::leaf::indeterminacy;
use crate::leaf::leaf_wide::{self, GaugeSubstitutes, LeafWideFit, LeafWideSettings, LeafWideTexel, TexelInterior};
use crate::leaf::noise::CameraNoise;
use crate::leaf::outliers;
use crate::leaf::paper::{self, PaperReduction};
use crate::leaf::side::SideTransmittance;
use crate::leaf::slabmaps::{FittedReading, SigmaEstimate, SlabInverter};
use crate::leaf::{LeafFitMethod, Options};
use crate::record::FitTimes;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::solvers::Termination;
use mesophyll_base::statistics::median_of;
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::defect::Defect;
use mesophyll_optics::side::Side;
use mesophyll_optics::slab::{self, inverse};
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// One good texel: what was measured there, and what the reduction makes of it.
#[derive(Debug, Clone, Copy)]
pub struct FittedTexel {
    /// Index in the image.
    pub at: usize,
    pub reading: LeafWideTexel,
    /// Thickness and γ by the method that was asked for.
    pub interior: TexelInterior,
    /// σa and σs of the slab with the texel's own thickness.
    pub sigma: Rgb<SigmaEstimate>,
}

/// One side, fitted.
pub struct LeafSideFit {
    pub side: Side,
    pub measured: SideTransmittance,
    /// Merged part maps of the texel phase (whole image).
    pub maps: ChannelMaps,
    /// 1 good, 0 outside, negative a defect.
    pub mask: Vec<i16>,
    pub texels: Vec<FittedTexel>,
    pub sigma_a: Rgb,
    pub sigma_s: Rgb,
    /// Relative standard errors; they include that of the caliper's h.
    pub sigma_a_rel: Rgb,
    pub sigma_s_rel: Rgb,
    /// ρt of each good texel for a beam along the normal divided by the measured ρt, where the light box was not seen
    /// along the normal.
    pub to_normal: Option<Vec<Rgb>>,
    pub wide: LeafWideFit,
    pub termination: Termination,
    pub figures: BTreeMap<String, f64>,
    /// Reduced χ² of the median texel, where the traces do not match the model of a texel.
    pub unexplained: Option<f64>,
    /// Bounds that the mean texel gives for a channel whose σa or σs is not determined.
    pub bounds: Rgb<Option<String>>,
}

impl LeafSideFit {
    /// ρt and its standard error for a beam along the normal: two whole images of one channel. If the leaf was seen at
    /// an angle, ρt is converted by the leaf's slab at each texel's thickness; it is then NaN where a texel is not
    /// good.
    pub fn rho_t(&self, c: usize) -> [Vec<f32>; 2] {
        [&self.measured.rho_t, &self.measured.rho_t_err].map(|plane| match &self.to_normal {
            None => plane.iter().map(|t| t[c]).collect(),
            Some(factors) => {
                let mut out = vec![f32::NAN; plane.len()];
                for (factor, x) in factors.iter().zip(&self.texels) {
                    out[x.at] = (f64::from(plane[x.at][c]) * factor[c]) as f32;
                }
                out
            }
        })
    }

    /// Whether the leaf-wide numbers cannot be used.
    pub fn wide_failed(&self) -> bool {
        !self.termination.converged()
    }
}

/// Reduces one side.
pub fn fit(
    capture: &TubeCapture,
    measured: SideTransmittance,
    maps: ChannelMaps,
    options: &Options,
    level: &CameraNoise,
    times: &mut FitTimes,
) -> Result<LeafSideFit> {
    let manifest = &capture.manifest;
    let h = manifest.thickness_mm;
    let incidence = Incidence(manifest.lightbox.camera_deg.to_radians().cos());
    let relative = level.relative * level.lightbox * std::f64::consts::SQRT_2;
    let mut mask = classify(&measured, &maps);
    let mut good = Good::gather(&measured, &maps, &mask, relative, manifest.width);
    let none = |mask: &[i16]| {
        let path = capture.folder.join(measured.side.name());
        crate::Error::Missed(format!("{}: no texel could be fitted{}", path.display(), outliers::most_common(mask)))
    };
    if good.texels.is_empty() {
        return Err(none(&mask));
    }
    let unseen = if manifest.pass(Travel::Y).is_some() { 0.0 } else { indeterminacy::unseen_tilt(&maps, &good.at) };
    let settings = |texels: &[LeafWideTexel]| {
        let common = indeterminacy::common(texels, unseen);
        LeafWideSettings { h, incidence, relative, robust: options.robust, iterations: 80, common }
    };
    let mut wide = leaf_wide::fit(&good.texels, &good.missing, start(&good.texels, h), &settings(&good.texels));
    // Texels that stand out from the fitted leaf are named as defects, and the leaf is fitted again without them.
    // Outliers may hide others, so there are three rounds.
    for _ in 0..3 {
        let found = outliers::of_leaf(&good.texels, &wide, h);
        if found.is_empty() {
            break;
        }
        for (k, defect) in found {
            mask[good.at[k] as usize] = defect.code();
        }
        good = Good::gather(&measured, &maps, &mask, relative, manifest.width);
        if good.texels.is_empty() {
            return Err(none(&mask));
        }
        wide = leaf_wide::fit(&good.texels, &good.missing, start(&good.texels, h), &settings(&good.texels));
    }
    let common = settings(&good.texels).common;
    let Good { at, texels, missing } = good;
    times.traces.insert(format!("{} leaf-wide", measured.side.name()), wide.trace.clone());

    let to_normal = (incidence.0 != 1.0).then(|| {
        let curves = wide.sigma_a.zip(wide.sigma_s, |a, s| ThicknessCurve::new(a, s, h, Incidence(1.0)));
        let factor = |t: f64, c: usize| (curves[c].at(t.ln()).ln_rho_t - wide.curves[c].at(t.ln()).ln_rho_t).exp();
        wide.locals.iter().map(|l| Rgb::of(|c| factor(l.thickness, c))).collect()
    });
    let inverter = SlabInverter::new(incidence);
    let rho_t_err = |x: &LeafWideTexel, c: usize| x.variance(c, x.rho_t[c], relative).sqrt();
    let error = |x: &LeafWideTexel, c: usize| [x.rho_d_err[c], rho_t_err(x, c)];
    let at_h: Vec<Rgb<[f64; 2]>> =
        texels.par_iter().map(|x| Rgb::of(|c| inverter.invert(x.rho_d[c], x.rho_t[c], h, error(x, c)).value)).collect();
    let paper = paper::reduce(&texels, &at_h, h);
    let mut figures = compare(&texels, &wide, &paper, h);
    figures.insert("stand_ins".into(), missing.len() as f64);

    let unexplained = indeterminacy::unexplained(&maps, &at, level);
    let gauge = manifest.thickness_err_mm.unwrap_or(0.0) / h;
    let (mut sigma_a, mut sigma_s, mut rel_a, mut rel_s, termination, interiors);
    match options.method {
        LeafFitMethod::Exact => {
            let relative = |k: usize| (wide.covariance[(k, k)] + gauge * gauge).sqrt();
            (sigma_a, sigma_s) = (wide.sigma_a, wide.sigma_s);
            (rel_a, rel_s) = (Rgb([0, 2, 4].map(relative)), Rgb([1, 3, 5].map(relative)));
            termination = wide.termination;
            interiors = wide.locals.clone();
        }
        LeafFitMethod::Paper => {
            (sigma_a, sigma_s) = (paper.sigma_a, paper.sigma_s);
            rel_a = (paper.sigma_a_err / sigma_a).map(|r| r.hypot(gauge));
            rel_s = (paper.sigma_s_err / sigma_s).map(|r| r.hypot(gauge));
            termination = if sigma_a.iter().chain(&sigma_s).all(|v| v.is_finite()) {
                Termination::Direct
            } else {
                Termination::NotFinite
            };
            // Eq. 5 has no solution on dark veins. Their thickness stays unknown (NaN); it is not invented.
            let found = paper.thickness.iter().zip(&paper.gamma).zip(texels.iter().zip(&wide.locals));
            interiors = found
                .map(|((&thickness, &gamma), (x, exact))| TexelInterior {
                    thickness,
                    gamma,
                    gamma_err: x.rho_d_err * gamma / x.rho_d,
                    ..*exact
                })
                .collect();
            for (t, &k) in paper.thickness.iter().zip(&at) {
                if t.is_nan() {
                    mask[k as usize] = Defect::Transmission.code();
                }
            }
        }
    }
    let bounds = Rgb::of(|c| {
        let opaque = indeterminacy::opaque(&texels, c, rho_t_err);
        if !opaque && rel_a[c] <= inverse::DETERMINED && rel_s[c] <= inverse::DETERMINED {
            return None;
        }
        let mean = indeterminacy::mean_texel(&texels, c, h, rho_t_err, &common);
        if options.method == LeafFitMethod::Exact {
            // A direction that the joint problem does not determine ends wherever it started, so the mean texel's
            // estimate is taken instead.
            for (value, relative, estimate) in
                [(&mut sigma_a[c], rel_a[c], mean.sigma_a), (&mut sigma_s[c], rel_s[c], mean.sigma_s)]
            {
                if (opaque || !relative.is_finite()) && estimate.is_finite() {
                    *value = estimate;
                }
            }
        }
        if opaque {
            // The transmittance of this channel may be nothing but noise. Then the curvature where the fit stopped says
            // nothing about thicker slabs.
            [rel_a[c], rel_s[c]] = indeterminacy::relative(&mean).map(|r| r.hypot(gauge));
        }
        match mean.status {
            inverse::Status::Undetermined(what) => Some(what),
            _ => None,
        }
    });
    let fitted = |(k, reading): (usize, LeafWideTexel)| {
        let interior: TexelInterior = interiors[k];
        let known = interior.thickness.is_finite() && interior.thickness > 0.0;
        let thickness = if known { interior.thickness } else { h };
        let sigma = Rgb::of(|c| {
            let (rho_d, rho_t, covariance) = (reading.rho_d[c], reading.rho_t[c], reading.covariance[c]);
            let seen = FittedReading { rho_d, rho_t, error: error(&reading, c), covariance };
            inverter.invert_fitted(seen, thickness, &wide.locals[k], c)
        });
        FittedTexel { at: at[k] as usize, reading, interior, sigma }
    };
    let texels = texels.into_par_iter().enumerate().map(fitted).collect();
    Ok(LeafSideFit {
        side: measured.side,
        measured,
        maps,
        mask,
        texels,
        sigma_a,
        sigma_s,
        sigma_a_rel: rel_a,
        sigma_s_rel: rel_s,
        to_normal,
        wide,
        termination,
        figures,
        unexplained,
        bounds,
    })
}

/// Defects that the texel fit and the light box show between them.
fn classify(measured: &SideTransmittance, maps: &ChannelMaps) -> Vec<i16> {
    let code = maps.scalar(Quantity::Mask).unwrap_or(&[]);
    let rho_d = maps.three(Quantity::RhoD).unwrap_or_default();
    let rho_d_err = Rgb::of(|c| texels::error(maps, Quantity::RhoD, c));
    let unexplained = outliers::unexplained(maps, &measured.mask);
    (0..code.len())
        .map(|k| {
            if !measured.mask[k] {
                return 0;
            }
            if unexplained[k] {
                return Defect::Unexplained.code();
            }
            if code[k] != 1.0 {
                return code[k] as i16;
            }
            let (t, e) = (measured.rho_t[k], measured.rho_t_err[k]);
            if (0..3).any(|c| !t[c].is_finite() || t[c] >= 1.0 || t[c] < -6.0 * e[c]) {
                return Defect::Transmission.code();
            }
            if (0..3).any(|c| rho_d[c][k] + t[c] > 1.0 + 3.0 * (rho_d_err[c][k].powi(2) + e[c].powi(2)).sqrt()) {
                return Defect::Energy.code();
            }
            if (0..3).all(|c| t[c] < 3.0 * e[c]) {
                return Defect::ThicknessUndetermined.code();
            }
            1
        })
        .collect()
}

/// The good texels: where they are, their readings, and which of them stand in for texels whose reading failed.
struct Good {
    at: Vec<u32>,
    texels: Vec<LeafWideTexel>,
    missing: Vec<GaugeSubstitutes>,
}

impl Good {
    /// `relative`: the noise of ρt relative to ρt. The rest of the standard error is the floor.
    fn gather(measured: &SideTransmittance, maps: &ChannelMaps, mask: &[i16], relative: f64, width: usize) -> Good {
        let rho_d = maps.three(Quantity::RhoD).unwrap_or_default();
        let rho_d_err = Rgb::of(|c| texels::error(maps, Quantity::RhoD, c));
        let by_dark = Rgb::of(|c| texels::by_dark(maps, c));
        let texel = |k: usize| {
            let rho_t = measured.rho_t[k].map(f64::from);
            let floor = |c: usize| {
                (f64::from(measured.rho_t_err[k][c]).powi(2) - (relative * rho_t[c]).powi(2)).max(1e-18).sqrt()
            };
            LeafWideTexel {
                rho_d: Rgb::of(|c| f64::from(rho_d[c][k])),
                rho_d_err: Rgb::of(|c| f64::from(rho_d_err[c][k])),
                rho_t,
                rho_t_floor: Rgb::of(floor),
                covariance: Rgb::of(|c| f64::from(by_dark[c].get(k).unwrap_or(&0.0) * measured.rho_t_by_dark[k][c])),
            }
        };
        let at: Vec<u32> = (0..mask.len() as u32).filter(|&k| mask[k as usize] == 1).collect();
        let texels = at.iter().map(|&k| texel(k as usize)).collect();
        Good { missing: outliers::stand_ins(mask, &at, &measured.rho_t, width), at, texels }
    }
}

/// A start from the leaf's median reflectance and transmittance a channel.
pub fn start(texels: &[LeafWideTexel], h: f64) -> Rgb<[f64; 2]> {
    Rgb::of(|c| {
        let d = median_of(texels.iter().map(|x| x.rho_d[c])).unwrap_or(f64::NAN);
        let t = median_of(texels.iter().map(|x| x.rho_t[c])).unwrap_or(f64::NAN).max(1e-4);
        let found = slab::inverse::invert(d, t, h, 1e-3 * d, 1e-3 * t);
        if found.sigma_a.is_finite() && found.sigma_s.is_finite() && found.sigma_a > 0.0 && found.sigma_s > 0.0 {
            [found.sigma_a, found.sigma_s]
        } else {
            // No slab was found: start at a typical green leaf of optical thickness 4.
            [1.5 / h, 2.5 / h]
        }
    })
}

/// How much of the measured transmittance each reduction reproduces: over the whole leaf, and over its darkest tenth
/// (the veins).
fn compare(texels: &[LeafWideTexel], wide: &LeafWideFit, paper: &PaperReduction, h: f64) -> BTreeMap<String, f64> {
    let mut order: Vec<usize> = (0..texels.len()).collect();
    order.sort_unstable_by(|&a, &b| texels[a].rho_t[1].total_cmp(&texels[b].rho_t[1]));
    let veins = &order[..order.len().div_ceil(10)];
    let exact = |k: usize| {
        let t = wide.locals[k].thickness.ln();
        Rgb::of(|c| wide.curves[c].at(t).ln_rho_t.exp())
    };
    // Where Eq. 5 has no thickness, the paper's leaf transmits its smallest possible value, B ω/2.
    let frozen = |k: usize| {
        let t = paper.thickness[k];
        paper::transmittance(paper, if t.is_nan() { f64::INFINITY } else { t })
    };
    let rms = |list: &[usize], model: &dyn Fn(usize) -> Rgb| {
        let sum: f64 =
            list.iter().map(|&k| (0..3).map(|c| (model(k)[c] - texels[k].rho_t[c]).powi(2)).sum::<f64>()).sum();
        (sum / (3 * list.len()) as f64).sqrt()
    };
    let chi2: f64 = wide.locals.iter().map(|l| l.chi2).sum();
    let freedom = (2 * texels.len()).saturating_sub(6).max(1) as f64;
    BTreeMap::from([
        ("transmittance_rms_exact".to_string(), rms(&order, &exact)),
        ("transmittance_rms_paper".to_string(), rms(&order, &frozen)),
        ("transmittance_rms_exact_darkest_tenth".to_string(), rms(veins, &exact)),
        ("transmittance_rms_paper_darkest_tenth".to_string(), rms(veins, &frozen)),
        ("paper_negative_logarithms".to_string(), paper.negative_logarithms as f64),
        ("paper_sigma_a_red".to_string(), paper.sigma_a[0]),
        ("paper_sigma_s_red".to_string(), paper.sigma_s[0]),
        ("transmittance_reduced_chi2".to_string(), chi2 / freedom),
        ("gauge_thickness_relative".to_string(), wide.gauge[0] / h),
        ("down_weighted_texels".to_string(), wide.locals.iter().filter(|l| l.weight < 1.0).count() as f64),
    ])
}
