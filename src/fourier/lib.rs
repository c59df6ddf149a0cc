//! Discrete Fourier transforms of `f64`, unnormalised, by `rustfft`.
//!
//! `rustfft` is generic, so that every package that plans a transform compiles all of it anew (40 s each in the dev
//! profile). This package is the only one that does; the others hold what it returns.

use rustfft::FftPlanner;
pub use rustfft::{Fft, num_complex::Complex};
use std::sync::Arc;

/// A planned transform, shared between threads.
pub type Transform = Arc<dyn Fft<f64>>;

/// X_k = Σ x_n e^(−2πi kn/N) of lines of `length` values.
pub fn forward(length: usize) -> Transform {
    FftPlanner::new().plan_fft_forward(length)
}

/// x_n = Σ X_k e^(2πi kn/N) of lines of `length` values: N times the inverse of [`forward`].
pub fn inverse(length: usize) -> Transform {
    FftPlanner::new().plan_fft_inverse(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the sum itself, for lengths with and without small factors.
    #[test]
    fn transforms_are_the_sums_they_say() {
        for n in [1usize, 2, 12, 17, 60] {
            let x: Vec<Complex<f64>> = (0..n).map(|k| Complex::new((k as f64).sin(), 0.3 * (k as f64).cos())).collect();
            for (transform, sign) in [(forward(n), -1.0), (inverse(n), 1.0)] {
                let mut found = x.clone();
                transform.process(&mut found);
                for (k, value) in found.iter().enumerate() {
                    let turn = sign * std::f64::consts::TAU * k as f64 / n as f64;
                    let want: Complex<f64> =
                        x.iter().enumerate().map(|(m, x)| x * Complex::from_polar(1.0, turn * m as f64)).sum();
                    assert!((value - want).norm() < 1e-12 * n as f64, "{n} {k}: {value} {want}");
                }
            }
        }
    }
}
