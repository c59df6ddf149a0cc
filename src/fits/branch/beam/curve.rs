//! Least squares of the elastica on the marks of one branch, under one kind of load.

use super::fit::{DeflectionMark, PositionReference};
use mesophyll_base::solvers::{Fit, Options, Problem, ResidualNoise, Termination, lm, multi_start};
use mesophyll_plants::mechanics::beam::{TAPER_MAX, TAPER_MIN};
use mesophyll_plants::mechanics::elastica::Elastica;
use mesophyll_plants::mechanics::load::Load;

/// How many tapers are tried for the best start.
const STARTS: usize = 24;
/// Tapers, and shares of the best start's amplitude, from where the search goes on where it failed.
const OTHER_STARTS: [(f64, f64); 4] = [(0.05, 1.0), (0.3, 1.0), (0.3, 3.0), (0.9, 3.0)];
/// An amplitude under which every branch is linear.
const SLIGHT: f64 = 1e-7;
/// Step of the differences that give the derivatives, of ln α and relative to A. Their error is of the order of its
/// square, and the curve's rounding over it is below 1e-7.
const STEP: f64 = 1e-5;
/// What the curve is right to, in units of the length.
pub const PRECISION: f64 = 1e-9;

/// The marks of one branch and what they are compared with. Parameters are ln α and A = F/(E′r₁⁴) over the length, or A
/// alone where the branch is held untapered.
#[derive(Debug, Clone, Copy)]
pub struct BranchFitMarks<'a> {
    /// The marks; none at the root.
    pub readings: &'a [DeflectionMark],
    /// Length of the branch (mm).
    pub length: f64,
    /// What positions were measured along.
    pub along: PositionReference,
    /// The kind of load, with its place as a share of the length.
    pub load: Load,
    /// Whether deflections have stated errors.
    pub stated: bool,
    /// Whether the taper is held at 1.
    pub untapered: bool,
}

/// The marks with one residual more, which is constant and as large as what the curve is not right to. Readings that
/// agree with the curve to its last digits (computed, not measured) have no minimum that a solver could settle in:
/// where they differ, it is rounding. Beside the constant that does not matter.
struct Rounded<'a> {
    marks: &'a BranchFitMarks<'a>,
    constant: f64,
}

impl BranchFitMarks<'_> {
    /// Standard error that a reading is divided by (mm).
    pub fn scale(&self, r: &DeflectionMark) -> f64 {
        if self.stated { r.error } else { 1.0 }
    }

    /// Whether standard errors are stated.
    pub fn noise(&self) -> ResidualNoise {
        if self.stated { ResidualNoise::Known } else { ResidualNoise::Estimated }
    }

    fn taper(&self, params: &[f64]) -> f64 {
        if self.untapered { 1.0 } else { params[0].exp() }
    }

    /// Deflection of a mark (mm).
    fn across(&self, bent: &Elastica, r: &DeflectionMark) -> f64 {
        let x = (r.position / self.length).min(1.0);
        self.length
            * match self.along {
                PositionReference::Branch => bent.at(x).across,
                PositionReference::Axis => bent.below(x).across,
            }
    }

    fn write(&self, bent: Option<&Elastica>, out: &mut [f64]) {
        for (r, out) in self.readings.iter().zip(out) {
            *out = bent.map_or(f64::NAN, |bent| (self.across(bent, r) - r.deflection) / self.scale(r));
        }
    }

    /// The curves a little to both sides of `params` in the parameter `k`, and the distance between them.
    pub fn beside(&self, bent: &Elastica, params: &[f64], k: usize) -> Option<(Elastica, Elastica, f64)> {
        let (alpha, amplitude) = (self.taper(params), params[params.len() - 1]);
        if k + 1 == params.len() {
            let h = STEP * amplitude.abs().max(1e3 * SLIGHT);
            return Some((bent.near(alpha, amplitude + h)?, bent.near(alpha, amplitude - h)?, 2.0 * h));
        }
        let upper = (params[0] + STEP).min(TAPER_MAX.ln());
        let lower = upper - 2.0 * STEP;
        let inside = |ln: f64| ln.exp().min(TAPER_MAX);
        Some((bent.near(inside(upper), amplitude)?, bent.near(inside(lower), amplitude)?, 2.0 * STEP))
    }

    /// The curve of a parameter vector.
    pub fn curve(&self, params: &[f64]) -> Option<Elastica> {
        Elastica::solve(self.load, self.taper(params).min(TAPER_MAX), params[params.len() - 1])
    }

    fn options(&self) -> Options {
        let (lower, upper) = if self.untapered {
            (vec![f64::NEG_INFINITY], vec![f64::INFINITY])
        } else {
            (vec![TAPER_MIN.ln(), f64::NEG_INFINITY], vec![TAPER_MAX.ln(), f64::INFINITY])
        };
        Options {
            lower,
            upper,
            noise: self.noise(),
            max_iterations: 200,
            // This is far below any standard error.
            step_tolerance: 1e-9,
            rank_tolerance: Some(1e-8),
            ..Options::default()
        }
    }

    /// One descent, without the patience of [`BranchFitMarks::fit`]: for loads that are only compared.
    pub fn glance(&self) -> Fit {
        lm::minimize(self, &self.start(), &Options { max_iterations: 40, ..self.options() })
    }

    /// The best fit; where the solver stopped without one, its termination says why.
    pub fn fit(&self) -> Fit {
        let options = self.options();
        let start = self.start();
        let fit = multi_start::minimize_scales(self, &start, &options);
        if fit.converged() {
            return fit;
        }
        // A branch that hangs from its root is far from the linear one that the start is made of.
        let others = OTHER_STARTS.iter().map(|(alpha, share)| {
            let amplitude = share * start[start.len() - 1];
            let start = if self.untapered { vec![amplitude] } else { vec![f64::ln(*alpha), amplitude] };
            multi_start::minimize_scales(self, &start, &options)
        });
        if let Some(fit) = others.filter(Fit::converged).min_by(|a, b| a.cost.total_cmp(&b.cost)) {
            return fit;
        }
        let smallest = self.readings.iter().map(|r| self.scale(r)).fold(f64::INFINITY, f64::min);
        let constant = PRECISION * self.length / smallest * (self.readings.len() as f64).sqrt();
        let mut fit = multi_start::minimize_scales(&Rounded { marks: self, constant }, &start, &options);
        fit.residuals.truncate(self.readings.len());
        let chi2: f64 = fit.residuals.iter().map(|r| r * r).sum();
        fit.cost = 0.5 * chi2;
        if chi2 > 100.0 * constant * constant {
            // The constant was no excuse.
            fit.termination = Termination::NoProgress;
        }
        fit.uncertainty.chi2 = chi2;
        fit.uncertainty.freedom = self.readings.len().saturating_sub(fit.uncertainty.rank);
        fit.uncertainty.reduced_chi2 = chi2 / fit.uncertainty.freedom as f64;
        fit
    }

    /// The best of a series of tapers, each with the amplitude that linear least squares gives.
    fn start(&self) -> Vec<f64> {
        let mut best = (f64::INFINITY, vec![0.3f64.ln(), 0.1]);
        // The tapers stay off the bounds.
        let tried = (0..STARTS).map(|k| 0.95 * TAPER_MIN.ln() * (k as f64 + 0.5) / STARTS as f64);
        for ln_alpha in tried.take(if self.untapered { 1 } else { STARTS }) {
            let ln_alpha = if self.untapered { 0.0 } else { ln_alpha };
            let Some(bent) = Elastica::solve(self.load, ln_alpha.exp(), SLIGHT) else { continue };
            let u: Vec<f64> =
                self.readings.iter().map(|r| bent.at((r.position / self.length).min(1.0)).across / SLIGHT).collect();
            let sum = |each: &dyn Fn(usize) -> f64| -> f64 {
                self.readings.iter().enumerate().map(|(i, r)| each(i) / self.scale(r).powi(2)).sum()
            };
            let d = |i: usize| self.readings[i].deflection / self.length;
            let amplitude = sum(&|i| u[i] * d(i)) / sum(&|i| u[i] * u[i]);
            let miss = sum(&|i| (amplitude * u[i] - d(i)).powi(2));
            if miss < best.0 {
                best = (miss, vec![ln_alpha, amplitude]);
            }
        }
        if self.untapered { vec![best.1[1]] } else { best.1 }
    }
}

impl Problem for BranchFitMarks<'_> {
    fn parameters(&self) -> usize {
        if self.untapered { 1 } else { 2 }
    }

    fn residuals(&self) -> usize {
        self.readings.len()
    }

    fn evaluate(&self, params: &[f64], out: &mut [f64]) {
        self.write(self.curve(params).as_ref(), out);
    }

    fn jacobian(&self, params: &[f64], out: &mut [f64]) -> bool {
        let Some(bent) = self.curve(params) else { return false };
        let m = self.residuals();
        let mut other = vec![0.0; m];
        for k in 0..self.parameters() {
            let Some((above, below, apart)) = self.beside(&bent, params, k) else { return false };
            let column = &mut out[k * m..(k + 1) * m];
            self.write(Some(&above), column);
            self.write(Some(&below), &mut other);
            column.iter_mut().zip(&other).for_each(|(a, b)| *a = (*a - b) / apart);
        }
        true
    }
}

impl Problem for Rounded<'_> {
    fn parameters(&self) -> usize {
        self.marks.parameters()
    }

    fn residuals(&self) -> usize {
        self.marks.residuals() + 1
    }

    fn evaluate(&self, params: &[f64], out: &mut [f64]) {
        let m = self.marks.residuals();
        self.marks.evaluate(params, &mut out[..m]);
        out[m] = self.constant;
    }

    fn jacobian(&self, params: &[f64], out: &mut [f64]) -> bool {
        let m = self.marks.residuals();
        let mut inner = vec![0.0; m * self.parameters()];
        let known = self.marks.jacobian(params, &mut inner);
        for (column, inner) in out.chunks_mut(m + 1).zip(inner.chunks(m)) {
            column[..m].copy_from_slice(inner);
            column[m] = 0.0;
        }
        known
    }
}
