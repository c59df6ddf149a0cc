//! The descent of one texel: Levenberg–Marquardt on the projected problem, with weights that turn from the samples' to
//! the model's.

use super::{ITERATIONS, Job, NEAR, State};
use crate::gloss::project::NONLINEAR;
use crate::gloss::{M_RANGE, TILT_LIMIT};
use mesophyll_solve::Termination;

impl Job<'_> {
    /// Levenberg–Marquardt with Marquardt's scaling until the predicted decrease of χ² is below `tolerance`; `reweigh`:
    /// weights from the model once it is near. The columns are left at the state returned, or within the last linear
    /// step of it.
    pub fn descend(&mut self, mut state: State, tolerance: f64, mut reweigh: bool) -> (State, Termination) {
        let count = 1 + self.tilts;
        let mut lambda = 1e-4;
        for _ in 0..ITERATIONS {
            if !state.chi2.is_finite() {
                return (state, Termination::NotFinite);
            }
            self.iterations += 1;
            self.slopes(&mut state);
            let (mut normal, mut gradient) = ([[0.0; NONLINEAR]; NONLINEAR], [0.0; NONLINEAR]);
            for channel in &state.channels {
                channel.accumulate(&channel.inverse, &mut normal, &mut gradient);
            }
            // A parameter at its bound that wants beyond it rests there: cut steps of the others would crawl along the
            // bound.
            let hits = |k: usize| {
                bounded(&state.p, &std::array::from_fn(|j| if j == k { gradient[k].signum() * 1e-3 } else { 0.0 }))
                    == state.p
            };
            let rest: [bool; NONLINEAR] =
                std::array::from_fn(|k| (self.held && k == 1) || (gradient[k] != 0.0 && hits(k)));
            for k in (0..NONLINEAR).filter(|&k| rest[k]) {
                normal[k] = [0.0; NONLINEAR];
                for row in &mut normal {
                    row[k] = 0.0;
                }
                gradient[k] = 0.0;
            }
            let mut better = None;
            for _ in 0..14 {
                let Some((step, predicted)) = damped_step(&normal, &gradient, lambda, count) else {
                    return (state, Termination::NotFinite);
                };
                if reweigh && predicted < NEAR {
                    break;
                }
                let trial = bounded(&state.p, &step);
                let inside = (0..count).all(|k| trial[k] == state.p[k] + step[k]);
                if predicted < tolerance && (inside || trial == state.p) {
                    if inside {
                        state.shift(&step, predicted);
                    }
                    return (state, Termination::CostConverged);
                }
                if trial == state.p {
                    return (state, Termination::StepSmall);
                }
                let next = self.evaluate(trial);
                if next.chi2 < state.chi2 {
                    better = Some(next);
                    break;
                }
                lambda *= 10.0;
            }
            match better {
                Some(next) => {
                    let gain = state.chi2 - next.chi2;
                    state = next;
                    lambda = (lambda * 0.1).max(1e-9);
                    if gain < 1e-3 * tolerance {
                        return (state, Termination::CostConverged);
                    }
                }
                None if reweigh => {
                    // Near, or stuck under provisional weights: now the model's, at the columns of this point.
                    reweigh = false;
                    lambda = 1e-4;
                    state = self.reweighed(state);
                }
                None => {
                    let state = self.evaluate(state.p);
                    return (state, Termination::NoProgress);
                }
            }
        }
        (state, Termination::IterationLimit)
    }

    fn reweighed(&mut self, state: State) -> State {
        // The columns belong to the last trial, which is this point unless trials failed.
        let here = self.project(state.p);
        let state = if here.chi2 == state.chi2 { here } else { self.evaluate(state.p) };
        self.weigh(&state);
        self.project(state.p)
    }
}

/// Applies a step, kept short and within the bounds.
pub(in crate::gloss) fn bounded(p: &[f64; NONLINEAR], step: &[f64; NONLINEAR]) -> [f64; NONLINEAR] {
    let shrink = [1.0 / step[0].abs().max(1.0), 0.3 / step[1].abs().max(0.3), 0.3 / step[2].abs().max(0.3)]
        .into_iter()
        .fold(1.0, f64::min);
    [
        (p[0] + shrink * step[0]).clamp(M_RANGE[0].ln(), M_RANGE[1].ln()),
        (p[1] + shrink * step[1]).clamp(-TILT_LIMIT, TILT_LIMIT),
        (p[2] + shrink * step[2]).clamp(-TILT_LIMIT, TILT_LIMIT),
    ]
}

/// Solves (N + λ diag N) δ = g over the first `count` parameters by Cholesky; also the decrease of χ² that the linear
/// model predicts. A parameter without influence keeps its place; `None` where something is not finite.
fn damped_step(
    normal: &[[f64; NONLINEAR]; NONLINEAR],
    gradient: &[f64; NONLINEAR],
    lambda: f64,
    count: usize,
) -> Option<([f64; NONLINEAR], f64)> {
    let mut l = [[0.0; NONLINEAR]; NONLINEAR];
    let mut inverse = [0.0; NONLINEAR];
    for i in 0..count {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            if i > j {
                l[i][j] = (normal[i][j] - dot) * inverse[j];
                continue;
            }
            let damped = normal[i][i] * (1.0 + lambda);
            let pivot = damped - dot;
            if !pivot.is_finite() {
                return None;
            }
            if pivot > 1e-14 * damped {
                l[i][i] = pivot.sqrt();
                inverse[i] = 1.0 / l[i][i];
            } else {
                l[i] = [0.0; NONLINEAR];
            }
        }
    }
    let mut step = [0.0; NONLINEAR];
    for i in 0..count {
        step[i] = (gradient[i] - (0..i).map(|k| l[i][k] * step[k]).sum::<f64>()) * inverse[i];
    }
    for i in (0..count).rev() {
        step[i] = (step[i] - (i + 1..count).map(|k| l[k][i] * step[k]).sum::<f64>()) * inverse[i];
    }
    // Decrease of χ² (not of half of it): 2 g·δ − δᵀNδ.
    let mut predicted = 0.0;
    for i in 0..count {
        predicted += 2.0 * gradient[i] * step[i];
        for j in 0..count {
            predicted -= step[i] * normal[i][j] * step[j];
        }
    }
    step.iter().all(|s| s.is_finite()).then_some((step, predicted))
}
