//! Search without derivatives: argmin's Nelder–Mead behind our trace and termination names. For residuals with kinks or
//! steps (clipped samples, counts), where a Jacobian means nothing; on smooth ones [`super::lm`] is both faster and
//! exact.
//!
//! J. A. Nelder and R. Mead, "A simplex method for function minimization", Computer Journal 7 (1965), 308–313.

use super::problem::Problem;
use super::qr;
use super::trace::{Termination, Trace, TraceRow};
use argmin::core::observers::{Observe, ObserverMode};
use argmin::core::{CostFunction, Executor, IterState, KV, State, TerminationReason, TerminationStatus};
use argmin::solver::neldermead::NelderMead;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Instant;

/// Where a search ended. It knows no errors of the parameters: those need a Jacobian.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// Best point; NaN where nothing was found.
    pub params: Vec<f64>,
    /// ½ Σ r² there.
    pub cost: f64,
    pub termination: Termination,
    pub trace: Trace,
    pub evaluations: usize,
}

struct Cost<'a> {
    problem: &'a dyn Problem,
    evaluations: Rc<Cell<usize>>,
}

impl CostFunction for Cost<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, params: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        self.evaluations.set(self.evaluations.get() + 1);
        let mut r = vec![0.0; self.problem.residuals()];
        self.problem.evaluate(params, &mut r);
        let norm = qr::length(&r);
        // Where the model has no value the simplex must turn back: worse than anything, but ordered.
        Ok(if norm.is_finite() { 0.5 * norm * norm } else { f64::MAX })
    }
}

type Simplex = IterState<Vec<f64>, (), (), (), (), f64>;

struct Recorder {
    rows: Rc<RefCell<Trace>>,
    evaluations: Rc<Cell<usize>>,
    clock: Instant,
}

impl Observe<Simplex> for Recorder {
    fn observe_iter(&mut self, state: &Simplex, _: &KV) -> Result<(), argmin::core::Error> {
        self.rows.borrow_mut().push(TraceRow {
            iteration: state.get_iter() as usize + 1,
            evaluations: self.evaluations.get(),
            elapsed_s: self.clock.elapsed().as_secs_f64(),
            cost: state.get_best_cost(),
            // Neither has a meaning without derivatives.
            gradient: f64::NAN,
            step: f64::NAN,
            truth_error: None,
        });
        Ok(())
    }
}

/// Nelder–Mead from the simplex of `start` and `start` with `steps[k]` (≠ 0) added to parameter k.
///
/// Converges where the costs of the simplex scatter by less than `tolerance` (absolute, in units of the cost). Ends as
/// [`Termination::Refused`] for wrong lengths or zero steps, as [`Termination::NotFinite`] where no point of the search
/// had a value.
pub fn nelder_mead(
    problem: &dyn Problem,
    start: &[f64],
    steps: &[f64],
    tolerance: f64,
    max_iterations: usize,
) -> Search {
    let n = problem.parameters();
    let nothing = |termination| Search {
        params: vec![f64::NAN; n],
        cost: f64::NAN,
        termination,
        trace: Vec::new(),
        evaluations: 0,
    };
    let usable = |v: &f64| v.is_finite();
    if n == 0
        || problem.residuals() == 0
        || start.len() != n
        || steps.len() != n
        || !start.iter().chain(steps).all(usable)
        || steps.contains(&0.0)
    {
        return nothing(Termination::Refused);
    }
    let mut simplex = vec![start.to_vec()];
    for k in 0..n {
        let mut corner = start.to_vec();
        corner[k] += steps[k];
        simplex.push(corner);
    }
    let Ok(solver) = NelderMead::new(simplex).with_sd_tolerance(tolerance) else {
        return nothing(Termination::Refused);
    };
    let evaluations = Rc::new(Cell::new(0));
    let rows = Rc::new(RefCell::new(Trace::new()));
    let recorder = Recorder { rows: rows.clone(), evaluations: evaluations.clone(), clock: Instant::now() };
    let run = Executor::new(Cost { problem, evaluations: evaluations.clone() }, solver)
        .configure(|state| state.max_iters(max_iterations as u64))
        .add_observer(recorder, ObserverMode::Always)
        .timer(false)
        .run();
    let Ok(result) = run else { return nothing(Termination::NotFinite) };
    let state = result.state;
    let termination = match state.get_termination_status() {
        TerminationStatus::Terminated(TerminationReason::SolverConverged) => Termination::CostConverged,
        _ => Termination::IterationLimit,
    };
    let trace = rows.take();
    match state.get_best_param() {
        Some(params) if state.get_best_cost() < f64::MAX => Search {
            params: params.clone(),
            cost: state.get_best_cost(),
            termination,
            trace,
            evaluations: evaluations.get(),
        },
        _ => Search { trace, evaluations: evaluations.get(), ..nothing(Termination::NotFinite) },
    }
}

#[cfg(test)]
mod tests {
    use super::super::problem::Closure;
    use super::*;

    #[test]
    fn a_kinked_cost_is_minimised_without_derivatives() {
        // √|x| residuals have no slope at the minimum (2, −1).
        let kinked = Closure::new(2, 2, |p: &[f64], r: &mut [f64]| {
            r[0] = (p[0] - 2.0).abs().sqrt();
            r[1] = (p[0] + p[1] - 1.0).abs().sqrt();
        });
        let found = nelder_mead(&kinked, &[0.0, 0.0], &[0.5, 0.5], 1e-12, 2000);
        assert_eq!(found.termination, Termination::CostConverged);
        assert!((found.params[0] - 2.0).abs() < 1e-9 && (found.params[1] + 1.0).abs() < 1e-9, "{found:?}");
        assert!(found.trace.windows(2).all(|w| w[1].cost <= w[0].cost && w[1].evaluations > w[0].evaluations));
    }

    #[test]
    fn limits_and_nonsense_are_named() {
        let bowl = Closure::new(2, 2, |p: &[f64], r: &mut [f64]| r.copy_from_slice(p));
        assert_eq!(nelder_mead(&bowl, &[9.0, 9.0], &[1.0, 1.0], 1e-12, 3).termination, Termination::IterationLimit);
        assert_eq!(nelder_mead(&bowl, &[9.0, 9.0], &[1.0, 0.0], 1e-12, 3).termination, Termination::Refused);
        let nan = Closure::new(1, 1, |_: &[f64], r: &mut [f64]| r[0] = f64::NAN);
        let lost = nelder_mead(&nan, &[1.0], &[1.0], 1e-12, 50);
        assert!(lost.termination == Termination::NotFinite && lost.params[0].is_nan(), "{lost:?}");
    }
}
