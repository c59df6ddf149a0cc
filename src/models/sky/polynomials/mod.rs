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
