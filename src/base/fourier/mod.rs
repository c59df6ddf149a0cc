//! Discrete Fourier transforms of `f64`, unnormalised, by `rustfft`.
//!
//! `rustfft` is generic, so that every package that plans a transform compiles all of it anew (40 s each in the dev
//! profile). This package is the only one that does; the others hold what it returns.

#![warn(missing_docs)]

use rustfft::FftPlanner;
pub use rustfft::{Fft, num_complex::Complex};
use std::sync::Arc;

/// A planned transform, shared between threads.
pub type FourierTransform = Arc<dyn Fft<f64>>;

/// X_k = Σ x_n e^(−2πi kn/N) of lines of `length` values.
pub fn forward(length: usize) -> FourierTransform {
    FftPlanner::new().plan_fft_forward(length)
}

/// x_n = Σ X_k e^(2πi kn/N) of lines of `length` values: N times the inverse of [`forward`].
pub fn inverse(length: usize) -> FourierTransform {
    FftPlanner::new().plan_fft_inverse(length)
}
