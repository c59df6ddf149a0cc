//! Dense Levenberg–Marquardt with a trust region in scaled parameters, for problems of up to a few dozen parameters.
//!
//! The step solves min |J p + r|² with |D p| ≤ Δ; D holds the largest column norms met so far, so the units of the
//! parameters do not matter. Every linear system goes through QR of the Jacobian and of [R; √λ D], never through the
//! normal equations, which would square the condition number. Bounds are kept by an active set and by projecting the
//! trial point.
//!
//! J. J. Moré, "The Levenberg–Marquardt algorithm: implementation and theory", Lecture Notes in Mathematics 630 (1978),
//! 105–116: the trust region, its scaling, Hebden's iteration for λ and the convergence tests. D. M. Bates and D. G.
//! Watts, "A relative offset orthogonality convergence criterion for nonlinear least squares", Technometrics 23 (1981),
//! 179–183: the test that keeps a short step on a plateau from passing for convergence. Geodesic acceleration
//! (Transtrum and Sethna, arXiv:1201.5885) was tried and left out: with this trust region it took more than twice the
//! evaluations on the 54 NIST runs and lost three of them.

mod factor;
mod iteration;
#[cfg(test)]
mod tests;

use super::problem::Problem;
use super::trace::{Termination, Trace};
use super::uncertainty::{ResidualNoise, Uncertainty};
use iteration::Run;

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
    /// What is known of the noise, from which standard errors follow.
    pub noise: ResidualNoise,
    /// Singular values below this share of the largest count as zero. `None` means n·ε with analytic derivatives and
    /// 1e-10 with numeric differences.
    pub rank_tolerance: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            max_iterations: 2000,
            gradient_tolerance: 1e-14,
            cost_tolerance: 1e-14,
            step_tolerance: 1e-12,
            initial_radius: 1.0,
            lower: Vec::new(),
            upper: Vec::new(),
            noise: ResidualNoise::Estimated,
            rank_tolerance: None,
        }
    }
}

/// The result of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Fitted parameters. NaN where nothing was fitted ([`Termination::Refused`], [`Termination::Flat`], or not one
    /// step accepted before the solver had to stop): a start is never handed back as a result.
    pub params: Vec<f64>,
    /// Standard errors, covariance, rank, condition; all undetermined unless the fit converged.
    pub uncertainty: Uncertainty,
    /// Residuals at the solution.
    pub residuals: Vec<f64>,
    /// ½ Σ r².
    pub cost: f64,
    /// Parameters resting on a bound, by index. Their standard errors are those of the problem without bounds.
    pub at_bound: Vec<usize>,
    /// Why it ended.
    pub termination: Termination,
    /// One row for each accepted step, and one for the start.
    pub trace: Trace,
    /// Evaluations of the residuals or the Jacobian (numeric Jacobians count every difference).
    pub evaluations: usize,
}

impl Fit {
    /// Whether it ended at a minimum.
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
        }
    }
}

/// Minimises ½ Σ r² from `start`.
///
/// Convergence is defined by the tolerances in [`Options`]. A stalled cost or a collapsed radius counts only where, by
/// the linear model, at most 1e-8 of the cost can still be gained, or where the residuals are down to their rounding.
/// Otherwise the run goes on, or ends as [`Termination::NoProgress`].
///
/// `start` has one value a parameter; values outside the bounds are moved onto them. The function never panics on what
/// a model returns. NaN or infinite residuals shorten the step at a trial point; at the start they end the run as
/// [`Termination::NotFinite`]. Lengths that do not fit the problem, empty problems, crossed bounds and a start that is
/// not finite end as [`Termination::Refused`].
pub fn minimize(problem: &dyn Problem, start: &[f64], options: &Options) -> Fit {
    let (n, m) = (problem.parameters(), problem.residuals());
    let bound_lengths_fit = [&options.lower, &options.upper].iter().all(|b| b.is_empty() || b.len() == n);
    let bounds_make_sense = options.lower.iter().zip(&options.upper).all(|(l, u)| l <= u);
    if n == 0
        || m == 0
        || start.len() != n
        || !bound_lengths_fit
        || !bounds_make_sense
        || start.iter().any(|x| !x.is_finite())
    {
        return Fit::failed(n, m, Termination::Refused);
    }
    let mut run = Run::new(problem, options, start);
    let termination = run.iterate();
    run.finish(termination)
}
