//! The paper's sum over 2n + 1 dipoles in space (H9 Eq. 3.8, corrected) and its Hankel transform.
//!
//! T(r, d) = Σ_{j=−n..n} α′/(4π) [z (1 + σtr ρ) e^(−σtr ρ)/ρ³]_{real − virtual}, z = d − z_j, ρ = √(r² + z²). The print
//! has (1 + σtr ρ e^(−σtr ρ)), which becomes negative and never decays.

use super::Coefficients;
use super::scalar::Scalar;

/// Signed heights of the exit over the real and the virtual source of dipole `j`: d − z_r,j and d − z_v,j (Eq. 3.5).
fn heights<T: Scalar>(c: &Coefficients<T>, d: T, j: i64) -> [T; 2] {
    let shift = (d + c.extrapolation.times(2.0)).times(2.0 * j as f64);
    [d - shift - c.free_path, d - shift + c.free_path + c.extrapolation.times(2.0)]
}

/// Dipoles from the weakest to the strongest, so that small terms are not lost: ±n … ±1, 0.
fn indices(n: u32) -> impl Iterator<Item = i64> {
    (1..=i64::from(n)).rev().flat_map(|j| [-j, j]).chain([0])
}

pub fn transmittance<T: Scalar>(c: &Coefficients<T>, r: f64, d: T, n: u32) -> T {
    let term = |z: T| {
        let rho = (z * z + T::of(r * r)).sqrt();
        let x = c.transport2.sqrt() * rho;
        z * (T::of(1.0) + x) * (-x).exp() / (rho * rho * rho)
    };
    let sum = indices(n).fold(T::of(0.0), |sum, j| {
        let [real, image] = heights(c, d, j);
        sum + (term(real) - term(image))
    });
    c.albedo * sum.times(1.0 / (4.0 * std::f64::consts::PI))
}

/// Σ α′/2 [sign(z) e^(−K|z|)]: the transform of one pole is 2π z e^(−K|z|)/|z|.
pub fn spectrum<T: Scalar>(c: &Coefficients<T>, k_squared: T, d: T, n: u32) -> T {
    let k = (c.transport2 + k_squared).sqrt();
    let term = |z: T| {
        let sign = if z.re() < 0.0 { -1.0 } else { 1.0 };
        (-(k * z.times(sign))).exp().times(sign)
    };
    let sum = indices(n).fold(T::of(0.0), |sum, j| {
        let [real, image] = heights(c, d, j);
        sum + (term(real) - term(image))
    });
    c.albedo * sum.times(0.5)
}

/// 2π ∫_r^∞ T s ds = Σ α′/2 [z e^(−σtr ρ)/ρ].
pub fn beyond<T: Scalar>(c: &Coefficients<T>, r: f64, d: T, n: u32) -> T {
    let term = |z: T| {
        let rho = (z * z + T::of(r * r)).sqrt();
        z * (-(c.transport2.sqrt() * rho)).exp() / rho
    };
    let sum = indices(n).fold(T::of(0.0), |sum, j| {
        let [real, image] = heights(c, d, j);
        sum + (term(real) - term(image))
    });
    c.albedo * sum.times(0.5)
}
