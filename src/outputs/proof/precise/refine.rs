//! The last digits: Gauss–Newton in double-double arithmetic from a converged point. In double precision, the gradient
//! Jᵀr of a good fit is lost in the rounding of its terms, at about half the digits of the condition number. With 31
//! digits it is not.

use super::{DoubleDouble, PreciseProblem};
use mesophyll_base::solvers::qr::{self, MatrixScalar};
use mesophyll_base::solvers::{Fit, ResidualNoise, Uncertainty};

/// Relative steps below this are converged. It is smaller than any `f64` result shows, and larger than the rounding of
/// ill-conditioned systems.
const ENOUGH: f64 = 1e-22;
const MAX_STEPS: usize = 200;

/// The fit with its last digits. The fit is returned unchanged where it did not converge or rests on a bound, where the
/// problem is rank-deficient or not finite, and where the steps do not contract.
pub fn refined(problem: &dyn PreciseProblem, fit: Fit, noise: ResidualNoise) -> Fit {
    let sound = fit.converged() && fit.at_bound.is_empty();
    sound.then(|| refine(problem, &fit, noise)).flatten().unwrap_or(fit)
}

fn refine(problem: &dyn PreciseProblem, fit: &Fit, noise: ResidualNoise) -> Option<Fit> {
    let (n, m) = (problem.parameters(), problem.residuals());
    if m < n {
        return None;
    }
    let mut x: Vec<DoubleDouble> = fit.params.iter().map(|v| DoubleDouble::constant(*v)).collect();
    let (mut r, mut j) = (vec![DoubleDouble::zero(); m], vec![DoubleDouble::zero(); n * m]);
    let mut step = f64::INFINITY;
    for evaluations in 1..=MAX_STEPS {
        problem.precise(&x, &mut r, &mut j);
        let residuals: Vec<f64> = r.iter().map(|v| v.value()).collect();
        let chi2 = r.iter().fold(DoubleDouble::zero(), |s, v| s + *v * *v);
        // A parameter at zero has no relative step. It is measured by its effect on the residuals, compared with that
        // of the others.
        let columns: Vec<f64> = (0..n).map(|k| qr::length(&j[k * m..(k + 1) * m]).value()).collect();
        let whole = qr::length(&x.iter().zip(&columns).map(|(x, c)| x.value() * c).collect::<Vec<_>>());
        qr::reduce(&mut j, m, n, &mut r);
        let delta = qr::solve_upper(&j, m, n, &r);
        let previous = step;
        step = (0..n)
            .map(|k| {
                (delta[k].value() / x[k].value().abs().max(1e-8 * whole / columns[k]).max(f64::MIN_POSITIVE)).abs()
            })
            .fold(0.0, qr::nan_max);
        // The first steps show whether the iteration contracts. If a step grows, the refinement is given up.
        if !(step < 1e-2) || (evaluations > 3 && step > 2.0 * previous) && step > ENOUGH.sqrt() {
            return None;
        }
        let settled =
            step <= ENOUGH || (evaluations > 3 && step < 1e-18 && step >= previous) || evaluations == MAX_STEPS;
        if settled {
            if step > 1e-10 {
                return None;
            }
            let tolerance = n as f64 * f64::EPSILON;
            let uncertainty = Uncertainty::from_triangle(&j, m, m, n, chi2, noise, tolerance);
            if uncertainty.rank < n {
                return None;
            }
            let params = x.iter().map(|v| v.value()).collect();
            let evaluations = fit.evaluations + evaluations;
            return Some(Fit { params, residuals, cost: 0.5 * chi2.value(), uncertainty, evaluations, ..fit.clone() });
        }
        for (x, d) in x.iter_mut().zip(&delta) {
            *x = *x - *d;
        }
    }
    None
}
