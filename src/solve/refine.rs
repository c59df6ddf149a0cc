//! The last digits: Gauss–Newton in double-double from a converged point. In double precision the gradient Jᵀr of a
//! good fit drowns in the rounding of its terms at about half the digits of the condition number; with 31 digits it
//! does not.

// A comparison with NaN is false: written as `!(a < b)` where NaN must fail.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::dd::Dd;
use super::problem::Problem;
use super::qr;
use super::real::Real;
use super::uncertainty::{Noise, Uncertainty};

/// Relative steps below this are converged: beyond what any `f64` result shows, above the rounding of ill-conditioned
/// systems.
const ENOUGH: f64 = 1e-22;
const MAX_STEPS: usize = 200;

pub(super) struct Refined {
    pub params: Vec<f64>,
    pub residuals: Vec<f64>,
    pub cost: f64,
    pub uncertainty: Uncertainty,
    /// Largest relative step of the last iteration.
    pub last_step: f64,
    pub evaluations: usize,
}

/// `None` where the problem has no refined form, where it is rank-deficient or not finite, and where the steps do not
/// contract.
pub(super) fn refine(problem: &dyn Problem, start: &[f64], noise: Noise, tolerance: f64) -> Option<Refined> {
    let (n, m) = (problem.parameters(), problem.residuals());
    if m < n {
        return None;
    }
    let mut x: Vec<Dd> = start.iter().map(|v| Dd::constant(*v)).collect();
    let (mut r, mut j) = (vec![Dd::zero(); m], vec![Dd::zero(); n * m]);
    let mut step = f64::INFINITY;
    for evaluations in 1..=MAX_STEPS {
        if !problem.refined(&x, &mut r, &mut j) {
            return None;
        }
        let residuals: Vec<f64> = r.iter().map(|v| v.value()).collect();
        let chi2 = r.iter().fold(Dd::zero(), |s, v| s + *v * *v);
        // A parameter at zero has no relative step: it is measured by what it does to the residuals, beside the others.
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
        // The first steps tell whether the iteration contracts; one that grows is refused whole.
        if !(step < 1e-2) || (evaluations > 3 && step > 2.0 * previous) && step > ENOUGH.sqrt() {
            return None;
        }
        let settled =
            step <= ENOUGH || (evaluations > 3 && step < 1e-18 && step >= previous) || evaluations == MAX_STEPS;
        if settled {
            if step > 1e-10 {
                return None;
            }
            let uncertainty = Uncertainty::from_triangle(&j, m, m, n, chi2, noise, tolerance);
            if uncertainty.rank < n {
                return None;
            }
            let params = x.iter().map(|v| v.value()).collect();
            return Some(Refined {
                params,
                residuals,
                cost: 0.5 * chi2.value(),
                uncertainty,
                last_step: step,
                evaluations,
            });
        }
        for (x, d) in x.iter_mut().zip(&delta) {
            *x = *x - *d;
        }
    }
    None
}
