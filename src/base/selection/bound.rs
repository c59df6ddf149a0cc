//! What no set of readings can beat.

use super::{Covariance, DesignProblem, DesignSituation};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Steps of the descent that bounds all designs from below.
const BOUND_STEPS: usize = 300;

impl DesignProblem {
    /// The ratio of errors that no set of `count` readings can fall below. The convex problem of readings in part is
    /// descended along its gradient; at every step the tangent bounds its least value from below.
    pub fn best_possible(&self, count: usize) -> Option<f64> {
        self.best_possible_watched(count, &|_, _| true)
    }

    /// The same. `watch` hears how many steps of how many are done at most, and ends the search where it answers with
    /// `false`; then there is no answer.
    pub fn best_possible_watched(&self, count: usize, watch: &dyn Fn(usize, usize) -> bool) -> Option<f64> {
        let (n, weights) = (self.candidates(), self.weights()?);
        let count = count.min(n);
        let mut share = vec![count as f64 / n as f64; n];
        self.taken.iter().for_each(|k| share[*k] = 1.0);
        let mut bound = 0.0f64;
        for step in 0..BOUND_STEPS {
            if !watch(step, BOUND_STEPS) {
                return None;
            }
            let state: Vec<Covariance> = self
                .situations
                .par_iter()
                .zip(&weights)
                .map(|(s, weight)| Some(Covariance { v: self.covariance(s, |k| share[k])?, weight: weight.clone() }))
                .collect::<Option<_>>()?;
            let value: f64 = state.iter().map(Covariance::criterion).sum();
            // ∂criterion/∂share_k = −tr(R V W V Rᵀ); a reading that is taken already is no choice.
            let slope = |k: usize| -> f64 {
                let of = |(s, of): (&Covariance, &DesignSituation)| {
                    let p = s.v.nrows();
                    let g = DMatrix::from_row_slice(of.rows[k].len() / p, p, &of.rows[k]) * &s.v;
                    -(&g * &s.weight).dot(&g)
                };
                state.iter().zip(&self.situations).map(of).sum()
            };
            let slopes: Vec<f64> = (0..n).into_par_iter().map(slope).collect();
            let mut order: Vec<usize> = (0..n).filter(|k| !self.taken.contains(k)).collect();
            order.sort_by(|a, b| slopes[*a].total_cmp(&slopes[*b]));
            order.truncate(count.saturating_sub(self.taken.len()));
            let mut vertex = vec![0.0; n];
            self.taken.iter().chain(&order).for_each(|k| vertex[*k] = 1.0);
            let drop: f64 = (0..n).map(|k| slopes[k] * (vertex[k] - share[k])).sum();
            bound = bound.max(value + drop);
            if -drop < 1e-4 * value {
                break;
            }
            let part = 2.0 / (step as f64 + 2.0) * 0.5;
            share.iter_mut().zip(&vertex).for_each(|(s, v)| *s += part * (v - *s));
        }
        Some(bound.max(1.0).sqrt())
    }
}
