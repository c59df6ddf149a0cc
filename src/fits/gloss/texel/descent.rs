//! The descent of one texel: Levenberg–Marquardt on the projected problem. Its weights come first from the samples and
//! later from the model.

use super::{Job, NEAR, State};
use crate::gloss::projection::NONLINEAR;
use crate::gloss::{M_RANGE, TILT_LIMIT};
use mesophyll_base::solvers::Termination;
use mesophyll_base::solvers::damping::{self, DampedProblem, DampingControl, NormalStep, normal_step};

impl Job<'_> {
    /// Runs Levenberg–Marquardt with Marquardt's scaling until the predicted decrease of χ² is below `tolerance`. With
    /// `reweigh`, weights are computed from the model once the fit is near. A texel needs three to six steps. The
    /// columns are left at the returned state, or within the last linear step of it.
    pub fn descend(&mut self, mut state: State, tolerance: f64, reweigh: bool) -> (State, Termination) {
        let mut control = DampingControl::MARQUARDT;
        if reweigh {
            let before = self.iterations;
            let (at, end, near) = self.steps(state, tolerance, true, &control);
            if !near && end != Termination::NoProgress {
                return (at, end);
            }
            // The fit is near, or stuck under provisional weights: the weights are now computed from the model at this
            // point.
            control.iterations -= self.iterations - before;
            state = self.reweighed(at);
        }
        let (at, end, _) = self.steps(state, tolerance, false, &control);
        let at = if end == Termination::NoProgress { self.evaluate(at.p) } else { at };
        (at, end)
    }

    /// The same under the present weights. Also returns whether `provisional` weights may now be changed.
    fn steps(
        &mut self,
        at: State,
        tolerance: f64,
        provisional: bool,
        control: &DampingControl,
    ) -> (State, Termination, bool) {
        if !at.chi2.is_finite() {
            return (at, Termination::NotFinite, false);
        }
        let mut steps = Steps {
            job: self,
            tolerance,
            provisional,
            near: false,
            normal: [[0.0; NONLINEAR]; NONLINEAR],
            gradient: [0.0; NONLINEAR],
        };
        let (at, end) = damping::minimize(&mut steps, at, control);
        (at, end, steps.near)
    }

    fn reweighed(&mut self, state: State) -> State {
        // The columns belong to the last trial. That is this point unless trials failed.
        let here = self.project(state.p);
        let state = if here.chi2 == state.chi2 { here } else { self.evaluate(state.p) };
        self.weigh(&state);
        self.project(state.p)
    }
}

/// The projected problem at its last point: normal matrix, and gradient of χ²/2 in the downhill direction.
struct Steps<'a, 'b> {
    job: &'a mut Job<'b>,
    tolerance: f64,
    provisional: bool,
    near: bool,
    normal: [[f64; NONLINEAR]; NONLINEAR],
    gradient: [f64; NONLINEAR],
}

/// A step, and the point within the bounds to which it leads.
struct Step {
    linear: NormalStep<NONLINEAR>,
    to: [f64; NONLINEAR],
}

impl DampedProblem for Steps<'_, '_> {
    type Point = State;
    type Step = Step;

    fn linearise(&mut self, at: &mut State) {
        self.job.iterations += 1;
        self.job.slopes(at);
        let (mut normal, mut gradient) = ([[0.0; NONLINEAR]; NONLINEAR], [0.0; NONLINEAR]);
        for channel in &at.channels {
            channel.accumulate(&channel.inverse, &mut normal, &mut gradient);
        }
        // A parameter at its bound whose step points beyond the bound is held there. Otherwise shortened steps of the
        // others would crawl along the bound.
        let hits = |k: usize| {
            bounded(&at.p, &std::array::from_fn(|j| if j == k { gradient[k].signum() * 1e-3 } else { 0.0 })) == at.p
        };
        let rest: [bool; NONLINEAR] =
            std::array::from_fn(|k| (self.job.held && k == 1) || (gradient[k] != 0.0 && hits(k)));
        for k in (0..NONLINEAR).filter(|&k| rest[k]) {
            normal[k] = [0.0; NONLINEAR];
            for row in &mut normal {
                row[k] = 0.0;
            }
            gradient[k] = 0.0;
        }
        (self.normal, self.gradient) = (normal, gradient);
    }

    fn step(&mut self, at: &State, damping: f64) -> Option<Step> {
        let linear = normal_step(&self.normal, &self.gradient, damping, 1 + self.job.tilts)?;
        Some(Step { linear, to: bounded(&at.p, &linear.step) })
    }

    fn end(&mut self, at: &mut State, step: &Step) -> Option<Termination> {
        let predicted = step.linear.predicted;
        if self.provisional && predicted < NEAR {
            self.near = true;
            return Some(Termination::CostConverged);
        }
        let inside = (0..1 + self.job.tilts).all(|k| step.to[k] == at.p[k] + step.linear.step[k]);
        let stays = step.to == at.p;
        if predicted < self.tolerance && (inside || stays) {
            if inside {
                at.shift(&step.linear.step, predicted);
            }
            return Some(Termination::CostConverged);
        }
        stays.then_some(Termination::StepSmall)
    }

    fn take(&mut self, _: &State, step: &Step, _: f64) -> State {
        self.job.evaluate(step.to)
    }

    fn better(&self, at: &State, trial: &State) -> bool {
        trial.chi2 < at.chi2
    }

    fn settled(&self, before: &State, now: &State) -> Option<Termination> {
        (before.chi2 - now.chi2 < 1e-3 * self.tolerance).then_some(Termination::CostConverged)
    }
}

/// Applies a step after limiting its length, and keeps the result within the bounds.
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
