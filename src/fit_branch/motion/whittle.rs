//! The mean of a periodogram, and the fit to one.

use super::Known;
use mesophyll_fourier::{Complex, Transform};
use mesophyll_plant::wind::Oscillator;
use mesophyll_solve::{Closure, Options, lm};
use nalgebra::DMatrix;

/// ln f_h, ln γ, ln G of every channel, and 1/v where the wind's speed is fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters(pub Vec<f64>);

impl Parameters {
    /// f_h (Hz).
    pub fn resonance(&self) -> f64 {
        self.0[0].exp()
    }

    /// γ (1/s).
    pub fn damping(&self) -> f64 {
        self.0[1].exp()
    }

    /// G of a channel (mm/√Hz).
    pub fn gain(&self, channel: usize) -> f64 {
        self.0[2 + channel].exp()
    }

    /// 1/v (s/m).
    pub fn slowness(&self, known: &Known) -> f64 {
        known.speed.map_or_else(|| self.0.last().copied().unwrap_or(0.0), |v| 1.0 / v)
    }
}

/// How often frequencies above the highest one that the step resolves are folded back. Frequencies further up
/// contribute less than .2 % of the rest.
const FOLDS: i32 = 1;
/// Step of differences in a parameter.
const DIFFERENCE: f64 = 1e-5;

/// The mean of the periodogram of a record.
pub struct Expected {
    readings: usize,
    step: f64,
    known: Known,
    low: usize,
    high: usize,
    /// Points of the grid on which the power density is given.
    grid: usize,
    inverse: Transform,
    forward: Transform,
}

impl Expected {
    /// For `readings` readings with the interval `step` (s), at the frequencies k/T for k in `band`, both ends
    /// included.
    pub fn new(readings: usize, step: f64, known: &Known, band: (usize, usize)) -> Expected {
        let grid = (2 * readings).next_power_of_two();
        Expected {
            readings,
            step,
            known: *known,
            low: band.0,
            high: band.1,
            grid,
            inverse: mesophyll_fourier::inverse(grid),
            forward: mesophyll_fourier::forward(readings),
        }
    }

    /// Frequencies used, in all channels.
    pub fn bins(&self, channels: usize) -> usize {
        (self.high + 1 - self.low) * channels
    }

    /// The number of channels that the parameters have a gain for.
    pub fn channels(&self, p: &Parameters) -> usize {
        p.0.len() - 2 - usize::from(self.known.speed.is_none())
    }

    /// One-sided density by frequency (Hz) for a gain of 1.
    fn density(&self, p: &Parameters) -> impl Fn(f64) -> f64 {
        let oscillator = Oscillator { resonance: p.resonance(), damping: p.damping() };
        let slowness = p.slowness(&self.known);
        move |f| {
            let gusts = 1.0 + f * slowness;
            let third = gusts.cbrt();
            let response = oscillator.response(f);
            response * response / (gusts * third * third)
        }
    }

    /// One-sided mean of the periodogram over the band for a gain of 1 and no noise.
    pub fn mean(&self, p: &Parameters) -> Vec<f64> {
        let rate = 1.0 / self.step;
        let half = self.grid / 2;
        let density = self.density(p);
        let mut line = vec![Complex::new(0.0, 0.0); self.grid];
        for k in 0..=half {
            let f = k as f64 * rate / self.grid as f64;
            let folded: f64 = (-FOLDS..=FOLDS).map(|m| density((f + f64::from(m) * rate).abs())).sum::<f64>() * 0.5;
            line[k] = Complex::new(folded, 0.0);
            line[(self.grid - k) % self.grid] = line[k];
        }
        self.inverse.process(&mut line);
        // The autocovariance, weighted by the number of pairs of readings with this distance.
        let n = self.readings;
        let scale = rate / self.grid as f64;
        let zero = line[0].re * scale;
        let mut weighted: Vec<Complex<f64>> =
            (0..n).map(|j| Complex::new((1.0 - j as f64 / n as f64) * line[j].re * scale, 0.0)).collect();
        self.forward.process(&mut weighted);
        (self.low..=self.high).map(|k| 2.0 * self.step * (2.0 * weighted[k].re - zero)).collect()
    }

    /// Density of the readings' noise.
    fn floor(&self) -> f64 {
        2.0 * self.step * self.known.noise * self.known.noise
    }

    /// Parameters to begin with.
    pub fn start(&self, periodograms: &[Vec<f64>], resonance: f64, ratio: f64) -> Parameters {
        let mut p = vec![resonance.ln(), (ratio * 4.0 * std::f64::consts::PI * resonance).ln()];
        p.extend(periodograms.iter().map(|_| 0.0));
        if self.known.speed.is_none() {
            p.push(0.2);
        }
        let mut out = Parameters(p);
        let mean: f64 = self.mean(&out).iter().sum();
        for (c, i) in periodograms.iter().enumerate() {
            let measured: f64 = i[self.low..=self.high].iter().sum();
            out.0[2 + c] = 0.5 * (measured / mean).ln();
        }
        out
    }

    /// Whittle's estimate, and half the sum of squares there; `None` where the solver finds none.
    pub fn fit(&self, periodograms: &[Vec<f64>], start: &Parameters) -> Option<(Parameters, f64)> {
        let width = self.high + 1 - self.low;
        let residuals = |params: &[f64], out: &mut [f64]| {
            let p = Parameters(params.to_vec());
            let mean = self.mean(&p);
            for (c, i) in periodograms.iter().enumerate() {
                let power = p.gain(c).powi(2);
                for (k, e) in mean.iter().enumerate() {
                    out[c * width + k] = deviance(i[self.low + k] / (power * e + self.floor()));
                }
            }
        };
        let problem = Closure::new(start.0.len(), width * periodograms.len(), residuals);
        // The wind cannot blow backwards: below 0 the density has a pole.
        let mut lower = vec![f64::NEG_INFINITY; start.0.len()];
        if let (None, Some(slowness)) = (self.known.speed, lower.last_mut()) {
            *slowness = 0.0;
        }
        let upper = vec![f64::INFINITY; start.0.len()];
        // A tenth of a millionth of a standard error is precise enough.
        let options = Options {
            max_iterations: 200,
            cost_tolerance: 1e-12,
            step_tolerance: 1e-9,
            lower,
            upper,
            ..Options::default()
        };
        let found = lm::minimize(&problem, &start.0, &options);
        let usable = found.params.iter().all(|v| v.is_finite()) && found.cost.is_finite();
        usable.then_some((Parameters(found.params), found.cost))
    }

    /// Covariance of the parameters: the inverse of Fisher's information; `None` where it cannot be inverted.
    pub fn covariance(&self, p: &Parameters) -> Option<DMatrix<f64>> {
        let n = p.0.len();
        let channels = self.channels(p);
        let shape = |p: &Parameters| -> Vec<f64> {
            let mean = self.mean(p);
            (0..channels)
                .flat_map(|c| mean.iter().map(move |e| (c, *e)))
                .map(|(c, e)| (p.gain(c).powi(2) * e + self.floor()).ln())
                .collect()
        };
        let columns: Vec<Vec<f64>> = (0..n)
            .map(|k| {
                let at = |sign: f64| {
                    let mut moved = p.clone();
                    // The density continues smoothly to slownesses this little below 0.
                    moved.0[k] += sign * DIFFERENCE;
                    shape(&moved)
                };
                at(1.0).iter().zip(&at(-1.0)).map(|(a, b)| (a - b) / (2.0 * DIFFERENCE)).collect()
            })
            .collect();
        let information =
            DMatrix::from_fn(n, n, |i, j| columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum::<f64>());
        let inverse = information.try_inverse()?;
        (0..n).all(|k| inverse[(k, k)] > 0.0 && inverse[(k, k)].is_finite()).then_some(inverse)
    }
}

/// ±√(2(ρ − 1 − ln ρ)), with the sign of ρ − 1.
fn deviance(rho: f64) -> f64 {
    let d = rho - 1.0;
    if d.abs() < 1e-4 {
        // 2(ρ − 1 − ln ρ) = d² − 2d³/3 + d⁴/2 − …
        return d * (1.0 - d / 3.0 + 7.0 * d * d / 36.0);
    }
    if !(rho > 0.0) {
        return if rho == 0.0 { -40.0 } else { f64::NAN };
    }
    (2.0 * (d - rho.ln())).max(0.0).sqrt().copysign(d)
}
