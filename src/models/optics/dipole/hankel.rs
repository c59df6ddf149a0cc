//! Computes T(r), the light that leaves at distance r, from its spectrum T̂(k): T(r) = 1/(2π) ∫₀^∞ k T̂(k) J₀(kr) dk.
//! The contour of the integral is chosen so that nothing oscillates and nothing cancels.
//!
//! J₀ = Re H₀⁽¹⁾, and T̂ has poles only on the imaginary axis, from iκ₁ upward. Below the first pole the integrand is
//! imaginary on that axis, so the contour may start at ik₀ with any k₀ < κ₁ and run off to the right: k = c sinh(u +
//! iπ/4), where H₀⁽¹⁾ falls exponentially. k₀ is put at the saddle of e^(ikr − Kd), as far as the first pole allows, so
//! that even the tiny T of a thick slab keeps its relative digits. The trapezoid rule in u converges exponentially,
//! because the strip of analyticity is π/4 wide on both sides. The spectrum enters linearly, so derivatives by the
//! tissue's parameters use the same nodes.

use super::bessel;
use mesophyll_base::fourier::Complex;
use std::f64::consts::{FRAC_PI_4, PI};

/// One node of the contour: T(r) = Σ Re(for_t T̂(k)), 2π ∫_r^∞ T s ds = Σ Re(for_beyond T̂(k)).
#[derive(Debug, Clone, Copy)]
pub struct HankelNode {
    /// k², the argument of the spectra.
    pub k_squared: Complex<f64>,
    pub for_t: Complex<f64>,
    pub for_beyond: Complex<f64>,
}

/// Nodes for radius `r` > 0 of a layer of thickness `d` with first pole iκ₁. `first_pole` is a lower bound of κ₁ > 0.
/// `depth` is the distance over which the spectrum itself falls like e^(−K depth); 0 if it does not.
pub fn contour(r: f64, d: f64, first_pole: f64, depth: f64) -> Vec<HankelNode> {
    let share = (r / r.hypot(d)).clamp(0.2, 0.8);
    // The step is limited by the strip of analyticity, and by the growth of a thick layer's spectrum towards the poles.
    let step = if share > 0.7 { 0.06 } else { 0.12 } / (1.0 + first_pole * d / 15.0);
    let start = share * first_pole;
    let scale = start / FRAC_PI_4.sin();
    // The contour ends where nothing is left of e^(ikr), with Im k = start cosh u, or of e^(−K depth) relative to its
    // size at the start, with Re K ≥ Re k = start sinh u.
    let reach = (1.0 + 44.0 / (start * r)).acosh().min(((50.0 + first_pole * d) / (start * depth)).asinh());
    let count = (reach / step).ceil() as usize;
    (0..=count)
        .map(|j| {
            let u = Complex::new(step * j as f64, FRAC_PI_4);
            let (k, slope) = (scale * u.sinh(), scale * u.cosh());
            let weight = slope * if j == 0 { 0.5 * step } else { step };
            let [k0, k1] = bessel::k01(Complex::new(k.im * r, -k.re * r));
            // H₀⁽¹⁾(kr) = (2/πi) K₀(−ikr), H₁⁽¹⁾(kr) = −(2/π) K₁(−ikr)
            let for_t = Complex::new(0.0, -1.0) * k * k0 * weight / (PI * PI);
            let for_beyond = k1 * weight * (2.0 * r / PI);
            HankelNode { k_squared: k * k, for_t, for_beyond }
        })
        .collect()
}
