//! Minimises a smooth cost by its gradient alone: argmin's L-BFGS with our trace and termination names. It is for costs
//! whose gradient is cheap and whose Jacobian is not (adjoint models). Where the Jacobian is available, [`super::lm`]
//! takes fewer steps.
//!
//! D. C. Liu and J. Nocedal, "On the limited memory BFGS method for large scale optimization", Mathematical Programming
//! 45 (1989), 503–528. J. J. Moré and D. J. Thuente, "Line search algorithms with guaranteed sufficient decrease", ACM
//! TOMS 20 (1994), 286–307.

use super::trace::{Termination, Trace, TraceRow};
use argmin::core::observers::{Observe, ObserverMode};
use argmin::core::{CostFunction, Executor, Gradient, IterState, KV, State, TerminationReason, TerminationStatus};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Instant;

/// A cost with its gradient.
pub trait DifferentiableCost {
    /// How many parameters there are.
    fn parameters(&self) -> usize;
    /// Returns the cost at `params` and writes its gradient into `gradient`. Returns NaN where the model has no value;
    /// then the line search gives up.
    fn evaluate(&self, params: &[f64], gradient: &mut [f64]) -> f64;
}

/// Where a descent ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Descent {
    /// Best point; the start where nothing better was found (see `termination`).
    pub params: Vec<f64>,
    /// Cost at `params`.
    pub cost: f64,
    /// Gradient in the problem's own coordinates.
    pub gradient: Vec<f64>,
    /// Why it ended.
    pub termination: Termination,
    /// A row an iteration.
    pub trace: Trace,
    /// The point of each row of the trace.
    pub points: Vec<Vec<f64>>,
    /// How often the cost was evaluated with its gradient.
    pub evaluations: usize,
}

/// When to stop.
#[derive(Debug, Clone, Copy)]
pub struct DescentLimits {
    /// Stops where the gradient, in the coordinates of the metric, is shorter than this.
    pub gradient: f64,
    /// Largest number of iterations.
    pub iterations: usize,
}

/// The cost and its derivatives where a round of descents begins.
pub struct NormalEquations {
    /// ½ Σ r².
    pub cost: f64,
    /// Gradient of the cost: Jᵀr.
    pub gradient: DVector<f64>,
    /// JᵀJ.
    pub matrix: DMatrix<f64>,
}

/// Directions whose curvature is less than this share of the largest are not determined, because of rounding.
const FLAT: f64 = 1e-13;

/// Length of the Newton step in standard errors, over the determined directions.
pub fn distance(eigen: &SymmetricEigen<f64, Dyn>, gradient: &DVector<f64>) -> f64 {
    let along = eigen.eigenvectors.tr_mul(gradient);
    let cut = FLAT * eigen.eigenvalues.max();
    along.iter().zip(eigen.eigenvalues.iter()).filter(|(_, l)| **l > cut).map(|(g, l)| g * g / l).sum::<f64>().sqrt()
}

/// One round of a descent that renews its coordinates. It runs [`minimize`] from `p`, in coordinates in which JᵀJ at
/// `p` (decomposed in `eigen`) is close to the identity, damped so that no parameter's first step is longer than
/// `longest`. The best point is left in `p`, and `damping` falls to a tenth. Where there is no better point, `damping`
/// rises tenfold.
pub fn round(
    problem: &dyn DifferentiableCost,
    p: &mut Vec<f64>,
    normal: &NormalEquations,
    eigen: &SymmetricEigen<f64, Dyn>,
    damping: &mut f64,
    longest: f64,
    limits: DescentLimits,
) -> Descent {
    let found = minimize(problem, p, &metric(eigen, &normal.gradient, *damping, longest), limits);
    if found.cost.is_finite() && found.cost < normal.cost {
        *damping *= 0.1;
        p.clone_from(&found.params);
    } else {
        *damping = (10.0 * *damping).max(1e-4 * normal.matrix.diagonal().max());
    }
    found
}

/// The matrix W with W Wᵀ = (JᵀJ + λ)⁻¹, where λ is at least `damping` and large enough for a first step of at most
/// `limit`.
fn metric(eigen: &SymmetricEigen<f64, Dyn>, gradient: &DVector<f64>, damping: f64, limit: f64) -> DMatrix<f64> {
    let along = eigen.eigenvectors.tr_mul(gradient);
    let largest = eigen.eigenvalues.max();
    let longest = |damping: f64| {
        let step = DVector::from_fn(along.len(), |k, _| along[k] / (eigen.eigenvalues[k].max(0.0) + damping));
        (&eigen.eigenvectors * step).amax()
    };
    let mut damping = damping.max(1e-12 * largest);
    while longest(damping) > limit && damping < 1e6 * largest {
        damping *= 3.0;
    }
    let roots = DVector::from_fn(along.len(), |k, _| 1.0 / (eigen.eigenvalues[k].max(0.0) + damping).sqrt());
    &eigen.eigenvectors * DMatrix::from_diagonal(&roots)
}

type Vector = DVector<f64>;

/// The last evaluation is kept, because argmin asks for cost and gradient separately.
struct Known {
    u: Vector,
    params: Vec<f64>,
    cost: f64,
    gradient: Vec<f64>,
}

struct Cost<'a> {
    problem: &'a dyn DifferentiableCost,
    start: Vector,
    metric: &'a DMatrix<f64>,
    last: RefCell<Option<Known>>,
    best: Rc<RefCell<Option<Known>>>,
    evaluations: Rc<Cell<usize>>,
}

impl Cost<'_> {
    /// Returns an error where the search has left the range of numbers: argmin's line search would go on for ever.
    fn known<T>(&self, u: &Vector, read: impl Fn(&Known) -> T) -> Result<T, argmin::core::Error> {
        let mut last = self.last.borrow_mut();
        if let Some(known) = last.as_ref().filter(|k| &k.u == u) {
            return Ok(read(known));
        }
        if !u.iter().all(|u| u.is_finite()) {
            return Err(argmin::core::Error::msg("the line search left all numbers"));
        }
        let params: Vec<f64> = (&self.start + self.metric * u).iter().copied().collect();
        let mut gradient = vec![0.0; params.len()];
        let cost = self.problem.evaluate(&params, &mut gradient);
        self.evaluations.set(self.evaluations.get() + 1);
        let known = Known { u: u.clone(), params, cost, gradient };
        let mut best = self.best.borrow_mut();
        if cost.is_finite()
            && known.gradient.iter().all(|g| g.is_finite())
            && best.as_ref().is_none_or(|b| cost < b.cost)
        {
            *best = Some(Known { u: u.clone(), params: known.params.clone(), cost, gradient: known.gradient.clone() });
        }
        Ok(read(last.insert(known)))
    }
}

impl CostFunction for Cost<'_> {
    type Param = Vector;
    type Output = f64;
    fn cost(&self, u: &Vector) -> Result<f64, argmin::core::Error> {
        self.known(u, |k| k.cost)
    }
}

impl Gradient for Cost<'_> {
    type Param = Vector;
    type Gradient = Vector;
    fn gradient(&self, u: &Vector) -> Result<Vector, argmin::core::Error> {
        Ok(self.metric.tr_mul(&self.known(u, |k| DVector::from_column_slice(&k.gradient))?))
    }
}

type Quasi = IterState<Vector, Vector, (), (), (), f64>;

struct Recorder {
    rows: Rc<RefCell<(Trace, Vec<Vector>)>>,
    evaluations: Rc<Cell<usize>>,
    clock: Instant,
}

impl Observe<Quasi> for Recorder {
    fn observe_iter(&mut self, state: &Quasi, _: &KV) -> Result<(), argmin::core::Error> {
        let Some(u) = state.get_param() else { return Ok(()) };
        let mut rows = self.rows.borrow_mut();
        let step = rows.1.last().map_or_else(|| u.norm(), |before| (u - before).norm());
        rows.0.push(TraceRow {
            iteration: state.get_iter() as usize + 1,
            evaluations: self.evaluations.get(),
            elapsed_s: self.clock.elapsed().as_secs_f64(),
            cost: state.get_cost(),
            gradient: state.get_gradient().map_or(f64::NAN, |g| g.amax()),
            step,
            truth_error: None,
        });
        rows.1.push(u.clone());
        Ok(())
    }
}

/// L-BFGS from `start`, in coordinates u with params = start + `metric` · u. If the metric makes the cost about ½|u|²
/// (an inverse root of its second derivatives), the first step is Newton's and few are needed. `trace` and `limits` are
/// in these coordinates.
///
/// Ends as [`Termination::GradientSmall`], [`Termination::CostConverged`] (no change left to see),
/// [`Termination::IterationLimit`], [`Termination::NoProgress`] (the line search found nothing),
/// [`Termination::NotFinite`] (no value at the start) or [`Termination::Refused`].
pub fn minimize(
    problem: &dyn DifferentiableCost,
    start: &[f64],
    metric: &DMatrix<f64>,
    limits: DescentLimits,
) -> Descent {
    let n = problem.parameters();
    let nothing = |termination, evaluations| Descent {
        params: start.to_vec(),
        cost: f64::NAN,
        gradient: vec![f64::NAN; n],
        termination,
        trace: Vec::new(),
        points: Vec::new(),
        evaluations,
    };
    if n == 0
        || start.len() != n
        || metric.shape() != (n, n)
        || !start.iter().chain(metric.iter()).all(|v| v.is_finite())
    {
        return nothing(Termination::Refused, 0);
    }
    let search = MoreThuenteLineSearch::new().with_bounds(1e-10, 20.0);
    let solver =
        search.and_then(|search| LBFGS::new(search, 8).with_tolerance_grad(limits.gradient)?.with_tolerance_cost(0.0));
    let Ok(solver) = solver else { return nothing(Termination::Refused, 0) };
    let evaluations = Rc::new(Cell::new(0));
    let best = Rc::new(RefCell::new(None));
    let rows = Rc::new(RefCell::new((Trace::new(), Vec::new())));
    let cost = Cost {
        problem,
        start: DVector::from_column_slice(start),
        metric,
        last: RefCell::new(None),
        best: best.clone(),
        evaluations: evaluations.clone(),
    };
    // A line search that begins without a value may find one by chance; that is no descent.
    if !cost.known(&DVector::zeros(n), |k| k.cost).is_ok_and(f64::is_finite) {
        return nothing(Termination::NotFinite, evaluations.get());
    }
    let recorder = Recorder { rows: rows.clone(), evaluations: evaluations.clone(), clock: Instant::now() };
    let run = Executor::new(cost, solver)
        .configure(|state| state.param(DVector::zeros(n)).max_iters(limits.iterations as u64))
        .add_observer(recorder, ObserverMode::Always)
        .timer(false)
        .run();
    let ended = run.ok().map(|r| r.state.get_termination_status().clone());
    let Some(best) = best.take() else { return nothing(Termination::NotFinite, evaluations.get()) };
    let small = metric.tr_mul(&DVector::from_column_slice(&best.gradient)).norm() < limits.gradient;
    let termination = match ended {
        _ if small => Termination::GradientSmall,
        Some(TerminationStatus::Terminated(TerminationReason::SolverConverged)) => Termination::CostConverged,
        Some(TerminationStatus::Terminated(TerminationReason::MaxItersReached)) => Termination::IterationLimit,
        _ => Termination::NoProgress,
    };
    let (trace, points) = rows.take();
    let origin = DVector::from_column_slice(start);
    let points = points.iter().map(|u| (&origin + metric * u).iter().copied().collect()).collect();
    Descent {
        params: best.params,
        cost: best.cost,
        gradient: best.gradient,
        termination,
        trace,
        points,
        evaluations: evaluations.get(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley, minimum 0 at (1, 1); no value left of x = −3.
    struct Valley;

    impl DifferentiableCost for Valley {
        fn parameters(&self) -> usize {
            2
        }
        fn evaluate(&self, p: &[f64], g: &mut [f64]) -> f64 {
            let (a, b) = (1.0 - p[0], p[1] - p[0] * p[0]);
            g[0] = -2.0 * a - 400.0 * b * p[0];
            g[1] = 200.0 * b;
            if p[0] < -3.0 { f64::NAN } else { a * a + 100.0 * b * b }
        }
    }

    const LIMITS: DescentLimits = DescentLimits { gradient: 1e-9, iterations: 200 };

    #[test]
    fn the_valleys_floor_is_found_in_any_coordinates() {
        for metric in [DMatrix::identity(2, 2), DMatrix::from_row_slice(2, 2, &[0.7, 0.1, -0.3, 0.05])] {
            let found = minimize(&Valley, &[-1.2, 1.0], &metric, LIMITS);
            assert_eq!(found.termination, Termination::GradientSmall, "{found:?}");
            assert!((found.params[0] - 1.0).abs() < 1e-8 && (found.params[1] - 1.0).abs() < 1e-8, "{:?}", found.params);
            assert!(found.trace.windows(2).all(|w| w[1].cost <= w[0].cost && w[1].evaluations > w[0].evaluations));
            let last = found.points.last().unwrap();
            assert!((last[0] - found.params[0]).abs() < 1e-6);
        }
    }

    #[test]
    fn ends_are_named() {
        let unit = DMatrix::identity(2, 2);
        assert_eq!(
            minimize(&Valley, &[-1.2, 1.0], &unit, DescentLimits { iterations: 3, ..LIMITS }).termination,
            Termination::IterationLimit
        );
        assert_eq!(minimize(&Valley, &[-4.0, 1.0], &unit, LIMITS).termination, Termination::NotFinite);
        assert_eq!(minimize(&Valley, &[f64::NAN, 1.0], &unit, LIMITS).termination, Termination::Refused);
        assert_eq!(minimize(&Valley, &[1.0], &unit, LIMITS).termination, Termination::Refused);
    }
}
