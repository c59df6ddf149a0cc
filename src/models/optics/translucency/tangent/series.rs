//! Chebyshev series of several functions at once. A series depends linearly on the values that it is fitted to.
//! Therefore the series of a derivative is the derivative of the series.

use mesophyll_base::chebyshev;
use rayon::prelude::*;

/// Several functions of a positive number as Chebyshev series over its logarithm.
#[derive(Debug, Clone)]
pub struct ChebyshevSeries<const N: usize> {
    middle: f64,
    half: f64,
    pub coefficients: Vec<[f64; N]>,
}

impl<const N: usize> ChebyshevSeries<N> {
    /// A series of `count` terms over [low, high]; a single term where both ends are the same.
    pub fn fit(f: impl Fn(f64) -> [f64; N] + Sync, low: f64, high: f64, count: usize) -> ChebyshevSeries<N> {
        let (middle, half) = (0.5 * (high.ln() + low.ln()), 0.5 * (high.ln() - low.ln()));
        let count = if half > 1e-12 { count } else { 1 };
        let values: Vec<[f64; N]> =
            (0..count).into_par_iter().map(|k| f((middle + half * chebyshev::node(k, count)).exp())).collect();
        let coefficients = (0..count).map(|j| {
            let mut sum = [0.0; N];
            for (k, v) in values.iter().enumerate() {
                let weight =
                    (j as f64 * chebyshev::angle(k, count)).cos() * if j == 0 { 1.0 } else { 2.0 } / count as f64;
                sum.iter_mut().zip(v).for_each(|(s, v)| *s += weight * v);
            }
            sum
        });
        ChebyshevSeries { middle, half, coefficients: coefficients.collect() }
    }

    pub fn at(&self, x: f64) -> [f64; N] {
        let t = if self.coefficients.len() > 1 { ((x.ln() - self.middle) / self.half).clamp(-1.0, 1.0) } else { 0.0 };
        chebyshev::sums(&self.coefficients, t)
    }
}
