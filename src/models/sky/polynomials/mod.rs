//! Fitted polynomials of sky coefficients over (θs, τ), the sun's zenith angle and the turbidity, and how they are
//! evaluated. Another room fits them.
//!
//! Two forms, both for the m ≥ 0 coefficients (the sun's azimuth is 0, so m < 0 are zero) in f32 or f64:
//! - [`FoldedPolynomials`]: for Preetham only. Its prefactors are in closed form; the rest is Chebyshev polynomials of
//!   the right parity in θs and in ln(τ − 1.2029).
//! - [`PolynomialTensor`]: for any model. It is a plain product of two polynomial bases in θs and τ: the dissertation's
//!   monomials, or Chebyshev polynomials.

pub mod folding;
pub mod mix;
pub mod tensor;

pub use folding::{FixedSky, FoldedPolynomials};
pub use tensor::{PolynomialBasis, PolynomialTensor};

use std::ops::{Add, AddAssign, Mul};

/// f32 or f64.
pub trait SkyFloat:
    Copy + Default + Send + Sync + Add<Output = Self> + Mul<Output = Self> + AddAssign + 'static
{
    /// `f32` or `f64`.
    const NAME: &'static str;
    /// The nearest number of this precision.
    fn narrow(x: f64) -> Self;
    /// The same number in double precision.
    fn wide(self) -> f64;
    /// self · b + c; fused if `FUSED` is set (only for processors that have the instruction: on others it is a slow
    /// call).
    fn fma<const FUSED: bool>(self, b: Self, c: Self) -> Self;
}

macro_rules! scalar {
    ($t:ty) => {
        impl SkyFloat for $t {
            const NAME: &'static str = stringify!($t);
            #[inline(always)]
            fn narrow(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn wide(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn fma<const FUSED: bool>(self, b: Self, c: Self) -> Self {
                if FUSED { self.mul_add(b, c) } else { self * b + c }
            }
        }
    };
}
scalar!(f32);
scalar!(f64);

/// Fills `out` with T_first, T_first+step, … at x. `step` is 1, or 2 for one parity only.
pub fn chebyshev(x: f64, first: usize, step: usize, out: &mut [f64]) {
    // T_{n+2s} = 2 T_s... for s = 1: 2x T − T; for s = 2: 2 T₂ T − T
    let twice = if step == 2 { 2.0 * (2.0 * x * x - 1.0) } else { 2.0 * x };
    // T_{first} and T_{first−step} (T₋₁ = x, T₋₂ = T₂)
    let (mut value, mut before) = match (first, step) {
        (0, 2) => (1.0, 2.0 * x * x - 1.0),
        (0, _) => (1.0, x),
        (_, 2) => (x, x),
        _ => (x, 1.0),
    };
    for v in out.iter_mut() {
        *v = value;
        (value, before) = (twice * value - before, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chebyshev_is_the_cosine() {
        for x in [-1.0, -0.3, 0.0, 0.8, 1.0] {
            let angle = f64::acos(x);
            for (first, step) in [(0, 1), (1, 1), (0, 2), (1, 2)] {
                let mut t = [0.0; 12];
                chebyshev(x, first, step, &mut t);
                for (k, v) in t.iter().enumerate() {
                    let want = ((first + step * k) as f64 * angle).cos();
                    assert!((v - want).abs() < 1e-13, "T{} at {x}: {v} {want}", first + step * k);
                }
            }
        }
    }
}
