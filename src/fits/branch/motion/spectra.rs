//! Periodograms of readings with gaps, with or without a taper, and the windows through which they see the motion.

use mesophyll_base::fourier::Complex;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// Periodograms of all channels of a record.
#[derive(Debug, Clone)]
pub struct Periodograms {
    /// Time between readings (s).
    pub step: f64,
    /// Places for readings on the even grid of times, gaps included (n).
    pub readings: usize,
    /// Degree of the polynomial that was taken out; 0 is the mean.
    pub degree: usize,
    /// X_k of every channel at k/T for k = 0 … n/2, scaled so that |X_k|² is the one-sided periodogram (mm²/Hz).
    pub lines: Vec<Vec<Complex<f64>>>,
    /// |X_k|².
    pub powers: Vec<Vec<f64>>,
    /// For every distance in steps: Σ w_t w_(t+distance)/Σ w², where w is the taper, and 0 at gaps. Channels with the
    /// same gaps share one.
    pub windows: Vec<Vec<f64>>,
    /// Window of each channel.
    pub window_of: Vec<usize>,
    /// Factor on the variance of what is averaged over frequencies, because a taper and gaps make neighbours alike: n Σ
    /// w⁴/(Σ w²)². 1 without them.
    pub inflation: f64,
    /// One-sided density of the readings' noise (mm²/Hz).
    pub floor: f64,
}

/// One-sided periodogram of readings (mm²/Hz) at k/T for k = 0 … n/2, without the mean.
pub fn periodogram(readings: &[f64], step: f64) -> Vec<f64> {
    Periodograms::new(&[readings.to_vec()], step, 0.0, 0.0, 0).powers.remove(0)
}

impl Periodograms {
    /// Of channels in which NaN is a gap, at even steps (s), with the standard error `noise` of a reading (mm). `taper`
    /// is the share of the record over which its ends together are smoothly faded (a Tukey window); `degree` is that
    /// of the polynomial that is taken out.
    pub fn new(channels: &[Vec<f64>], step: f64, noise: f64, taper: f64, degree: usize) -> Periodograms {
        let n = channels.first().map_or(0, Vec::len);
        let forward = mesophyll_base::fourier::forward(n.max(1));
        let mut out = Periodograms {
            step,
            readings: n,
            degree,
            lines: Vec::new(),
            powers: Vec::new(),
            windows: Vec::new(),
            window_of: Vec::new(),
            inflation: 1.0,
            floor: 2.0 * step * noise * noise,
        };
        let mut weights: Vec<Vec<f64>> = Vec::new();
        for readings in channels {
            let weight: Vec<f64> = readings
                .iter()
                .enumerate()
                .map(|(t, r)| if r.is_nan() { 0.0 } else { faded((t as f64 + 0.5) / n as f64, taper) })
                .collect();
            let squares: f64 = weight.iter().map(|w| w * w).sum();
            let scale = (2.0 * step / squares).sqrt();
            let mut buffer: Vec<Complex<f64>> = without_trend(readings, degree)
                .iter()
                .zip(&weight)
                .map(|(r, w)| Complex::new(if r.is_nan() { 0.0 } else { r * w * scale }, 0.0))
                .collect();
            forward.process(&mut buffer);
            buffer.truncate(n / 2 + 1);
            out.powers.push(buffer.iter().map(Complex::norm_sqr).collect());
            out.lines.push(buffer);
            let known = weights.iter().position(|w| *w == weight).unwrap_or_else(|| {
                out.windows.push(lags(&weight, squares));
                let fourth: f64 = weight.iter().map(|w| w.powi(4)).sum();
                out.inflation = out.inflation.max(n as f64 * fourth / (squares * squares));
                weights.push(weight);
                weights.len() - 1
            });
            out.window_of.push(known);
        }
        out
    }

    /// Distance of frequencies (Hz).
    pub fn resolution(&self) -> f64 {
        1.0 / (self.readings as f64 * self.step)
    }

    /// The highest frequency that a fit may use, in units of [`Periodograms::resolution`].
    pub fn top(&self) -> usize {
        (self.readings / 2).saturating_sub(1)
    }
}

/// The Tukey window at the share `x` of the record.
fn faded(x: f64, taper: f64) -> f64 {
    let end = x.min(1.0 - x);
    if end >= 0.5 * taper { 1.0 } else { 0.5 - 0.5 * (2.0 * PI * end / taper).cos() }
}

/// Σ w_t w_(t+j)/Σ w² for j = 0 … n − 1.
fn lags(weight: &[f64], squares: f64) -> Vec<f64> {
    let n = weight.len();
    let size = (2 * n).next_power_of_two();
    let mut line: Vec<Complex<f64>> = weight.iter().map(|w| Complex::new(*w, 0.0)).collect();
    line.resize(size, Complex::new(0.0, 0.0));
    mesophyll_base::fourier::forward(size).process(&mut line);
    for value in &mut line {
        *value = Complex::new(value.norm_sqr(), 0.0);
    }
    mesophyll_base::fourier::inverse(size).process(&mut line);
    line[..n].iter().map(|c| c.re / (size as f64 * squares)).collect()
}

/// Legendre's polynomials up to a degree, at the share `x` of the record.
pub fn legendre(x: f64, degree: usize) -> Vec<f64> {
    let z = 2.0 * x - 1.0;
    let mut out = vec![1.0, z];
    for k in 2..=degree {
        let k = k as f64;
        let [.., before, last] = out[..] else { break };
        out.push(((2.0 * k - 1.0) * z * last - (k - 1.0) * before) / k);
    }
    out.truncate(degree + 1);
    out
}

/// The readings without the polynomial of a degree that is nearest to them.
pub fn without_trend(readings: &[f64], degree: usize) -> Vec<f64> {
    let n = readings.len();
    let basis = |t: usize| legendre((t as f64 + 0.5) / n as f64, degree);
    let mut normal = DMatrix::zeros(degree + 1, degree + 1);
    let mut right = DVector::zeros(degree + 1);
    for (t, r) in readings.iter().enumerate().filter(|(_, r)| !r.is_nan()) {
        let b = DVector::from_vec(basis(t));
        normal += &b * b.transpose();
        right += b * *r;
    }
    // Few readings within long gaps do not determine all of it; then the mean alone is taken out.
    let mean = readings.iter().filter(|r| !r.is_nan()).sum::<f64>() / normal[(0, 0)];
    match normal.cholesky().filter(|_| degree > 0) {
        Some(factor) => {
            let found = factor.solve(&right);
            let trend = |t: usize| basis(t).iter().zip(&found).map(|(b, f)| b * f).sum::<f64>();
            readings.iter().enumerate().map(|(t, r)| r - trend(t)).collect()
        }
        None => readings.iter().map(|r| r - mean).collect(),
    }
}
