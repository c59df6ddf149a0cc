//! Dense Levenberg–Marquardt with a trust region in scaled parameters, for problems of up to a few dozen parameters.
//!
//! The step solves min |J p + r|² with |D p| ≤ Δ; D holds the largest column norms met so far, so the units of the parameters do not
//! matter. Every linear system goes through QR of the Jacobian and of [R; √λ D], never through the normal equations, which would square
//! the condition number. Bounds are kept by an active set and by projecting the trial point.
//!
//! J. J. Moré, "The Levenberg–Marquardt algorithm: implementation and theory", Lecture Notes in Mathematics 630 (1978), 105–116: the trust
//! region, its scaling, Hebden's iteration for λ and the convergence tests. D. M. Bates and D. G. Watts, "A relative
//! offset orthogonality convergence criterion for nonlinear least squares", Technometrics 23 (1981), 179–183: the test that keeps a short
//! step on a plateau from passing for convergence. Geodesic acceleration (Transtrum and Sethna, arXiv:1201.5885) was tried and left out:
//! with this trust region it took more than twice the evaluations on the 54 NIST runs and lost three of them.

// A comparison with NaN is false: written as `!(a < b)` where NaN must fail.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::problem::Problem;
use super::trace::{Termination, Trace, TraceRow};
use super::uncertainty::{Noise, Uncertainty};
use super::{jacobian, qr, refine};
use nalgebra::DMatrix;
use std::time::Instant;

/// How to solve. The defaults suit every fit whose residuals are smooth.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Accepted steps at most.
    pub max_iterations: usize,
    /// Converged when the cosine between the residual vector and every column of J is below this.
    pub gradient_tolerance: f64,
    /// Converged when both the actual and the predicted decrease of the cost are below this, relatively.
    pub cost_tolerance: f64,
    /// Converged when a full step is below this, relative to the scaled parameters.
    pub step_tolerance: f64,
    /// First trust radius, in units of the scaled length of the start.
    pub initial_radius: f64,
    /// Lower bounds, one a parameter, or empty.
    pub lower: Vec<f64>,
    /// Upper bounds, one a parameter, or empty.
    pub upper: Vec<f64>,
    pub noise: Noise,
    /// Singular values below this share of the largest are zero. `None`: n·ε with derivatives, 1e-10 with numeric differences.
    pub rank_tolerance: Option<f64>,
    /// Finish in double-double where the problem can ([`Problem::refined`]) and no bound is active.
    pub refine: bool,
    /// Known parameters: the trace then holds the largest relative error to them.
    pub truth: Option<Vec<f64>>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            max_iterations: 500,
            gradient_tolerance: 1e-14,
            cost_tolerance: 1e-14,
            step_tolerance: 1e-12,
            initial_radius: 1.0,
            lower: Vec::new(),
            upper: Vec::new(),
            noise: Noise::Estimated,
            rank_tolerance: None,
            refine: true,
            truth: None,
        }
    }
}

/// What came out of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Fitted parameters. NaN where nothing was fitted ([`Termination::Refused`], [`Termination::Flat`], or not one step accepted before
    /// the solver had to stop): a start is never handed back as a result.
    pub params: Vec<f64>,
    /// Standard errors, covariance, rank, condition; all undetermined unless the fit converged.
    pub uncertainty: Uncertainty,
    /// Residuals at the solution.
    pub residuals: Vec<f64>,
    /// ½ Σ r².
    pub cost: f64,
    /// Parameters resting on a bound, by index. Their standard errors are those of the problem without bounds.
    pub at_bound: Vec<usize>,
    pub termination: Termination,
    /// A row an accepted step, the start included.
    pub trace: Trace,
    /// Evaluations of the residuals or the Jacobian (numeric Jacobians count every difference).
    pub evaluations: usize,
    /// Relative size of the last double-double step, where the solution was refined.
    pub refined: Option<f64>,
}

impl Fit {
    pub fn converged(&self) -> bool {
        self.termination.converged()
    }

    pub(super) fn failed(n: usize, m: usize, termination: Termination) -> Self {
        Fit {
            params: vec![f64::NAN; n],
            uncertainty: Uncertainty::none(n),
            residuals: vec![f64::NAN; m],
            cost: f64::NAN,
            at_bound: Vec::new(),
            termination,
            trace: Vec::new(),
            evaluations: 0,
            refined: None,
        }
    }
}

/// A relative offset (see [`minimize`]) at which a stalled cost or radius counts as convergence: 1e-8 of the cost is left to gain.
const SETTLED: f64 = 1e-4;

/// ½ Σ r², infinite where any residual is not finite.
fn half_square(r: &[f64]) -> f64 {
    let norm = qr::length(r);
    if norm.is_finite() { 0.5 * norm * norm } else { f64::INFINITY }
}

/// One run's working state.
struct Run<'a> {
    problem: &'a dyn Problem,
    options: &'a Options,
    n: usize,
    m: usize,
    x: Vec<f64>,
    r: Vec<f64>,
    /// Jacobian at `x`, column-major.
    j: Vec<f64>,
    cost: f64,
    /// Diagonal of D.
    scale: Vec<f64>,
    evaluations: usize,
    analytic: bool,
    clock: Instant,
    trace: Trace,
}

/// Minimises ½ Σ r² from `start`.
///
/// Convergence: see the tolerances in [`Options`]. A stalled cost or a collapsed radius counts only where at most 1e-8 of the cost is left
/// to gain by the linear model (or the residuals are down to their rounding); else the run goes on, or ends as [`Termination::NoProgress`].
///
/// `start` has one value a parameter; outside its bounds it is moved onto them. Never panics on what a model returns: NaN or infinite
/// residuals at a trial point shorten the step, at the start they end the run as [`Termination::NotFinite`]. Lengths that do not fit the
/// problem, empty problems, crossed bounds and a start that is not finite end as [`Termination::Refused`].
pub fn minimize(problem: &dyn Problem, start: &[f64], options: &Options) -> Fit {
    let (n, m) = (problem.parameters(), problem.residuals());
    let bound_lengths_fit = [&options.lower, &options.upper].iter().all(|b| b.is_empty() || b.len() == n);
    let bounds_make_sense = options.lower.iter().zip(&options.upper).all(|(l, u)| l <= u);
    if n == 0 || m == 0 || start.len() != n || !bound_lengths_fit || !bounds_make_sense || start.iter().any(|x| !x.is_finite()) {
        return Fit::failed(n, m, Termination::Refused);
    }
    let mut run = Run {
        problem,
        options,
        n,
        m,
        x: start.to_vec(),
        r: vec![0.0; m],
        j: vec![0.0; n * m],
        cost: 0.0,
        scale: vec![0.0; n],
        evaluations: 0,
        analytic: true,
        clock: Instant::now(),
        trace: Vec::new(),
    };
    run.project();
    let termination = run.iterate();
    run.finish(termination)
}

impl Run<'_> {
    fn low(&self, k: usize) -> f64 {
        self.options.lower.get(k).copied().unwrap_or(f64::NEG_INFINITY)
    }

    fn high(&self, k: usize) -> f64 {
        self.options.upper.get(k).copied().unwrap_or(f64::INFINITY)
    }

    fn project(&mut self) {
        for k in 0..self.n {
            self.x[k] = self.x[k].max(self.low(k)).min(self.high(k));
        }
    }

    /// Jacobian at `x` into `out`; whether all of it is finite.
    fn differentiate(&mut self, x: &[f64], out: &mut [f64]) -> bool {
        self.analytic = self.problem.jacobian(x, out);
        self.evaluations +=
            if self.analytic { 1 } else { jacobian::numeric(self.problem, x, &self.options.lower, &self.options.upper, out) };
        out.iter().all(|v| v.is_finite())
    }

    fn rank_tolerance(&self) -> f64 {
        self.options.rank_tolerance.unwrap_or(if self.analytic { self.n as f64 * f64::EPSILON } else { 1e-10 })
    }

    fn column(&self, k: usize) -> &[f64] {
        &self.j[k * self.m..(k + 1) * self.m]
    }

    fn gradient(&self) -> Vec<f64> {
        (0..self.n).map(|k| dot(self.column(k), &self.r)).collect()
    }

    /// Parameters that may move: not resting on a bound that the descent direction points out of.
    fn free(&self, gradient: &[f64]) -> Vec<usize> {
        (0..self.n)
            .filter(|&k| !(self.x[k] <= self.low(k) && gradient[k] >= 0.0 || self.x[k] >= self.high(k) && gradient[k] <= 0.0))
            .filter(|&k| self.low(k) < self.high(k))
            .collect()
    }

    fn update_scale(&mut self) {
        for k in 0..self.n {
            let norm = qr::length(self.column(k));
            self.scale[k] = self.scale[k].max(norm);
        }
    }

    /// D with ones where a column has been zero so far.
    fn weight(&self, k: usize) -> f64 {
        if self.scale[k] > 0.0 { self.scale[k] } else { 1.0 }
    }

    fn scaled_length(&self, x: &[f64]) -> f64 {
        let scaled: Vec<f64> = x.iter().enumerate().map(|(k, v)| v * self.weight(k)).collect();
        qr::length(&scaled)
    }

    fn record(&mut self, iteration: usize, gradient: &[f64], step: f64) {
        let truth_error = self.options.truth.as_ref().map(|truth| {
            self.x.iter().zip(truth).map(|(x, t)| if *t == 0.0 { x.abs() } else { (x / t - 1.0).abs() }).fold(0.0, qr::nan_max)
        });
        self.trace.push(TraceRow {
            iteration,
            evaluations: self.evaluations,
            elapsed_s: self.clock.elapsed().as_secs_f64(),
            cost: self.cost,
            gradient: gradient.iter().fold(0.0, |s: f64, g| s.max(g.abs())),
            step,
            truth_error,
        });
    }

    fn iterate(&mut self) -> Termination {
        let options = self.options;
        self.problem.evaluate(&self.x, &mut self.r);
        self.evaluations += 1;
        self.cost = half_square(&self.r);
        let mut j = std::mem::take(&mut self.j);
        let x = self.x.clone();
        let finite = self.differentiate(&x, &mut j);
        self.j = j;
        if !self.cost.is_finite() || !finite {
            return Termination::NotFinite;
        }
        self.update_scale();
        if self.cost > 0.0 && self.scale.iter().all(|s| *s == 0.0) {
            return Termination::Flat;
        }
        let first_norm = qr::length(&self.r);
        let mut x_length = self.scaled_length(&self.x);
        let mut radius = options.initial_radius * if x_length > 0.0 { x_length } else { 1.0 };
        let mut gradient = self.gradient();
        self.record(0, &gradient, 0.0);

        for iteration in 1..=options.max_iterations {
            let free = self.free(&gradient);
            let r_norm = qr::length(&self.r);
            let cosine = free
                .iter()
                .map(|&k| (gradient[k], qr::length(self.column(k))))
                .map(|(g, norm)| if norm > 0.0 && r_norm > 0.0 { g.abs() / (norm * r_norm) } else { 0.0 })
                .fold(0.0, f64::max);
            if cosine <= options.gradient_tolerance {
                let slopes = (0..self.n).any(|k| qr::length(self.column(k)) > 0.0);
                return if slopes || self.cost == 0.0 { Termination::GradientSmall } else { Termination::Flat };
            }
            let factor = Factor::new(self, &free);
            // Rounding of the residuals' own terms, relative to the residuals: below it an offset is noise (zero-residual problems).
            let terms: f64 = (0..self.n).map(|k| qr::length(self.column(k)) * self.x[k].abs()).sum();
            let rounding = 4.0 * f64::EPSILON * (first_norm + terms) / r_norm;
            let tolerance = self.rank_tolerance();
            let settled = || factor.offset(tolerance) / r_norm <= SETTLED + rounding;
            loop {
                let trial = self.trial(&factor, &free, radius);
                if !(trial.length > 0.0) {
                    return if settled() { Termination::StepSmall } else { Termination::NoProgress };
                }
                if iteration == 1 {
                    radius = radius.min(trial.length);
                }
                // Gain ratio: what the cost did over what the linear model promised.
                let actual = if trial.cost < 10.0 * self.cost { 1.0 - trial.cost / self.cost } else { -1.0 };
                let predicted = trial.predicted / self.cost;
                let ratio = if predicted > 0.0 { actual / predicted } else { -1.0 };
                if !(ratio > 0.25) {
                    // The parabola through the cost, its slope and the trial cost has its minimum here.
                    let slope = (trial.slope / self.cost).min(0.0);
                    let shrink = if actual >= 0.0 { 0.5 } else { 0.5 * slope / (slope + 0.5 * actual) };
                    radius = trial.length.min(radius) * if trial.cost.is_finite() && shrink > 0.1 { shrink.min(0.5) } else { 0.1 };
                } else if trial.full || ratio >= 0.75 {
                    radius = radius.max(2.0 * trial.length);
                }
                let cost_small = actual.abs() <= options.cost_tolerance && predicted <= options.cost_tolerance && 0.5 * ratio <= 1.0;
                let step_small = trial.length <= options.step_tolerance * x_length;
                let mut accepted = false;
                if ratio > 1e-4 {
                    let mut j = vec![0.0; self.n * self.m];
                    if self.differentiate(&trial.x, &mut j) {
                        accepted = true;
                        self.x.clone_from(&trial.x);
                        self.r.clone_from(&trial.r);
                        self.cost = trial.cost;
                        self.j = j;
                        self.update_scale();
                        gradient = self.gradient();
                        x_length = self.scaled_length(&self.x);
                        self.record(iteration, &gradient, trial.length);
                    } else {
                        radius = 0.1 * trial.length;
                    }
                }
                if self.cost == 0.0 {
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
        let slope = dot(&linear, &self.r);
        let predicted = -slope - 0.5 * dot(&linear, &linear);
        let mut r = vec![0.0; self.m];
        self.problem.evaluate(&x, &mut r);
        self.evaluations += 1;
        let cost = half_square(&r);
        Trial { x, r, cost, length, predicted, slope, full }
    }

    fn finish(mut self, termination: Termination) -> Fit {
        let moved = self.trace.len() > 1;
        let useless = match termination {
            Termination::Refused | Termination::Flat => true,
            t => !t.converged() && !moved,
        };
        let at_bound: Vec<usize> = (0..self.n).filter(|&k| self.x[k] <= self.low(k) || self.x[k] >= self.high(k)).collect();
        let mut fit =
            Fit { trace: std::mem::take(&mut self.trace), evaluations: self.evaluations, ..Fit::failed(self.n, self.m, termination) };
        if useless {
            return fit;
        }
        fit.cost = self.cost;
        let tolerance = self.rank_tolerance();
        if termination.converged() {
            let refined = if self.options.refine && at_bound.is_empty() {
                refine::refine(self.problem, &self.x, self.options.noise, tolerance)
            } else {
                None
            };
            if let Some(better) = refined {
                fit.evaluations += better.evaluations;
                fit.params = better.params;
                fit.cost = better.cost;
                fit.residuals = better.residuals;
                fit.uncertainty = better.uncertainty;
                fit.refined = Some(better.last_step);
                return fit;
            }
            let (mut j, mut r) = (self.j.clone(), self.r.clone());
            qr::reduce(&mut j, self.m, self.n, &mut r);
            fit.uncertainty = Uncertainty::from_triangle(&j, self.m, self.m, self.n, 2.0 * self.cost, self.options.noise, tolerance);
        }
        fit.params = self.x;
        fit.residuals = self.r;
        fit.at_bound = at_bound;
        fit
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// A trial point and how it compares with the linear model.
struct Trial {
    x: Vec<f64>,
    r: Vec<f64>,
    cost: f64,
    /// |D p| of the projected step.
    length: f64,
    /// Decrease of the cost that the linear model promises.
    predicted: f64,
    /// Slope of the cost along the step.
    slope: f64,
    /// An undamped Gauss–Newton step.
    full: bool,
}

/// QR of the free columns of the Jacobian, for steps with any damping.
struct Factor {
    /// n × n upper triangle, column-major.
    r: Vec<f64>,
    /// Top of −Qᵀ residuals.
    b: Vec<f64>,
    weight: Vec<f64>,
    n: usize,
    /// No diagonal entry is zero to rounding.
    regular: bool,
}

impl Factor {
    fn new(run: &Run, free: &[usize]) -> Self {
        let (n, m) = (free.len(), run.m);
        let mut j: Vec<f64> = free.iter().flat_map(|&k| run.column(k).iter().copied()).collect();
        let mut b: Vec<f64> = run.r.iter().map(|r| -r).collect();
        qr::reduce(&mut j, m, n, &mut b);
        // Fewer residuals than parameters: the missing rows are zero.
        let r: Vec<f64> = (0..n * n).map(|k| if k % n <= k / n && k % n < m { j[k / n * m + k % n] } else { 0.0 }).collect();
        b.resize(n, 0.0);
        let weight: Vec<f64> = free.iter().map(|&k| run.weight(k)).collect();
        let diagonal = |k: usize| (r[k * n + k] / weight[k]).abs();
        let largest = (0..n).map(diagonal).fold(0.0, f64::max);
        let regular = (0..n).all(|k| diagonal(k) > n as f64 * f64::EPSILON * largest);
        Factor { r, b, weight, n, regular }
    }

    /// (whether λ = 0, p) with |D p| within a tenth of `radius`, or shorter and undamped (Moré, section 5).
    fn step(&self, radius: f64) -> (bool, Vec<f64>) {
        let n = self.n;
        let mut lower = 0.0;
        if self.regular {
            let p = qr::solve_upper(&self.r, n, n, &self.b);
            let length = self.length(&p);
            if length <= 1.1 * radius {
                return (true, p);
            }
            lower = (length - radius) / (radius * self.newton_slope(&self.r, &p, length));
        }
        // |D⁻¹ Rᵀ b| / Δ bounds λ from above.
        let pull: Vec<f64> = (0..n).map(|k| dot(&self.r[k * n..=k * n + k], &self.b[..=k]) / self.weight[k]).collect();
        let pull = qr::length(&pull);
        let mut upper = pull / radius;
        let mut lambda = if lower > 0.0 { lower } else { 1e-3 * upper };
        let mut p = vec![0.0; n];
        for _ in 0..20 {
            if !(lambda > lower && lambda < upper) && lambda != lower {
                lambda = (lower * upper).sqrt().max(1e-3 * upper);
            }
            if !(lambda > 0.0 && lambda.is_finite()) {
                break;
            }
            let (triangle, step) = self.damp(lambda);
            p = step;
            let length = self.length(&p);
            let excess = length - radius;
            if excess.abs() <= 0.1 * radius || !excess.is_finite() {
                break;
            }
            if excess > 0.0 {
                lower = lower.max(lambda);
            } else {
                upper = upper.min(lambda);
            }
            lambda = (lambda + excess / (radius * self.newton_slope(&triangle, &p, length))).max(lower);
        }
        (false, p)
    }

    /// Length of the residuals' projection on the model's tangent: over |r|, the cosine of Bates and Watts; its square is the share of the
    /// cost that a linear model could still take away. Directions without rank do not count: there the tangent is rounding.
    fn offset(&self, tolerance: f64) -> f64 {
        let n = self.n;
        let scale: Vec<f64> = (0..n).map(|k| qr::length(&self.r[k * n..(k + 1) * n])).collect();
        let scaled = DMatrix::from_fn(n, n, |i, j| if scale[j] > 0.0 { self.r[j * n + i] / scale[j] } else { 0.0 });
        let svd = scaled.svd(true, false);
        let Some(u) = svd.u else { return f64::NAN };
        let cut = tolerance * svd.singular_values.max();
        let kept = (0..n).filter(|k| svd.singular_values[*k] > cut);
        qr::length(&kept.map(|k| dot(u.column(k).as_slice(), &self.b)).collect::<Vec<_>>())
    }

    fn length(&self, p: &[f64]) -> f64 {
        qr::length(&p.iter().zip(&self.weight).map(|(p, w)| p * w).collect::<Vec<_>>())
    }

    /// |R⁻ᵀ D² p|² / |D p|²: minus the derivative of |D p| to λ, over |D p|.
    fn newton_slope(&self, triangle: &[f64], p: &[f64], length: f64) -> f64 {
        let n = self.n;
        let rows = triangle.len() / n;
        let v: Vec<f64> = p.iter().zip(&self.weight).map(|(p, w)| w * (w * p / length)).collect();
        let s = qr::length(&qr::solve_upper_transposed(triangle, rows, n, &v));
        s * s
    }

    /// Solves [R; √λ D] p = [b; 0]; returns the triangle (2n rows) and p.
    fn damp(&self, lambda: f64) -> (Vec<f64>, Vec<f64>) {
        let n = self.n;
        let root = lambda.sqrt();
        let mut a = vec![0.0; 2 * n * n];
        for k in 0..n {
            a[2 * n * k..2 * n * k + n].copy_from_slice(&self.r[n * k..n * (k + 1)]);
            a[2 * n * k + n + k] = root * self.weight[k];
        }
        let mut b = self.b.clone();
        b.resize(2 * n, 0.0);
        qr::reduce(&mut a, 2 * n, n, &mut b);
        let p = qr::solve_upper(&a, 2 * n, n, &b);
        (a, p)
    }
}

#[cfg(test)]
mod tests {
    use super::super::problem::Closure;
    use super::*;

    fn rosenbrock(p: &[f64], r: &mut [f64]) {
        r[0] = 10.0 * (p[1] - p[0] * p[0]);
        r[1] = 1.0 - p[0];
    }

    /// A decay with deterministic disturbances, for the error tests.
    fn decay(p: &[f64], r: &mut [f64]) {
        for (i, r) in r.iter_mut().enumerate() {
            let t = i as f64 * 0.25;
            let data = 2.0 * (-0.6 * t).exp() + 0.01 * (1.7 * i as f64).sin();
            *r = p[0] * (-p[1] * t).exp() - data;
        }
    }

    #[test]
    fn rosenbrock_is_solved_from_afar() {
        let problem = Closure::new(2, 2, rosenbrock);
        for start in [[-1.2, 1.0], [30.0, -700.0], [-50.0, 1e-4]] {
            let fit = minimize(&problem, &start, &Options { truth: Some(vec![1.0, 1.0]), ..Options::default() });
            assert!(fit.converged(), "{start:?}: {:?}", fit.termination);
            assert!((fit.params[0] - 1.0).abs() < 1e-9 && (fit.params[1] - 1.0).abs() < 1e-9, "{start:?}: {:?}", fit.params);
            let last = fit.trace.last().unwrap();
            assert!(last.truth_error.unwrap() < 1e-9);
            assert!(fit.trace.windows(2).all(|w| w[1].cost <= w[0].cost && w[1].evaluations > w[0].evaluations));
        }
    }

    /// Standard errors against the scatter of fits to data with seeded noise: an independent route to the same numbers.
    #[test]
    fn standard_errors_agree_with_the_scatter_of_repeated_fits() {
        use rand::RngExt;
        let mut rng = rand_pcg::Pcg64Mcg::new(7);
        let sigma = 0.02;
        let mut normal = move || {
            let (u, v): (f64, f64) = (rng.random(), rng.random());
            (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
        };
        let runs = 1500;
        let (mut sum, mut squares, mut predicted) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        for _ in 0..runs {
            let noise: Vec<f64> = (0..12).map(|_| sigma * normal()).collect();
            let problem = Closure::new(2, 12, |p: &[f64], r: &mut [f64]| {
                for (i, r) in r.iter_mut().enumerate() {
                    let t = i as f64 * 0.25;
                    *r = (p[0] * (-p[1] * t).exp() - 2.0 * (-0.6 * t).exp() - noise[i]) / sigma;
                }
            });
            let fit = minimize(&problem, &[1.0, 1.0], &Options { noise: Noise::Known, ..Options::default() });
            assert!(fit.converged());
            for k in 0..2 {
                let error = fit.params[k] - [2.0, 0.6][k];
                sum[k] += error;
                squares[k] += error * error;
                predicted[k] += fit.uncertainty.stderr[k] / f64::from(runs);
            }
        }
        for k in 0..2 {
            let scatter = (squares[k] / f64::from(runs)).sqrt();
            // The scatter of 1500 runs is itself known to 1/√3000 = 1.8 %: four of those.
            assert!((scatter / predicted[k] - 1.0).abs() < 0.073, "parameter {k}: scatter {scatter}, predicted {}", predicted[k]);
            assert!(sum[k].abs() / f64::from(runs) < 0.15 * scatter);
        }
    }

    #[test]
    fn a_redundant_parameter_is_named_and_has_no_error() {
        // Only the product of the first two parameters matters.
        let problem = Closure::new(3, 12, |p: &[f64], r: &mut [f64]| decay(&[p[0] * p[1], p[2]], r));
        let fit = minimize(&problem, &[1.0, 1.0, 1.0], &Options::default());
        assert!(fit.converged());
        assert_eq!((fit.uncertainty.rank, &fit.uncertainty.undetermined[..]), (2, &[0, 1][..]));
        assert!(fit.uncertainty.stderr[0].is_infinite() && fit.uncertainty.stderr[1].is_infinite());
        assert!(fit.uncertainty.condition.is_infinite());
        let plain = minimize(&Closure::new(2, 12, decay), &[1.0, 1.0], &Options::default());
        assert!((fit.params[2] - plain.params[1]).abs() < 1e-8);
        assert!((fit.uncertainty.stderr[2] / plain.uncertainty.stderr[1] - 1.0).abs() < 1e-5);
    }

    #[test]
    fn models_without_values_or_slopes_fail_by_name_and_return_nothing() {
        let nan = Closure::new(1, 3, |_: &[f64], r: &mut [f64]| r.fill(f64::NAN));
        let flat = Closure::new(2, 3, |_: &[f64], r: &mut [f64]| r.fill(1.0));
        let empty = Closure::new(1, 0, |_: &[f64], _: &mut [f64]| {});
        let kink = Closure::new(1, 1, |p: &[f64], r: &mut [f64]| r[0] = 1.0 + p[0].abs().sqrt());
        let wrong_sign =
            Closure::new(1, 2, |p: &[f64], r: &mut [f64]| r.fill(p[0].exp())).with_jacobian(|p: &[f64], j: &mut [f64]| j.fill(-p[0].exp()));
        for (name, fit, expected) in [
            ("nan", minimize(&nan, &[1.0], &Options::default()), Termination::NotFinite),
            ("flat", minimize(&flat, &[1.0, 2.0], &Options::default()), Termination::Flat),
            ("empty", minimize(&empty, &[1.0], &Options::default()), Termination::Refused),
            ("nan start", minimize(&kink, &[f64::NAN], &Options::default()), Termination::Refused),
            ("wrong sign", minimize(&wrong_sign, &[1.0], &Options::default()), Termination::NoProgress),
        ] {
            assert_eq!(fit.termination, expected, "{name}");
            assert!(fit.params.iter().all(|p| p.is_nan()), "{name} returned {:?}", fit.params);
            assert!(fit.uncertainty.stderr.iter().all(|s| s.is_infinite()), "{name}");
        }
    }

    #[test]
    fn a_region_without_values_is_stepped_around() {
        // ln p has no value for p ≤ 0, and the first full step goes there.
        let problem = Closure::new(1, 1, |p: &[f64], r: &mut [f64]| r[0] = p[0].ln() + 3.0);
        let fit = minimize(&problem, &[4.0], &Options::default());
        assert!(fit.converged() && (fit.params[0] - (-3f64).exp()).abs() < 1e-10, "{fit:?}");
    }

    #[test]
    fn bounds_hold_and_the_rest_is_still_optimal() {
        // Best with p0 ≥ 2.5: p1 minimises the remaining one-parameter problem.
        let problem = Closure::new(2, 12, decay);
        let options = Options { lower: vec![2.5, 0.0], upper: vec![10.0, 10.0], ..Options::default() };
        for start in [[3.0, 1.0], [9.0, 0.01], [2.5, 5.0]] {
            let fit = minimize(&problem, &start, &options);
            assert!(fit.converged(), "{start:?}: {:?}", fit.termination);
            assert_eq!(fit.at_bound, [0]);
            let alone = Closure::new(1, 12, |p: &[f64], r: &mut [f64]| decay(&[2.5, p[0]], r));
            let reference = minimize(&alone, &[1.0], &Options::default());
            assert!((fit.params[1] - reference.params[0]).abs() < 1e-8, "{start:?}: {:?} against {:?}", fit.params, reference.params);
        }
        let crossed = Options { lower: vec![3.0, 0.0], upper: vec![2.0, 1.0], ..Options::default() };
        assert_eq!(minimize(&problem, &[1.0, 1.0], &crossed).termination, Termination::Refused);
    }

    #[test]
    fn units_do_not_matter() {
        let plain = minimize(&Closure::new(2, 12, decay), &[1.0, 1.0], &Options::default());
        let scaled = Closure::new(2, 12, |p: &[f64], r: &mut [f64]| decay(&[p[0] * 1e-9, p[1] * 1e7], r));
        let fit = minimize(&scaled, &[1e9, 1e-7], &Options::default());
        assert!((fit.params[0] * 1e-9 / plain.params[0] - 1.0).abs() < 1e-9);
        assert!((fit.uncertainty.stderr[1] * 1e7 / plain.uncertainty.stderr[1] - 1.0).abs() < 1e-6);
        assert!((fit.uncertainty.condition / plain.uncertainty.condition - 1.0).abs() < 1e-5);
    }

    #[test]
    fn the_iteration_limit_is_told_and_gives_no_errors() {
        let fit = minimize(&Closure::new(2, 2, rosenbrock), &[-1.2, 1.0], &Options { max_iterations: 3, ..Options::default() });
        assert_eq!(fit.termination, Termination::IterationLimit);
        assert!(fit.uncertainty.stderr.iter().all(|s| s.is_infinite()));
    }
}
