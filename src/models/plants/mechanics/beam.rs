//! The tapered beam, exactly: deflection u and slope u′ of a clamped circular beam under an evenly spread transverse
//! load.
//!
//! Normalised as H9 §4.4.1: x in [0, 1] from the root to the tip, α = r₂/r₁ the taper (tip radius over root radius),
//! and F/(E′r₁⁴) = 1. The deflection in mm is u times F/(E′r₁⁴) = F L³/(E s₁⁴): F the whole load (N), L the length
//! (mm), E the modulus (N/mm²), s₁ the root radius (mm). The relative error of u and u′ is below 1e-12 for every α from
//! 1e-4 to 1, and up to [`TAPER_MAX`].
//!
//! Limits: the beam is an Euler–Bernoulli beam (no shear, so at least 15 times as long as thick) and linear, so slopes
//! must be well below 1; [`super::length`] says what is done beyond that. H9 Eq. 4.7 prints the prefactor as E′F/r₁⁴;
//! dimensions and the derivation give F/(E′r₁⁴).
//!
//! Let w = 1 + (α−1)x. The bending moment (1−x)²/2 over the area moment π w⁴/4 gives u″ = 2(1−x)²/(π w⁴). Integrated
//! once, with q = (1−x)/w, this is u′ = 2x(1+q+q²)/(3π w), a sum of positive terms. Eq. 4.7 loses every digit as α → 1.
//! So u is computed as the integral of u′ by Gauss–Legendre wherever w ≥ ½ (both limits of α are then regular), and by
//! a logarithm elsewhere.

use super::quadrature::TWELVE;
use std::f64::consts::PI;

/// Largest taper that is accepted: a branch whose tip is a quarter thicker than its root. The sources stop at 1.
pub const TAPER_MAX: f64 = 1.25;
/// Smallest taper for which the accuracy is promised.
pub const TAPER_MIN: f64 = 1e-4;

/// Radius at x over the root's, 1 + (α−1)x, written as a sum of positive terms: at the tip of a thin taper the other
/// form loses digits.
fn width(alpha: f64, x: f64) -> f64 {
    (1.0 - x) + alpha * x
}

/// Slope u′ at `x` in [0, 1]. `alpha` is in (0, [`TAPER_MAX`]]; outside of that range the result is meaningless.
pub fn slope(alpha: f64, x: f64) -> f64 {
    let w = width(alpha, x);
    let q = (1.0 - x) / w;
    2.0 * x * (1.0 + q + q * q) / (3.0 * PI * w)
}

/// Curvature u″ at `x`.
pub fn curvature(alpha: f64, x: f64) -> f64 {
    let w = width(alpha, x);
    let q = (1.0 - x) / w;
    2.0 * q * q / (PI * w * w)
}

/// Deflection u at `x` in [0, 1]. `alpha` in (0, [`TAPER_MAX`]].
pub fn deflection(alpha: f64, x: f64) -> f64 {
    let w = width(alpha, x);
    if w >= 0.5 {
        // The singularity of u′ (w = 0) is at least as far beyond x as 0 is before x, so 12 nodes reach 1e-17.
        return x * TWELVE.iter().map(|(t, g)| g * slope(alpha, x * t)).sum::<f64>();
    }
    logarithmic(alpha, w)
}

/// u as a function of w: the integral of u′ in partial fractions. The terms cancel to 1/40 of the largest at worst (α =
/// w = ½).
fn logarithmic(alpha: f64, w: f64) -> f64 {
    let t = alpha / w;
    let beta = alpha - 1.0;
    let linear = 1.0 - alpha + alpha * alpha / 3.0;
    2.0 / (PI * beta.powi(4)) * (-w.ln() - (t - alpha) + (t - alpha) * (t + alpha) / 6.0 + linear * (w - 1.0))
}

/// Deflection and slope in `f32`, by the formulas of a shader: relative error of u below 2e-6 and of u′ below 1e-6 for
/// every taper from 1e-4 to 1. Eight nodes, and the logarithm only where w < ¼, where it cancels less.
pub fn single(alpha: f32, x: f32) -> (f32, f32) {
    let pi = std::f32::consts::PI;
    let slope = |x: f32| {
        let w = (1.0 - x) + alpha * x;
        let q = (1.0 - x) / w;
        2.0 * x * (1.0 + q + q * q) / (3.0 * pi * w)
    };
    let w = (1.0 - x) + alpha * x;
    if w >= 0.25 {
        let mut sum = 0.0;
        for (t, g) in EIGHT {
            sum += g * slope(x * t);
        }
        return (x * sum, slope(x));
    }
    let t = alpha / w;
    let beta = 1.0 - alpha;
    let linear = 1.0 - alpha + alpha * alpha / 3.0;
    let bracket = -w.ln() - (t - alpha) + (t - alpha) * (t + alpha) / 6.0 - linear * (1.0 - w);
    (2.0 / (pi * (beta * beta) * (beta * beta)) * bracket, slope(x))
}

/// The 8-point Gauss–Legendre rule on (0, 1) (Abramowitz & Stegun table 25.4), as a shader holds it.
const EIGHT: [(f32, f32); 8] = [
    (0.019_855_072, 0.050_614_27),
    (0.101_666_76, 0.111_190_52),
    (0.237_233_8, 0.156_853_32),
    (0.408_282_68, 0.181_341_89),
    (0.591_717_3, 0.181_341_89),
    (0.762_766_2, 0.156_853_32),
    (0.898_333_25, 0.111_190_52),
    (0.980_144_9, 0.050_614_27),
];

#[cfg(test)]
mod tests {
    use super::*;

    /// An untapered beam in closed form: u = (2/π)(x²/2 − x³/3 + x⁴/12).
    #[test]
    fn the_uniform_beam_is_the_textbook_one() {
        for k in 1..=100 {
            let x = f64::from(k) / 100.0;
            let u = 2.0 / PI * (x * x / 2.0 - x.powi(3) / 3.0 + x.powi(4) / 12.0);
            let du = 2.0 / PI * (x - x * x + x.powi(3) / 3.0);
            assert!((deflection(1.0, x) / u - 1.0).abs() < 1e-14 && (slope(1.0, x) / du - 1.0).abs() < 1e-14);
        }
        // w_tip = F L³/(8 E I) for a whole load F.
        assert!((deflection(1.0, 1.0) - 1.0 / (2.0 * PI)).abs() < 1e-15);
    }

    #[test]
    fn slope_and_curvature_are_derivatives() {
        for alpha in [1e-3, 0.05, 0.3, 0.9, 1.0, 1.2] {
            for x in [0.05, 0.4, 0.77, 0.9] {
                let h = 1e-5;
                let du = (deflection(alpha, x + h) - deflection(alpha, x - h)) / (2.0 * h);
                let ddu = (slope(alpha, x + h) - slope(alpha, x - h)) / (2.0 * h);
                assert!((du / slope(alpha, x) - 1.0).abs() < 1e-6, "{alpha} {x}");
                assert!((ddu / curvature(alpha, x) - 1.0).abs() < 1e-6, "{alpha} {x}");
            }
        }
    }

    #[test]
    fn single_precision_keeps_its_promise() {
        let mut worst = [0.0f64; 2];
        for i in 0..=400 {
            let alpha = (1e-4f64.ln() * f64::from(i) / 400.0).exp() as f32;
            for k in 1..=200 {
                // Even steps, and steps that become shorter towards the tip.
                for x in [k as f32 / 200.0, 1.0 - (1e-5f32.ln() * k as f32 / 200.0).exp()] {
                    let (u, du) = single(alpha, x);
                    let (alpha, x) = (f64::from(alpha), f64::from(x));
                    worst[0] = worst[0].max((f64::from(u) / deflection(alpha, x) - 1.0).abs());
                    worst[1] = worst[1].max((f64::from(du) / slope(alpha, x) - 1.0).abs());
                }
            }
        }
        println!("f32: worst relative error of u {:.2e}, of u' {:.2e}", worst[0], worst[1]);
        assert!(worst[0] < 2e-6 && worst[1] < 1e-6, "{worst:?}");
    }

    #[test]
    fn ends() {
        for alpha in [1e-4, 0.1, 1.0] {
            assert_eq!((deflection(alpha, 0.0), slope(alpha, 0.0)), (0.0, 0.0));
            assert!((curvature(alpha, 0.0) - 2.0 / PI).abs() < 1e-15);
            assert_eq!(curvature(alpha, 1.0), 0.0);
        }
    }
}
