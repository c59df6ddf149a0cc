//! Where the descents begin. A coarse search over suns and turbidities is judged by the median of absolute log ratios,
//! which clouds and trees do not move. Then robust descents start from the best few.

use super::descent::{SunChart, modelled};
use super::picture::{PanoramaPixel, PanoramaReadings};
use mesophyll_base::solvers::{ClosureProblem, Options, Termination, Trace, lm};
use mesophyll_base::statistics::median;
use mesophyll_sky::preetham::{PreethamTurbidity, xyz_from_separable};
use mesophyll_sky::{colour, sun_direction};
use std::f64::consts::TAU;

/// A guess of sun, turbidity and scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PanoramaGuess {
    pub zenith: f64,
    pub azimuth: f64,
    pub turbidity: f64,
    pub scale: f64,
    /// Robust cost.
    pub cost: f64,
}

/// Zenith angles and turbidities of the coarse search; azimuths are [`AROUND`] apart.
const ZENITHS: [f64; 8] = [0.1, 0.35, 0.6, 0.85, 1.1, 1.3, 1.45, 1.55];
const TURBIDITIES: [f64; 4] = [2.1, 2.8, 4.0, 7.0];
const AROUND: usize = 16;
/// How many pixels the coarse search uses, and how many the descents use.
const FEW: usize = 90;
const MORE: usize = 200;
/// How many descents are made.
const TRIES: usize = 4;
/// Starts that are closer to each other than this (rad) count as one.
const APART: f64 = 0.3;
/// Where the robust loss turns from square to logarithm, in standard errors of a reading, and the smallest standard
/// error that is assumed (relative): models have errors, too.
const TURN: f64 = 2.0;
const LEAST_NOISE: f64 = 0.03;

/// The result of the descents from all starts.
pub struct PanoramaStarts {
    /// Distinct minima by rising cost.
    pub guesses: Vec<PanoramaGuess>,
    pub failed: usize,
    pub trace: Trace,
    pub evaluations: usize,
}

/// Every n-th pixel, with n such that about `count` remain.
fn thinned(pixels: &[PanoramaPixel], count: usize) -> Vec<PanoramaPixel> {
    let step = (pixels.len() as f64 / count as f64).max(1.0);
    (0..pixels.len().min(count)).map(|k| pixels[((k as f64 + 0.5) * step) as usize % pixels.len()]).collect()
}

/// Candidates with rising score, each far enough from the better ones.
fn coarse(picture: &PanoramaReadings) -> Vec<PanoramaGuess> {
    // The brightest place is an additional candidate.
    let peak = picture.pixels.iter().max_by(|a, b| a.value[0].total_cmp(&b.value[0]));
    let mut suns: Vec<(f64, f64)> = ZENITHS
        .iter()
        .flat_map(|z| {
            let count = ((AROUND as f64 * z.sin()).ceil() as usize).max(3);
            (0..count).map(move |k| (*z, TAU * k as f64 / count as f64))
        })
        .collect();
    suns.extend(peak.map(|p| (p.d[2].acos(), p.d[1].atan2(p.d[0]))));
    scored(picture, &suns)
}

/// The start for a sun whose zenith angle and azimuth are known; nothing where no sky of the model comes near.
pub fn held(picture: &PanoramaReadings, zenith: f64, azimuth: f64) -> PanoramaStarts {
    let guesses = scored(picture, &[(zenith, azimuth)]);
    PanoramaStarts { guesses, failed: 0, trace: Trace::new(), evaluations: 0 }
}

/// The best turbidity and scale of each sun (zenith angle, azimuth).
fn scored(picture: &PanoramaReadings, suns: &[(f64, f64)]) -> Vec<PanoramaGuess> {
    let pixels = thinned(&picture.pixels, FEW);
    let bright: Vec<f64> = pixels
        .iter()
        .map(|p| if picture.channels == 3 { colour::xyz_from_rgb(p.value)[1] } else { p.value[0] })
        .map(|v| if v > 0.0 { v.ln() } else { f64::NAN })
        .collect();
    let turbids = TURBIDITIES.map(PreethamTurbidity::new);
    let mut all: Vec<PanoramaGuess> = Vec::new();
    let (mut ratios, mut spread) = (Vec::new(), Vec::new());
    for &(zenith, azimuth) in suns {
        let sun = turned(sun_direction(zenith), azimuth);
        let gammas: Vec<f64> = pixels.iter().map(|p| angle(p.d, sun)).collect();
        let mut best: Option<PanoramaGuess> = None;
        for turbid in &turbids {
            let p = turbid.prefactors(zenith);
            ratios.clear();
            for (k, pixel) in pixels.iter().enumerate() {
                let s = turbid.separable(pixel.d[2], gammas[k]);
                let ratio = bright[k] - xyz_from_separable([p[0] * s[0], p[1] * s[1], p[2] * s[2]])[1].ln();
                if ratio.is_finite() {
                    ratios.push(ratio);
                }
            }
            let middle = median(&mut ratios).unwrap_or(f64::NAN);
            spread.clear();
            spread.extend(ratios.iter().map(|r| (r - middle).abs()));
            let cost = median(&mut spread).unwrap_or(f64::NAN);
            if cost.is_finite() && best.is_none_or(|b| cost < b.cost) {
                best = Some(PanoramaGuess { zenith, azimuth, turbidity: turbid.turbidity, scale: middle.exp(), cost });
            }
        }
        all.extend(best);
    }
    all.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut kept: Vec<PanoramaGuess> = Vec::new();
    for g in all {
        let near = |k: &PanoramaGuess| {
            angle(turned(sun_direction(k.zenith), k.azimuth), turned(sun_direction(g.zenith), g.azimuth)) < APART
        };
        if kept.len() < TRIES && !kept.iter().any(near) {
            kept.push(g);
        }
    }
    kept
}

/// Robust descents from the best candidates.
pub fn find(picture: &PanoramaReadings, noise: f64) -> PanoramaStarts {
    let pixels = thinned(&picture.pixels, MORE);
    let channels = picture.channels;
    let level = noise.max(LEAST_NOISE);
    let mean = pixels.iter().map(|p| p.value[0]).sum::<f64>() / pixels.len() as f64;
    let sigma: Vec<f64> =
        pixels.iter().flat_map(|p| (0..channels).map(move |k| level * (p.value[k].abs() + 0.1 * mean))).collect();
    let mut out = PanoramaStarts { guesses: Vec::new(), failed: 0, trace: Trace::new(), evaluations: 0 };
    let mut best = f64::INFINITY;
    for guess in coarse(picture) {
        let chart = SunChart::at(guess.zenith, guess.azimuth);
        let problem = ClosureProblem::new(4, pixels.len() * channels, |p: &[f64], r: &mut [f64]| {
            modelled(chart, p, &pixels, channels, r);
            for (i, r) in r.iter_mut().enumerate() {
                let z = (*r - pixels[i / channels].value[i % channels]) / sigma[i];
                // Cauchy's loss as a residual: its square is TURN² ln(1 + (z/TURN)²)
                *r = z.signum() * TURN * ((z / TURN).powi(2)).ln_1p().sqrt();
            }
        });
        let (lower, upper) = chart.bounds();
        let options = Options {
            lower,
            upper,
            max_iterations: 60,
            step_tolerance: 1e-5,
            cost_tolerance: 1e-7,
            ..Options::default()
        };
        let fit = lm::minimize(&problem, &chart.start(&guess), &options);
        out.evaluations += fit.evaluations;
        // It does not matter if the limit of iterations is reached: the result is only a start.
        let usable =
            fit.converged() || matches!(fit.termination, Termination::IterationLimit | Termination::NoProgress);
        if !usable || fit.params.iter().any(|v| !v.is_finite()) {
            out.failed += 1;
            continue;
        }
        let (zenith, azimuth) = chart.sun(&fit.params);
        let found =
            PanoramaGuess { zenith, azimuth, turbidity: fit.params[2], scale: fit.params[3].exp(), cost: fit.cost };
        if fit.cost < best {
            (best, out.trace) = (fit.cost, fit.trace);
        }
        out.guesses.push(found);
    }
    out.guesses.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut distinct: Vec<PanoramaGuess> = Vec::new();
    for g in &out.guesses {
        let same = |k: &PanoramaGuess| {
            angle(turned(sun_direction(k.zenith), k.azimuth), turned(sun_direction(g.zenith), g.azimuth)) < 0.05
        };
        if !distinct.iter().any(same) {
            distinct.push(*g);
        }
    }
    out.guesses = distinct;
    out
}

/// `d` turned about z.
pub fn turned(d: [f64; 3], azimuth: f64) -> [f64; 3] {
    let (s, c) = azimuth.sin_cos();
    [c * d[0] - s * d[1], s * d[0] + c * d[1], d[2]]
}

/// Angle between unit vectors, precise for small and large angles.
pub fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    (cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2])
        .sqrt()
        .atan2(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
}
