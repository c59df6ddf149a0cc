//! The leaf-wide problem: one σa and σs a channel for the whole leaf, and a thickness h + δ and albedo factors γ for
//! each texel.
//!
//! It minimises Σ over texels and channels of (ρt − T(σ, h + δ))²/variance under the gauges mean(h + δ) = h and mean γ
//! = 1 a channel, where γ = ρd / R(σ, h + δ) exactly. T and R are the slab's transmittance and reflectance. δ is
//! eliminated texel by texel (for ln σ there remains the Schur complement of an arrow-shaped normal matrix), and γ in
//! closed form. So each iteration solves for six unknowns under four constraints, however many texels there are. Wang
//! et al. 2005 solve every texel and average instead (`paper.rs`).

mod elimination;
mod gauge;

use crate::leaf::curve::{Incidence, ThicknessCurve};
use elimination::eliminate;
use gauge::{constrained_step, covariance};
use mesophyll_base::rgb::Rgb;
use mesophyll_base::solvers::damping::{self, DampedProblem, DampingControl};
use mesophyll_base::solvers::{Termination, Trace, TraceRow};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use std::time::Instant;

type V6 = SVector<f64, 6>;
type M6 = SMatrix<f64, 6, 6>;

/// Texels in a work unit. The number is fixed so that sums do not depend on the number of threads.
const UNIT: usize = 4096;

/// The readings of one texel; only good texels are passed to the fit.
#[derive(Debug, Clone, Copy, Default)]
pub struct LeafWideTexel {
    /// Diffuse reflectance ρd, a channel each.
    pub rho_d: Rgb,
    /// Standard error of ρd, a channel each.
    pub rho_d_err: Rgb,
    /// Transmittance ρt, a channel each.
    pub rho_t: Rgb,
    /// Noise of ρt without light. A transmittance T has the variance (relative·T)² + floor²; the relative part is
    /// [`LeafWideSettings::relative`].
    pub rho_t_floor: Rgb,
    /// Covariance of ρd and ρt, a channel each: the same dark frame was subtracted from both.
    pub covariance: Rgb,
}

impl LeafWideTexel {
    /// Variance of the measured ρt of channel `c` where the model says `value`.
    pub fn variance(&self, c: usize, value: f64, relative: f64) -> f64 {
        (relative * value).powi(2) + self.rho_t_floor[c].powi(2)
    }
}

/// The good texels (by their place in the list) whose mean stands in the gauges for one texel of the leaf that could
/// not be measured.
pub type GaugeSubstitutes = Vec<u32>;

/// Thickness and albedo factors of one texel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TexelInterior {
    /// h + δ (mm)
    pub thickness: f64,
    /// Standard error of the thickness (mm).
    pub thickness_err: f64,
    /// d ln thickness / d ρt, a channel.
    pub pull: Rgb,
    /// γ: the texel's reflectance relative to the leaf's, a channel each.
    pub gamma: Rgb,
    /// Standard error of γ, a channel each.
    pub gamma_err: Rgb,
    /// χ² of the transmittance (three channels, one unknown).
    pub chi2: f64,
    /// 1 for a texel that the fit believes, less for one it weighs down.
    pub weight: f64,
}

/// The fitted leaf.
#[derive(Debug, Clone)]
pub struct LeafWideFit {
    /// Absorption coefficient σa (1/mm), a channel each.
    pub sigma_a: Rgb,
    /// Scattering coefficient σs (1/mm), a channel each.
    pub sigma_s: Rgb,
    /// Covariance of (ln σa, ln σs) a channel, in the order r_a, r_s, g_a, g_s, b_a, b_s. It is statistical only; the
    /// error of h comes on top.
    pub covariance: M6,
    /// Thickness and γ of every texel, in the order of the texels.
    pub locals: Vec<TexelInterior>,
    /// How the descent ended.
    pub termination: Termination,
    /// The steps of the descent, each with its cost.
    pub trace: Trace,
    /// Condition number of the problem in the shared parameters, at the solution.
    pub condition: f64,
    /// How many directions of the shared parameters the texels determine.
    pub rank: usize,
    /// The fitted slab's response over thickness, a channel each.
    pub curves: Rgb<ThicknessCurve>,
    /// What is left of the gauges: mean thickness − h (mm) and mean γ − 1.
    pub gauge: [f64; 4],
}

/// Settings of [`fit`].
#[derive(Debug, Clone, Copy)]
pub struct LeafWideSettings {
    /// Mean thickness by caliper (mm).
    pub h: f64,
    /// Incidence of the light that ρt was measured with.
    pub incidence: Incidence,
    /// Noise of a transmittance, relative to it.
    pub relative: f64,
    /// Whether texels that no thickness explains get less weight.
    pub robust: bool,
    /// Steps of the descent at most.
    pub iterations: usize,
    /// Errors that all ρd have in common and that their own noise does not include.
    pub common: LeafSharedErrors,
}

/// Relative standard errors of ρd that every texel of the leaf shares, so that no average takes them away.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LeafSharedErrors {
    /// The part that is alike in the three channels.
    pub shared: f64,
    /// The part of each channel alone.
    pub own: Rgb,
}

/// Sums over texels for one Gauss–Newton step.
struct Sums {
    cost: f64,
    /// Sum of the texels' weights in the gauges.
    weight: f64,
    hessian: M6,
    gradient: V6,
    gauge: [f64; 4],
    jacobian: SMatrix<f64, 4, 6>,
    /// Covariance of the gauges' own noise (sums of squares).
    gauge_noise: SMatrix<f64, 4, 4>,
}

impl Sums {
    fn zero() -> Self {
        Sums {
            cost: 0.0,
            weight: 0.0,
            hessian: M6::zeros(),
            gradient: V6::zeros(),
            gauge: [0.0; 4],
            jacobian: SMatrix::zeros(),
            gauge_noise: SMatrix::zeros(),
        }
    }
    fn add(mut self, o: &Sums) -> Self {
        self.cost += o.cost;
        self.weight += o.weight;
        self.hessian += o.hessian;
        self.gradient += o.gradient;
        for k in 0..4 {
            self.gauge[k] += o.gauge[k];
        }
        self.jacobian += o.jacobian;
        self.gauge_noise += o.gauge_noise;
        self
    }

    /// What is left of the gauges: mean thickness − h (mm) and mean γ − 1 a channel.
    fn gap(&self, h: f64) -> [f64; 4] {
        let mean = self.gauge.map(|g| g / self.weight);
        [mean[0] - h, mean[1] - 1.0, mean[2] - 1.0, mean[3] - 1.0]
    }
}

/// Fits the leaf-wide problem from `start` = (σa, σs) a channel. `texels` must not be empty. Each list of `missing`
/// stands for one texel of the leaf that could not be measured: its neighbours' mean takes its place in the gauges, so
/// that losing a few texels does not move the leaf's means.
pub fn fit(
    texels: &[LeafWideTexel],
    missing: &[GaugeSubstitutes],
    start: Rgb<[f64; 2]>,
    settings: &LeafWideSettings,
) -> LeafWideFit {
    let mut weights = vec![1.0; texels.len()];
    for stand_ins in missing {
        stand_ins.iter().for_each(|&k| weights[k as usize] += 1.0 / stand_ins.len() as f64);
    }
    let mut leaf = Leaf { texels, weights, settings, evaluations: 0, trace: Vec::new(), clock: Instant::now() };
    let p = V6::from_fn(|k, _| start[k / 2][k % 2].max(1e-6).ln());
    let start = leaf.evaluate(p, vec![f64::NAN; texels.len()]);
    let control = DampingControl { iterations: settings.iterations, ..DampingControl::SHORTENED };
    let (Point { p, curves, mut sums, locals, .. }, termination) = damping::minimize(&mut leaf, start, &control);
    sums.gauge_noise += stand_in_noise(&locals, missing);
    let (covariance, condition, rank) = covariance(&sums, &settings.common);
    let gauge = sums.gap(settings.h);
    LeafWideFit {
        sigma_a: Rgb::of(|c| p[2 * c].exp()),
        sigma_s: Rgb::of(|c| p[2 * c + 1].exp()),
        covariance,
        locals,
        termination,
        trace: leaf.trace,
        condition,
        rank,
        curves,
        gauge,
    }
}

/// The problem, and what its descent has come to.
struct Leaf<'a> {
    texels: &'a [LeafWideTexel],
    /// The weight of each texel in the gauges.
    weights: Vec<f64>,
    settings: &'a LeafWideSettings,
    evaluations: usize,
    trace: Trace,
    clock: Instant,
}

/// Logarithms of σa and σs a channel, and what follows from them: every texel's ln thickness, γ and the sums.
struct Point {
    p: V6,
    ln_t: Vec<f64>,
    curves: Rgb<ThicknessCurve>,
    sums: Sums,
    locals: Vec<TexelInterior>,
}

/// A step shorter than this share was cut seven times.
const SHORTEST: f64 = 2e-3;

impl DampedProblem for Leaf<'_> {
    type Point = Point;
    type Step = V6;

    fn step(&mut self, at: &Point, damping: f64) -> Option<V6> {
        let gauge = at.sums.gap(self.settings.h);
        let step = constrained_step(&at.sums, &gauge, damping)?;
        let limited = step * (0.7 / step.amax().max(0.7));
        self.trace.push(TraceRow {
            iteration: self.trace.len(),
            evaluations: self.evaluations,
            elapsed_s: self.clock.elapsed().as_secs_f64(),
            cost: at.sums.cost,
            gradient: self.distance(&gauge),
            step: limited.amax(),
            truth_error: None,
        });
        (step.iter().all(|v| v.is_finite()) && at.sums.cost.is_finite()).then_some(limited)
    }

    fn end(&mut self, _: &mut Point, step: &V6) -> Option<Termination> {
        (step.amax() < 1e-9).then_some(Termination::StepSmall)
    }

    fn take(&mut self, at: &Point, step: &V6, share: f64) -> Point {
        self.evaluate(at.p + step * share, at.ln_t.clone())
    }

    /// Keeps a step that brings the gauges or the cost closer to their goal.
    fn better(&self, at: &Point, trial: &Point) -> bool {
        let merit =
            |at: &Point| at.sums.cost / self.texels.len() as f64 + 1e3 * self.distance(&at.sums.gap(self.settings.h));
        let after = merit(trial);
        after.is_finite() && after <= merit(at) * (1.0 + 1e-9) + 1e-12
    }

    fn stalled(&self, _: &Point, step: &V6, share: f64) -> Option<Termination> {
        (share < SHORTEST && step.amax() < 1e-6).then_some(Termination::CostConverged)
    }
}

impl Leaf<'_> {
    /// How far the gauges are from where they must be.
    fn distance(&self, gauge: &[f64; 4]) -> f64 {
        gauge[0].abs() / self.settings.h + gauge[1].abs() + gauge[2].abs() + gauge[3].abs()
    }

    /// Eliminates thickness and γ of every texel at σ = exp(p), starting from the last thickness where there is one.
    /// Then it adds up the sums that the step needs.
    fn evaluate(&mut self, p: V6, mut ln_t: Vec<f64>) -> Point {
        self.evaluations += 1;
        let settings = self.settings;
        let curve = |c: usize| ThicknessCurve::new(p[2 * c].exp(), p[2 * c + 1].exp(), settings.h, settings.incidence);
        let (r, (g, b)) = rayon::join(|| curve(0), || rayon::join(|| curve(1), || curve(2)));
        let curves = Rgb([r, g, b]);
        let parts: Vec<(Sums, Vec<TexelInterior>)> = self
            .texels
            .par_chunks(UNIT)
            .zip(self.weights.par_chunks(UNIT))
            .zip(ln_t.par_chunks_mut(UNIT))
            .map(|((texels, weights), ln_t)| {
                let mut sums = Sums::zero();
                let each = texels.iter().zip(weights).zip(ln_t);
                let locals =
                    each.map(|((x, weight), t)| eliminate(x, *weight, t, &curves, settings, &mut sums)).collect();
                (sums, locals)
            })
            .collect();
        let mut locals = Vec::with_capacity(self.texels.len());
        let mut total = Sums::zero();
        for (sums, part) in parts {
            total = total.add(&sums);
            locals.extend(part);
        }
        Point { p, ln_t, curves, sums: total, locals }
    }
}

/// Covariance of the errors that the stand-ins make in the sums of the gauges. Each missing value is taken to scatter
/// about its neighbours' mean as the neighbours do.
fn stand_in_noise(locals: &[TexelInterior], missing: &[GaugeSubstitutes]) -> SMatrix<f64, 4, 4> {
    let mut total = SMatrix::<f64, 4, 4>::zeros();
    for stand_ins in missing.iter().filter(|s| s.len() > 1) {
        let n = stand_ins.len() as f64;
        let values: Vec<SVector<f64, 4>> = stand_ins
            .iter()
            .map(|&k| {
                let l = &locals[k as usize];
                SVector::from([l.thickness, l.gamma[0], l.gamma[1], l.gamma[2]])
            })
            .collect();
        let mean = values.iter().sum::<SVector<f64, 4>>() / n;
        let scatter: SMatrix<f64, 4, 4> = values.iter().map(|v| (v - mean) * (v - mean).transpose()).sum();
        total += scatter * ((1.0 + 1.0 / n) / (n - 1.0));
    }
    total
}

#[cfg(test)]
mod tests;
