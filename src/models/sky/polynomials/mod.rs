//! Fitted polynomials of sky coefficients over (θs, τ), the sun's zenith angle and the turbidity, and how they are
//! evaluated. Another room fits them.
//!
//! Two forms, both for the m ≥ 0 coefficients (the sun's azimuth is 0, so m < 0 are zero) in f32 or f64:
//! - [`FoldedPolynomials`]: for Preetham only. Its prefactors are in closed form; the rest is Chebyshev polynomials of
//! the right parity in θs and in ln(τ − 1.2029).
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
