//! Outliers among a texel's readings. Huber's weights find them, then they are rejected, and a plain fit of the rest
//! keeps full efficiency on clean data.

use super::RobustWeighting;
use super::texel::{CONVERGED, Job, State};
use mesophyll_base::solvers::Termination;
use mesophyll_base::statistics::{NORMAL_SCATTER, median_of};

/// A residual of more than this many standard deviations is an outlier. With 300 samples, noise alone reaches it in one
/// of 500 texels.
const OUTLIER: f64 = 4.5;
/// Huber's constant: it keeps 95 % of the efficiency for Gaussian noise.
const HUBER: f64 = 1.345;

impl Job<'_> {
    /// `worst` is the largest squared standardised residual of `state`. Returns the fit without outliers, how it ended,
    /// and the number of outliers.
    pub(super) fn reject(&mut self, state: State, termination: Termination, worst: f64) -> (State, Termination, usize) {
        if worst <= OUTLIER * OUTLIER && self.fitter.robust == RobustWeighting::Auto {
            return (state, termination, 0);
        }
        let readings: Vec<(usize, usize)> = (0..3)
            .flat_map(|c| (0..self.ws.y[c].len()).map(move |k| (c, k)))
            .filter(|&(c, k)| self.ws.used[c][k] > 0.0)
            .collect();
        let (plain, reason) = (state, termination);
        let mut state = self.evaluate(state.p);
        for _ in 0..8 {
            let scale = self.scale(&state, &readings);
            self.weigh(&state);
            for &(c, k) in &readings {
                let r = self.residual(&state, c, k).abs() / scale;
                self.ws.w[c][k] *= (HUBER / r).min(1.0);
            }
            let here = self.project(state.p);
            state = self.descend(here, 0.1, false).0;
            state = self.evaluate(state.p);
        }
        let mut termination = termination;
        let mut outliers = 0;
        for _ in 0..4 {
            let scale = self.scale(&state, &readings);
            let gone: Vec<bool> =
                readings.iter().map(|&(c, k)| self.residual(&state, c, k).abs() > OUTLIER * scale).collect();
            let changed = readings.iter().zip(&gone).any(|(&(c, k), &g)| (self.ws.used[c][k] == 0.0) != g);
            outliers = gone.iter().filter(|g| **g).count();
            if outliers * 4 > readings.len() {
                // More than a quarter of the samples being off is no accident: the model does not fit. The plain fit
                // then shows it in χ².
                for &(c, k) in &readings {
                    self.ws.used[c][k] = 1.0;
                }
                let state = self.evaluate(plain.p);
                self.weigh(&state);
                let state = self.project(plain.p);
                return (state, reason, 0);
            }
            for (&(c, k), &g) in readings.iter().zip(&gone) {
                self.ws.used[c][k] = if g { 0.0 } else { 1.0 };
            }
            self.weigh(&state);
            let here = self.project(state.p);
            (state, termination) = self.descend(here, CONVERGED, false);
            if !changed {
                break;
            }
            state = self.evaluate(state.p);
        }
        (state, termination, outliers)
    }

    /// Standardised residual of sample `k` in channel `c`, with the columns of the last evaluation.
    fn residual(&self, state: &State, c: usize, k: usize) -> f64 {
        let value = state.channels[c].rho_d * self.ws.columns[0][k] + state.channels[c].rho_s * self.ws.columns[1][k];
        (self.ws.y[c][k] - value) / self.noise.variance(c, value).sqrt()
    }

    /// Robust scale of the standardised residuals, at least 1.
    fn scale(&self, state: &State, readings: &[(usize, usize)]) -> f64 {
        let sizes = readings.iter().map(|&(c, k)| self.residual(state, c, k).abs());
        (NORMAL_SCATTER * median_of(sizes).unwrap_or(f64::NAN)).max(1.0)
    }
}
