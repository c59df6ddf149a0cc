//! One run of the descent: its trial steps, whether they are accepted, and why it stops.

// A comparison with NaN is false, so `!(a < b)` is written where NaN must fail.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::factor::Factor;
use super::{Fit, Options};
use crate::solvers::problem::Problem;
use crate::solvers::trace::{Termination, Trace, TraceRow};
use crate::solvers::uncertainty::Uncertainty;
use crate::solvers::{jacobian, qr};
use std::time::Instant;

/// Relative offset (see [`minimize`]) below which a stalled cost or radius counts as convergence: 1e-8 of the cost can
/// still be gained.
const SETTLED: f64 = 1e-4;

/// One run's working state.
pub(super) struct Run<'a> {
    problem: &'a dyn Problem,
    options: &'a Options,
    n: usize,
    pub(super) m: usize,
    x: Vec<f64>,
    pub(super) r: Vec<f64>,
    /// Jacobian at `x`, column-major.
    j: Vec<f64>,
    /// |r|. Ratios are formed with it and not with the cost, whose square leaves the range of `f64` much earlier.
    norm: f64,
    /// Diagonal of D.
    scale: Vec<f64>,
    evaluations: usize,
    analytic: bool,
    clock: Instant,
    trace: Trace,
}

impl<'a> Run<'a> {
    /// A run at `start`, which is moved onto the bounds where it lies beyond them.
    pub(super) fn new(problem: &'a dyn Problem, options: &'a Options, start: &[f64]) -> Self {
        let (n, m) = (problem.parameters(), problem.residuals());
        let mut run = Run {
            problem,
            options,
            n,
            m,
            x: start.to_vec(),
            r: vec![0.0; m],
            j: vec![0.0; n * m],
            norm: 0.0,
            scale: vec![0.0; n],
            evaluations: 0,
            analytic: true,
            clock: Instant::now(),
            trace: Vec::new(),
        };
        for k in 0..n {
            run.x[k] = run.x[k].max(run.low(k)).min(run.high(k));
        }
        run
    }
    fn low(&self, k: usize) -> f64 {
        self.options.lower.get(k).copied().unwrap_or(f64::NEG_INFINITY)
    }

    fn high(&self, k: usize) -> f64 {
        self.options.upper.get(k).copied().unwrap_or(f64::INFINITY)
    }

    /// Writes the Jacobian at `x` into `out` and returns whether all of it is finite.
    fn differentiate(&mut self, x: &[f64], out: &mut [f64]) -> bool {
        self.analytic = self.problem.jacobian(x, out);
        self.evaluations += if self.analytic {
            1
        } else {
            jacobian::numeric(self.problem, x, &self.options.lower, &self.options.upper, out)
        };
        out.iter().all(|v| v.is_finite())
    }

    fn rank_tolerance(&self) -> f64 {
        self.options.rank_tolerance.unwrap_or(if self.analytic { self.n as f64 * f64::EPSILON } else { 1e-10 })
    }

    pub(super) fn column(&self, k: usize) -> &[f64] {
        &self.j[k * self.m..(k + 1) * self.m]
    }

    /// Cosine of the angle between a column of the Jacobian and the residuals: the gradient without its scale. 0 for a
    /// column of zeros.
    fn cosine(&self, k: usize) -> f64 {
        let (column, length) = (self.column(k), qr::length(self.column(k)));
        if length == 0.0 || self.norm == 0.0 {
            return 0.0;
        }
        column.iter().zip(&self.r).map(|(c, r)| (c / length) * (r / self.norm)).sum()
    }

    /// Parameters that may move: those that do not rest on a bound which the descent direction points out of.
    fn free(&self) -> Vec<usize> {
        (0..self.n)
            .filter(|&k| {
                !(self.x[k] <= self.low(k) && self.cosine(k) >= 0.0
                    || self.x[k] >= self.high(k) && self.cosine(k) <= 0.0)
            })
            .filter(|&k| self.low(k) < self.high(k))
            .collect()
    }

    fn update_scale(&mut self) {
        for k in 0..self.n {
            let norm = qr::length(self.column(k));
            self.scale[k] = self.scale[k].max(norm);
        }
    }

    /// The diagonal of D, with ones where a column has been zero so far.
    pub(super) fn weight(&self, k: usize) -> f64 {
        if self.scale[k] > 0.0 { self.scale[k] } else { 1.0 }
    }

    fn scaled_length(&self, x: &[f64]) -> f64 {
        let scaled: Vec<f64> = x.iter().enumerate().map(|(k, v)| v * self.weight(k)).collect();
        qr::length(&scaled)
    }

    fn record(&mut self, iteration: usize, step: f64) {
        let gradient = (0..self.n).map(|k| dot(self.column(k), &self.r).abs()).fold(0.0, qr::nan_max);
        self.trace.push(TraceRow {
            iteration,
            evaluations: self.evaluations,
            elapsed_s: self.clock.elapsed().as_secs_f64(),
            cost: 0.5 * self.norm * self.norm,
            gradient,
            step,
            truth_error: None,
        });
    }

    pub(super) fn iterate(&mut self) -> Termination {
        let options = self.options;
        self.problem.evaluate(&self.x, &mut self.r);
        self.evaluations += 1;
        self.norm = qr::length(&self.r);
        let mut j = std::mem::take(&mut self.j);
        let x = self.x.clone();
        let finite = self.differentiate(&x, &mut j);
        self.j = j;
        if !self.norm.is_finite() || !finite {
            return Termination::NotFinite;
        }
        self.update_scale();
        if self.norm > 0.0 && self.scale.iter().all(|s| *s == 0.0) {
            return Termination::Flat;
        }
        let first_norm = self.norm;
        let mut x_length = self.scaled_length(&self.x);
        let mut radius = options.initial_radius * if x_length > 0.0 { x_length } else { 1.0 };
        self.record(0, 0.0);

        for iteration in 1..=options.max_iterations {
            let free = self.free();
            let cosine = free.iter().map(|&k| self.cosine(k).abs()).fold(0.0, qr::nan_max);
            if cosine <= options.gradient_tolerance {
                let slopes = (0..self.n).any(|k| qr::length(self.column(k)) > 0.0);
                return if slopes || self.norm == 0.0 { Termination::GradientSmall } else { Termination::Flat };
            }
            let factor = Factor::new(self, &free);
            let norm = self.norm;
            // The rounding of the terms of the residuals, relative to the residuals. An offset below it is noise (in
            // problems with zero residuals).
            let terms: f64 = (0..self.n).map(|k| qr::length(self.column(k)) * self.x[k].abs()).sum();
            let rounding = 4.0 * f64::EPSILON * (first_norm + terms) / norm;
            let tolerance = self.rank_tolerance();
            let settled = || factor.offset(tolerance) / norm <= SETTLED + rounding;
            loop {
                let trial = self.trial(&factor, &free, radius);
                if !(trial.length > 0.0) {
                    return if settled() { Termination::StepSmall } else { Termination::NoProgress };
                }
                if iteration == 1 {
                    radius = radius.min(trial.length);
                }
                // Gain ratio: the actual decrease of the cost over the decrease that the linear model promised.
                let actual =
                    if trial.norm < 3.0 * norm { 1.0 - (trial.norm / norm) * (trial.norm / norm) } else { -1.0 };
                let predicted = trial.predicted;
                let ratio = if predicted > 0.0 { actual / predicted } else { -1.0 };
                if !(ratio > 0.25) {
                    // The parabola through the cost, its slope and the trial cost has its minimum at this share.
                    let slope = trial.slope.min(0.0);
                    let shrink = if actual >= 0.0 { 0.5 } else { 0.5 * slope / (slope + actual) };
                    radius = trial.length.min(radius)
                        * if trial.norm.is_finite() && shrink > 0.1 { shrink.min(0.5) } else { 0.1 };
                } else if trial.full || ratio >= 0.75 {
                    radius = radius.max(2.0 * trial.length);
                }
                let cost_small =
                    actual.abs() <= options.cost_tolerance && predicted <= options.cost_tolerance && 0.5 * ratio <= 1.0;
                let step_small = trial.length <= options.step_tolerance * x_length;
                let mut accepted = false;
                if ratio > 1e-4 {
                    let mut j = vec![0.0; self.n * self.m];
                    if self.differentiate(&trial.x, &mut j) {
                        accepted = true;
                        self.x.clone_from(&trial.x);
                        self.r.clone_from(&trial.r);
                        self.norm = trial.norm;
                        self.j = j;
                        self.update_scale();
                        x_length = self.scaled_length(&self.x);
                        self.record(iteration, trial.length);
                    } else {
                        radius = 0.1 * trial.length;
                    }
                }
                if self.norm == 0.0 {
                    return Termination::GradientSmall;
                }
                if cost_small && settled() {
                    return Termination::CostConverged;
                }
                if accepted && step_small && trial.full {
                    return Termination::StepSmall;
                }
                if accepted {
                    break;
                }
                if radius <= 1e-3 * f64::EPSILON * x_length || radius < f64::MIN_POSITIVE {
                    return if settled() { Termination::StepSmall } else { Termination::NoProgress };
                }
            }
        }
        Termination::IterationLimit
    }

    /// A step within the radius, projected onto the bounds, with its cost and what the linear model promises for it.
    fn trial(&mut self, factor: &Factor, free: &[usize], radius: f64) -> Trial {
        let (full, step) = factor.step(radius);
        let mut x = self.x.clone();
        for (p, &k) in step.iter().zip(free) {
            x[k] = (x[k] + p).max(self.low(k)).min(self.high(k));
        }
        let moved: Vec<f64> = x.iter().zip(&self.x).map(|(a, b)| a - b).collect();
        let length = self.scaled_length(&moved);
        let mut linear = vec![0.0; self.m];
        for (k, step) in moved.iter().enumerate().filter(|(_, step)| **step != 0.0) {
            for (l, c) in linear.iter_mut().zip(self.column(k)) {
                *l += step * c;
            }
        }
        for l in &mut linear {
            *l /= self.norm;
        }
        // Both relative to the cost.
        let slope = 2.0 * linear.iter().zip(&self.r).map(|(l, r)| l * (r / self.norm)).sum::<f64>();
        let predicted = -slope - dot(&linear, &linear);
        let mut r = vec![0.0; self.m];
        self.problem.evaluate(&x, &mut r);
        self.evaluations += 1;
        let norm = qr::length(&r);
        Trial { x, r, norm, length, predicted, slope, full }
    }

    pub(super) fn finish(mut self, termination: Termination) -> Fit {
        let moved = self.trace.len() > 1;
        let useless = match termination {
            Termination::Refused | Termination::Flat => true,
            t => !t.converged() && !moved,
        };
        let at_bound: Vec<usize> =
            (0..self.n).filter(|&k| self.x[k] <= self.low(k) || self.x[k] >= self.high(k)).collect();
        let mut fit = Fit {
            trace: std::mem::take(&mut self.trace),
            evaluations: self.evaluations,
            ..Fit::failed(self.n, self.m, termination)
        };
        if useless {
            return fit;
        }
        fit.cost = 0.5 * self.norm * self.norm;
        let tolerance = self.rank_tolerance();
        if termination.converged() {
            let (mut j, mut r) = (self.j.clone(), self.r.clone());
            qr::reduce(&mut j, self.m, self.n, &mut r);
            fit.uncertainty = Uncertainty::from_triangle(
                &j,
                self.m,
                self.m,
                self.n,
                self.norm * self.norm,
                self.options.noise,
                tolerance,
            );
        }
        fit.params = self.x;
        fit.residuals = self.r;
        fit.at_bound = at_bound;
        fit
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// A trial point and how it compares with the linear model.
struct Trial {
    x: Vec<f64>,
    r: Vec<f64>,
    /// |r|; not finite where the model has no value.
    norm: f64,
    /// |D p| of the projected step.
    length: f64,
    /// Decrease of the cost that the linear model promises, relative to the cost.
    predicted: f64,
    /// Slope of the cost along the step, relative to the cost.
    slope: f64,
    /// Whether it is an undamped Gauss–Newton step.
    full: bool,
}
