//! What the periodograms tell of the parameters: derivatives, covariance, coherence of channels, and whether they ask
//! for drift.

use super::whittle::{ExpectedPeriodograms, GustParameters};
use mesophyll_base::fourier::Complex;
use nalgebra::DMatrix;

impl ExpectedPeriodograms<'_> {
    /// ∂ln E/∂p for every parameter, over the band, channel after channel.
    pub fn derivatives(&self, p: &GustParameters) -> Vec<Vec<f64>> {
        let slopes = self.slopes(p);
        let width = self.band.1 + 1 - self.band.0;
        let values: Vec<Vec<f64>> = slopes.iter().map(|s| s[0].clone()).collect();
        let whole = self.sum(p, &values);
        let shared = |which: usize| -> Vec<f64> {
            let at = |k: usize| {
                let (c, k) = (k / width, k % width);
                p.gain(c).powi(2) * slopes[self.spectra.window_of[c]][which][k]
            };
            (0..whole.len()).map(|k| at(k) / whole[k]).collect()
        };
        let one = |channel: usize, value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let at = |k: usize| if k / width == channel { value(k % width) / whole[k] } else { 0.0 };
            (0..whole.len()).map(at).collect()
        };
        let channels = 0..self.channels();
        let mut out = vec![shared(1), shared(2)];
        out.extend(channels.clone().map(|c| {
            let (power, mean) = (p.gain(c).powi(2), &values[self.spectra.window_of[c]]);
            one(c, &|k| 2.0 * power * mean[k])
        }));
        if self.fitted_speed() {
            out.push(shared(3));
        }
        if !self.drift.is_empty() {
            out.extend(channels.map(|c| one(c, &|k| self.drift(p, c, k))));
        }
        out
    }

    /// Fisher's information of the parameters.
    fn information(columns: &[Vec<f64>]) -> DMatrix<f64> {
        let n = columns.len();
        DMatrix::from_fn(n, n, |i, j| columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum::<f64>())
    }

    /// Covariance of the parameters: the inverse of Fisher's information, widened where tapers, gaps and coherent
    /// channels leave fewer independent numbers than there are frequencies; `None` where it cannot be inverted.
    pub fn covariance(&self, p: &GustParameters) -> Option<DMatrix<f64>> {
        let mut columns = self.derivatives(p);
        // A parameter that changes nothing (a drift of nearly 0) takes no part.
        let kept = |c: &Vec<f64>| c.iter().map(|v| v * v).sum::<f64>() > 1e-12;
        columns.truncate(self.drifts() + if columns[self.drifts()..].iter().all(kept) { self.channels() } else { 0 });
        let n = columns.len();
        let inverse = Self::information(&columns).try_inverse()?;
        let width = self.band.1 + 1 - self.band.0;
        let coherence = self.coherence(p);
        // What channels say of the same frequency is partly the same.
        let shared = DMatrix::from_fn(n, n, |i, j| {
            let dot = |a: usize, b: usize| -> f64 {
                (0..width).map(|k| columns[i][a * width + k] * columns[j][b * width + k]).sum()
            };
            let all = 0..self.channels();
            all.clone()
                .map(|a| all.clone().map(|b| if a == b { 1.0 } else { coherence } * dot(a, b)).sum::<f64>())
                .sum()
        });
        let covariance = &inverse * shared * &inverse * self.spectra.inflation;
        (0..n).all(|k| covariance[(k, k)] > 0.0 && covariance[(k, k)].is_finite()).then_some(covariance)
    }

    /// Squared coherence of two channels over the band, 0 to 1: 1 where the tip moves along a line.
    pub fn coherence(&self, p: &GustParameters) -> f64 {
        if self.channels() < 2 {
            return 0.0;
        }
        let whole = self.whole(p);
        let width = self.band.1 + 1 - self.band.0;
        let sum: Complex<f64> = (0..width)
            .map(|k| {
                let [a, b] = [0, 1].map(|c| self.spectra.lines[c][self.band.0 + k] / whole[c * width + k].sqrt());
                a * b.conj()
            })
            .sum();
        // Independent channels have 1/width by chance.
        let found = (sum / width as f64).norm_sqr();
        ((found - 1.0 / width as f64) / (1.0 - 1.0 / width as f64)).clamp(0.0, 1.0)
    }

    /// By how many standard errors the periodograms ask for drift beside what the parameters (which have none) hold:
    /// the score of the drift's size, freed from what the other parameters could take up.
    pub fn drift_score(&self, p: &GustParameters) -> f64 {
        let whole = self.whole(p);
        let measured = self.measured();
        let drifting = ExpectedPeriodograms::new(self.spectra, &self.known, self.band, true);
        let width = self.band.1 + 1 - self.band.0;
        let columns = self.derivatives(p);
        let Some(inverse) = Self::information(&columns).try_inverse() else { return f64::INFINITY };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let one = |c: usize| {
            let shape = &drifting.drift[self.spectra.window_of[c]];
            let column: Vec<f64> =
                (0..whole.len()).map(|k| if k / width == c { shape[k % width] / whole[k] } else { 0.0 }).collect();
            let excess: Vec<f64> = measured.iter().zip(&whole).map(|(i, e)| i / e - 1.0).collect();
            let across = nalgebra::DVector::from_iterator(columns.len(), columns.iter().map(|o| dot(o, &column)));
            let taken = (across.transpose() * &inverse * &across)[(0, 0)];
            let freed = dot(&column, &column) - taken;
            dot(&column, &excess) / (freed.max(1e-300) * self.spectra.inflation).sqrt()
        };
        (0..self.channels()).map(one).fold(f64::NEG_INFINITY, f64::max)
    }
}
