//! The loop of damped steps, for small fits that are run many times: texels, leaf-wide optics, slabs.
//!
//! A problem of fixed size keeps everything on the stack. The problem defines what a point holds, how a step is made
//! under a damping, and which of two points is better. The loop decides what is tried next and what is kept, and it
//! allocates nothing. Its reaction to a rejected step is one of the few strategies in [`DampingControl`]; the certified
//! problems of NIST are run with each of them. For fits with many residuals, [`super::lm`] is the solver.
//!
//! D. W. Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", J. SIAM 11 (1963), 431–441.

use super::trace::Termination;

/// A function to minimise, with its steps. The order of the calls is: [`DampedProblem::linearise`] once at a point,
/// then for each try [`DampedProblem::step`], [`DampedProblem::end`], [`DampedProblem::take`],
/// [`DampedProblem::better`].
pub trait DampedProblem {
    /// A place, with everything that is known there.
    type Point;
    /// A move from a place.
    type Step;

    /// Prepares what the steps from this point need: slopes, the normal matrix.
    fn linearise(&mut self, _at: &mut Self::Point) {}
    /// The step from `at` under this damping (0 is none); `None` where it is not finite.
    fn step(&mut self, at: &Self::Point, damping: f64) -> Option<Self::Step>;
    /// Why the descent ends here, if `step` is so small that it does. The last step may be taken without an evaluation.
    fn end(&mut self, at: &mut Self::Point, step: &Self::Step) -> Option<Termination>;
    /// The point that is reached by `share` of the step, 0 < `share` ≤ 1.
    fn take(&mut self, at: &Self::Point, step: &Self::Step, share: f64) -> Self::Point;
    /// Whether `trial` is kept instead of `at`.
    fn better(&self, at: &Self::Point, trial: &Self::Point) -> bool;
    /// Why the descent ends after this share of the step was rejected, if it does.
    fn stalled(&self, _at: &Self::Point, _step: &Self::Step, _share: f64) -> Option<Termination> {
        None
    }
    /// Why the descent ends after a step from `before` to `now`, if it does.
    fn settled(&self, _before: &Self::Point, _now: &Self::Point) -> Option<Termination> {
        None
    }
}

/// A strategy: what happens after a rejected step and after an accepted one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DampingControl {
    /// Largest number of points reached.
    pub iterations: usize,
    /// Damping of the first step.
    pub damping: f64,
    /// Largest number of dampings tried at a point.
    pub tries: usize,
    /// The damping beyond which no step is tried.
    pub most: f64,
    /// A rejected step is first shortened to this share of itself, `trials` times altogether; then the damping rises
    /// tenfold.
    pub shorter: f64,
    /// How often a step is shortened before the damping rises.
    pub trials: usize,
    /// After an accepted step the damping falls to this share of itself, but not below `least`.
    pub easier: f64,
    /// The damping falls no lower than this.
    pub least: f64,
}

impl DampingControl {
    /// Levenberg–Marquardt: tenfold damping for a rejected step, a tenth for an accepted one.
    pub const MARQUARDT: DampingControl = DampingControl {
        iterations: 60,
        damping: 1e-4,
        tries: 14,
        most: f64::INFINITY,
        shorter: 1.0,
        trials: 1,
        easier: 0.1,
        least: 1e-9,
    };

    /// Gauss–Newton with shortened steps, and damping only where no share of the step helps. It is for steps that must
    /// keep to constraints: a shorter step brings these closer, damping does not.
    pub const SHORTENED: DampingControl = DampingControl {
        iterations: 60,
        damping: 0.0,
        tries: usize::MAX,
        most: 1e6,
        shorter: 0.4,
        trials: 8,
        easier: 0.2,
        least: 0.0,
    };

    /// Newton's method with halved steps, never damped. For as many equations as unknowns.
    pub const HALVED: DampingControl =
        DampingControl { tries: 1, shorter: 0.5, trials: 64, ..DampingControl::SHORTENED };
}

/// The damping after an undamped first step has failed.
const FIRST: f64 = 1e-3;

/// Descends from `at`. Ends by the problem's own tests, as [`Termination::NotFinite`] where a step is not finite, as
/// [`Termination::NoProgress`] where no damping that [`DampingControl`] allows gave a better point, or as
/// [`Termination::IterationLimit`].
pub fn minimize<P: DampedProblem>(
    problem: &mut P,
    mut at: P::Point,
    control: &DampingControl,
) -> (P::Point, Termination) {
    let mut damping = control.damping;
    for _ in 0..control.iterations {
        problem.linearise(&mut at);
        let mut tries = 0;
        let next = 'tries: loop {
            let Some(step) = problem.step(&at, damping) else { return (at, Termination::NotFinite) };
            if let Some(end) = problem.end(&mut at, &step) {
                return (at, end);
            }
            let mut share = 1.0;
            for _ in 0..control.trials {
                let trial = problem.take(&at, &step, share);
                if problem.better(&at, &trial) {
                    break 'tries trial;
                }
                if let Some(end) = problem.stalled(&at, &step, share) {
                    return (at, end);
                }
                share *= control.shorter;
            }
            tries += 1;
            if tries >= control.tries || damping > control.most {
                return (at, Termination::NoProgress);
            }
            damping = if damping > 0.0 { 10.0 * damping } else { FIRST };
        };
        damping = (damping * control.easier).max(control.least);
        let end = problem.settled(&at, &next);
        at = next;
        if let Some(end) = end {
            return (at, end);
        }
    }
    (at, Termination::IterationLimit)
}

/// A step found from the normal equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalStep<const N: usize> {
    /// Change of each parameter.
    pub step: [f64; N],
    /// Decrease of Σ r² (not of half of it) that the linear model promises.
    pub predicted: f64,
}

/// Solves (A + λ diag A) δ = g over the first `count` of `N` parameters by Cholesky, where A = JᵀJ and g = −Jᵀr. A
/// parameter without influence does not move. `None` where something is not finite.
pub fn normal_step<const N: usize>(
    normal: &[[f64; N]; N],
    gradient: &[f64; N],
    damping: f64,
    count: usize,
) -> Option<NormalStep<N>> {
    let mut l = [[0.0; N]; N];
    let mut inverse = [0.0; N];
    for i in 0..count {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            if i > j {
                l[i][j] = (normal[i][j] - dot) * inverse[j];
                continue;
            }
            let damped = normal[i][i] * (1.0 + damping);
            let pivot = damped - dot;
            if !pivot.is_finite() {
                return None;
            }
            if pivot > 1e-14 * damped {
                l[i][i] = pivot.sqrt();
                inverse[i] = 1.0 / l[i][i];
            } else {
                l[i] = [0.0; N];
            }
        }
    }
    let mut step = [0.0; N];
    for i in 0..count {
        step[i] = (gradient[i] - (0..i).map(|k| l[i][k] * step[k]).sum::<f64>()) * inverse[i];
    }
    for i in (0..count).rev() {
        step[i] = (step[i] - (i + 1..count).map(|k| l[k][i] * step[k]).sum::<f64>()) * inverse[i];
    }
    let mut predicted = 0.0;
    for i in 0..count {
        predicted += 2.0 * gradient[i] * step[i];
        for j in 0..count {
            predicted -= step[i] * normal[i][j] * step[j];
        }
    }
    step.iter().all(|s| s.is_finite()).then_some(NormalStep { step, predicted })
}

/// Newton's step for two equations: J δ = d.
#[inline]
pub fn newton_step(jacobian: &[[f64; 2]; 2], d: [f64; 2]) -> [f64; 2] {
    let j = jacobian;
    let det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
    [(j[1][1] * d[0] - j[0][1] * d[1]) / det, (j[0][0] * d[1] - j[1][0] * d[0]) / det]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley: residuals 10 (y − x²) and 1 − x, without a value beyond `wall`. A `sign` of −1 makes the
    /// slopes wrong.
    struct Valley {
        wall: f64,
        sign: f64,
    }

    impl Valley {
        fn at(&self, p: [f64; 2]) -> ([f64; 2], f64) {
            let r = [10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]];
            (p, if p[0] > self.wall { f64::NAN } else { r[0] * r[0] + r[1] * r[1] })
        }
    }

    impl DampedProblem for Valley {
        type Point = ([f64; 2], f64);
        type Step = NormalStep<2>;

        fn step(&mut self, (p, _): &Self::Point, damping: f64) -> Option<NormalStep<2>> {
            let r = [10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]];
            let j = [[-20.0 * p[0], -1.0], [10.0, 0.0]];
            let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
            let normal = [[dot(j[0], j[0]), dot(j[0], j[1])], [dot(j[1], j[0]), dot(j[1], j[1])]];
            normal_step(&normal, &[-self.sign * dot(j[0], r), -self.sign * dot(j[1], r)], damping, 2)
        }

        fn end(&mut self, at: &mut Self::Point, step: &NormalStep<2>) -> Option<Termination> {
            (step.predicted <= 1e-24 * (1.0 + at.1)).then_some(Termination::CostConverged)
        }

        fn take(&mut self, (p, _): &Self::Point, step: &NormalStep<2>, share: f64) -> Self::Point {
            self.at([p[0] + share * step.step[0], p[1] + share * step.step[1]])
        }

        fn better(&self, at: &Self::Point, trial: &Self::Point) -> bool {
            trial.1 < at.1
        }
    }

    #[test]
    fn every_strategy_finds_the_valleys_floor() {
        for control in [DampingControl::MARQUARDT, DampingControl::SHORTENED, DampingControl::HALVED] {
            for start in [[-1.2, 1.0], [-30.0, 5.0], [0.5, -700.0]] {
                let mut valley = Valley { wall: 1.5, sign: 1.0 };
                let start = valley.at(start);
                let (([x, y], _), end) = minimize(&mut valley, start, &DampingControl { iterations: 2000, ..control });
                assert!(end.converged() && (x - 1.0).abs() < 1e-9 && (y - 1.0).abs() < 1e-9, "{x} {y} {end:?}");
            }
        }
    }

    #[test]
    fn ends_are_named() {
        let end = |mut valley: Valley, start: [f64; 2], control: DampingControl| {
            let start = valley.at(start);
            let (at, end) = minimize(&mut valley, start, &control);
            (at.0, end)
        };
        let right = || Valley { wall: 1.5, sign: 1.0 };
        let few = DampingControl { iterations: 2, ..DampingControl::MARQUARDT };
        assert_eq!(end(right(), [-1.2, 1.0], few).1, Termination::IterationLimit);
        assert_eq!(end(right(), [f64::NAN, 1.0], DampingControl::MARQUARDT).1, Termination::NotFinite);
        // Uphill, only rounding can look like an improvement.
        for control in [DampingControl::MARQUARDT, DampingControl::SHORTENED, DampingControl::HALVED] {
            let (at, end) = end(Valley { wall: 1.5, sign: -1.0 }, [-1.2, 1.0], control);
            assert!(!end.converged() && (at[0] + 1.2).abs() < 1e-9 && (at[1] - 1.0).abs() < 1e-9, "{at:?} {end:?}");
        }
    }

    #[test]
    fn a_parameter_without_influence_keeps_its_place() {
        let found = normal_step(&[[4.0, 0.0], [0.0, 0.0]], &[2.0, 0.0], 0.0, 2).unwrap();
        assert_eq!((found.step, found.predicted), ([0.5, 0.0], 1.0));
        assert!(normal_step(&[[f64::NAN, 0.0], [0.0, 1.0]], &[2.0, 0.0], 0.0, 2).is_none());
    }
}
