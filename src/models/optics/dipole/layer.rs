//! A layer between two extrapolated boundaries, solved exactly: its spectra in closed form, and the modes that dominate
//! far from the source.
//!
//! Both forms solve D φ″ − (σa + D k²) φ = −Q with φ = 0 at z = −z_b and z = d + z_b (symbols as in [`super`]). So
//! their spectra are even, meromorphic functions of K = √(σtr² + k²) with poles only at K = ±iβ_m, β_m = mπ/H, H = d +
//! 2 z_b.
//! *Images* has a point source α′ at z = l, and −D φ′(d) leaves: the sum of infinitely many dipoles.
//! *Thin* has the beam's own first scatterings Q = σs′ e^(−σt′ z) as source, and φ(d)/(2A) leaves; unscattered light
//! passes separately.

use super::Coefficients;
use super::bessel;
use super::scalar::{Scalar, TissueDual, falling, rising};
use crate::slab::quadrature::{QuadratureNode, gauss};
use std::sync::OnceLock;

/// T̂(k) of the infinite image sum; valid for d > l only.
pub fn images<T: Scalar>(c: &Coefficients<T>, k_squared: T, d: T) -> T {
    let (l, zb) = (c.free_path, c.extrapolation);
    let height = d + zb.times(2.0);
    let k2 = c.transport2 + k_squared;
    if (k2 * height * height).size() < 0.25 {
        // α′ sinh(K(l+z_b)) cosh(K z_b)/sinh(KH) as functions of K²
        let cosh = T::of(1.0)
            + k2 * (zb * rising((k2 * zb * zb).times(0.25))) * (zb * rising((k2 * zb * zb).times(0.25))).times(0.5);
        let near = l + zb;
        return c.albedo * near * rising(k2 * near * near) * cosh / (height * rising(k2 * height * height));
    }
    let k = k2.sqrt();
    let near = l + zb;
    c.albedo
        * near
        * falling((k * near).times(2.0))
        * (-(k * (d - l))).exp()
        * (T::of(1.0) + (-(k * zb).times(2.0)).exp()).times(0.5)
        / (height * falling((k * height).times(2.0)))
}

/// T̂(k) of the thin form's scattered light.
pub fn thin<T: Scalar>(c: &Coefficients<T>, k_squared: T, d: T) -> T {
    let (sigma, zb) = (c.extinction, c.extrapolation);
    let height = d + zb.times(2.0);
    let k2 = c.transport2 + k_squared;
    if (k2 * height * height).size() < 0.25 {
        // σs′ sinh(K z_b)/(z_b sinh KH) ∫ e^(−σz) sinh(K(z+z_b)) dz as functions of K²
        let lifted = |z: T| {
            let z = z + zb;
            z * rising(k2 * z * z)
        };
        return c.scattering * rising(k2 * zb * zb) * weighted(sigma, d, lifted)
            / (height * rising(k2 * height * height));
    }
    let k = k2.sqrt();
    // I₁ = ∫₀^d e^(−σz − K(d−z)) dz, I₂ = ∫₀^d e^(−σz − K(d+z)) dz
    let i2 = d * (-(k * d)).exp() * falling((k + sigma) * d);
    let split = if (k * d).size() < 0.5 {
        // (I₁ − I₂)/K, in a form that does not cancel.
        (-(k * d)).exp() * weighted(sigma, d, |z| z * rising(k2 * z * z)).times(2.0)
    } else {
        let i1 = if k.re() >= sigma.re() {
            d * (-(sigma * d)).exp() * falling((k - sigma) * d)
        } else {
            d * (-(k * d)).exp() * falling((sigma - k) * d)
        };
        (i1 - i2) / k
    };
    let edge = falling((k * zb).times(2.0));
    c.scattering * edge * (split + (zb * edge * i2).times(2.0)) / (height * falling((k * height).times(2.0))).times(2.0)
}

/// ∫₀^d e^(−σz) f(z) dz for a smooth f and any σd.
fn weighted<T: Scalar>(sigma: T, d: T, f: impl Fn(T) -> T) -> T {
    static RULE: OnceLock<Vec<QuadratureNode>> = OnceLock::new();
    let rule = RULE.get_or_init(|| gauss(32));
    let length = if (sigma * d).re() > 40.0 { T::of(40.0) / sigma } else { d };
    let sum = rule.iter().fold(T::of(0.0), |sum, q| {
        let z = length.times(q.x);
        sum + (f(z) * (-(sigma * z)).exp()).times(q.w)
    });
    length * sum
}

/// Which layer a mode belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DipoleLayer {
    Images,
    Thin,
}

/// A number for which K₀ and K₁ can be computed.
pub trait BesselNumber: Scalar {
    /// K₀ and K₁ of a positive number.
    fn bessel(self) -> [Self; 2];
}

impl BesselNumber for f64 {
    fn bessel(self) -> [f64; 2] {
        bessel::k01_real(self)
    }
}

impl BesselNumber for TissueDual<f64> {
    fn bessel(self) -> [Self; 2] {
        let [k0, k1] = bessel::k01_real(self.value);
        [self.function(k0, -k1), self.function(k1, -k0 - k1 / self.value)]
    }
}

/// T(r) and 2π ∫_r^∞ T s ds as sums over the modes: Σ R_m K₀(κ_m r)/(2π) and Σ R_m r K₁(κ_m r)/κ_m, with κ_m = √(σtr² +
/// β_m²) and r > 0. The number of modes needed grows as H/r.
pub(crate) fn modes<T: BesselNumber>(c: &Coefficients<T>, layer: DipoleLayer, r: f64, d: T) -> [T; 2] {
    let zb = c.extrapolation;
    let height = d + zb.times(2.0);
    let mut sums = [T::of(0.0); 2];
    let mut first = 0.0;
    for m in 1..100_000 {
        let beta = T::of(f64::from(m) * std::f64::consts::PI) / height;
        let kappa = (c.transport2 + beta * beta).sqrt();
        if m == 1 {
            first = kappa.re();
        } else if (kappa.re() - first) * r > 42.0 {
            break;
        }
        let sign = if m % 2 == 0 { 1.0 } else { -1.0 };
        let at = beta * zb;
        let residue = match layer {
            DipoleLayer::Images => {
                -(c.albedo * beta * at.cos() * (beta * (c.free_path + zb)).sin()).times(2.0 * sign) / height
            }
            DipoleLayer::Thin => {
                let s = c.extinction;
                let (far, near) = ((beta * at.cos() - s * at.sin()).times(sign), beta * at.cos() + s * at.sin());
                let source = c.scattering * (near - (-(s * d)).exp() * far) / (s * s + beta * beta);
                -(source * at.sin()).times(2.0 * sign) / (height * zb)
            }
        };
        let [k0, k1] = kappa.times(r).bessel();
        sums[0] = sums[0] + (residue * k0).times(0.5 / std::f64::consts::PI);
        sums[1] = sums[1] + (residue * k1).times(r) / kappa;
    }
    sums
}
