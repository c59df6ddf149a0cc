//! What a surface receives from a sky given as harmonics: irradiance on a normal (Ramamoorthi and Hanrahan 2001), and
//! light from the ground.
//!
//! Radiance in kcd/m² gives illuminance in klx.

use super::harmonics::{HarmonicBasis, HarmonicCoefficients};
use std::f64::consts::PI;

/// A_l = 2π ∫₀¹ μ P_l(μ) dμ, the cosine lobe's weight of band l: π, 2π/3, π/4, 0, −π/24, 0, … (Ramamoorthi and Hanrahan
/// 2001, Eq. 8).
pub fn cosine_lobe(l: usize) -> f64 {
    match l {
        0 => PI,
        1 => 2.0 * PI / 3.0,
        l if l % 2 == 1 => 0.0,
        l => {
            // l!/(2^l ((l/2)!)²) = ∏ (2k−1)/(2k)
            let central: f64 = (1..=l / 2).map(|k| (2 * k - 1) as f64 / (2 * k) as f64).product();
            let sign = if l % 4 == 2 { 1.0 } else { -1.0 };
            2.0 * PI * sign * central / ((l + 2) as f64 * (l - 1) as f64)
        }
    }
}

/// Irradiance coefficients: band l times A_l. Their sum in a direction is the irradiance on the surface with that
/// normal.
pub fn convolved(c: &HarmonicCoefficients) -> HarmonicCoefficients {
    let mut out = c.clone();
    for l in 0..c.bands() {
        let a = cosine_lobe(l);
        out.values_mut()[l * l..(l + 1) * (l + 1)].iter_mut().for_each(|v| *v = v.map(|x| a * x));
    }
    out
}

/// Irradiance on a surface with unit normal `n`; under an even sky all around it is π times the radiance. Negative sums
/// (from ringing) are kept. For many normals, keep [`convolved`] and a [`HarmonicBasis`].
pub fn irradiance(c: &HarmonicCoefficients, n: [f64; 3]) -> [f64; 3] {
    HarmonicBasis::new(c.bands().max(1)).sum(&convolved(c), n)
}

/// Irradiance of the *whole* upper hemisphere on level ground. For unfiltered coefficients of a function that is zero
/// below the horizon, it is exact with any number of bands from 2 on, because cosθ is Y_10 times a constant.
pub fn on_level_ground(c: &HarmonicCoefficients) -> [f64; 3] {
    c.get(1, 0).map(|v| v * (4.0 * PI / 3.0).sqrt())
}

/// ∫ Y_l0 over the lower hemisphere: the coefficients of a function that is 1 below the horizon and 0 above.
pub fn below_horizon(l: usize) -> f64 {
    // ∫₋₁⁰ P_l = (P_{l+1}(0) − P_{l−1}(0))/(2l+1)
    let at_zero = |l: usize| match l % 2 {
        1 => 0.0,
        _ => (1..=l / 2).map(|k| -((2 * k - 1) as f64) / (2 * k) as f64).product::<f64>(),
    };
    let integral = if l == 0 { 1.0 } else { (at_zero(l + 1) - at_zero(l - 1)) / (2 * l + 1) as f64 };
    2.0 * PI * ((2 * l + 1) as f64 / (4.0 * PI)).sqrt() * integral
}

/// Adds level, matte ground to a sky: below the horizon the radiance is `albedo` (a channel each, 0 to 1) × the
/// irradiance on the ground/π. The irradiance is that of the sky ([`on_level_ground`]) plus `extra` (the sun's, in
/// klx). Call it before any window.
pub fn add_ground(c: &HarmonicCoefficients, albedo: [f64; 3], extra: [f64; 3]) -> HarmonicCoefficients {
    let sky = on_level_ground(c);
    let ground: [f64; 3] = std::array::from_fn(|k| albedo[k] * (sky[k] + extra[k]) / PI);
    let mut out = c.clone();
    for l in 0..c.bands() {
        let part = below_horizon(l);
        (0..3).for_each(|k| out.values_mut()[l * (l + 1)][k] += ground[k] * part);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::projection::direct;
    use crate::quadrature::gauss;
    use crate::{Preetham, Sky};

    /// ∫ L(d) max(0, n·d) over a product rule, for any function L.
    fn numeric(n: [f64; 3], radiance: impl Fn([f64; 3]) -> [f64; 3], nodes: usize) -> [f64; 3] {
        let mut sum = [0.0; 3];
        // The rule's pole is the normal, so that the edge of max(0, ·) lies between nodes.
        let up = if n[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let unit = |a: [f64; 3]| a.map(|v| v / (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt());
        let t = unit(cross(up, n));
        let b = cross(n, t);
        for &(x, w) in gauss(nodes).iter() {
            let mu = 0.5 * (1.0 + x);
            let s = (1.0 - mu * mu).sqrt();
            for k in 0..2 * nodes {
                let phi = PI * (k as f64 + 0.5) / nodes as f64;
                let d = std::array::from_fn(|i| s * phi.cos() * t[i] + s * phi.sin() * b[i] + mu * n[i]);
                let l = radiance(d);
                (0..3).for_each(|c| sum[c] += 0.5 * w * PI / nodes as f64 * mu * l[c]);
            }
        }
        sum
    }

    #[test]
    fn the_lobe_is_its_integral() {
        for l in 0..12 {
            let got: f64 = gauss(40)
                .iter()
                .map(|&(x, w)| {
                    let mu = 0.5 * (1.0 + x);
                    let (mut p, mut before) = (1.0, 0.0);
                    for k in 1..=l {
                        (p, before) = (((2 * k - 1) as f64 * mu * p - (k - 1) as f64 * before) / k as f64, p);
                    }
                    PI * w * mu * p
                })
                .sum();
            assert!((got - cosine_lobe(l)).abs() < 1e-13, "l {l}: {got} {}", cosine_lobe(l));
        }
    }

    /// The convolution is exact for a function of seven bands.
    #[test]
    fn irradiance_of_a_band_limited_sky_is_its_integral() {
        let c = direct(&Preetham.at(0.9, 3.0).unwrap(), 7);
        let basis = HarmonicBasis::new(7);
        for n in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -0.6, -0.8], [-1.0, 0.0, 0.0]] {
            let (got, want) = (irradiance(&c, n), numeric(n, |d| basis.sum(&c, d), 24));
            for k in 0..3 {
                assert!((got[k] - want[k]).abs() < 1e-11 * c.get(0, 0)[k], "{n:?}: {got:?} {want:?}");
            }
        }
    }

    /// Compares with the sky itself: exactly on level ground, and to the error of seven bands (under 2 %) on tilted
    /// surfaces.
    #[test]
    fn irradiance_of_the_true_sky() {
        let sky = Preetham.at(0.7, 2.5).unwrap();
        let c = direct(&sky, 7);
        let true_sky = |d: [f64; 3]| if d[2] > 0.0 { sky.rgb(d) } else { [0.0; 3] };
        let level = numeric([0.0, 0.0, 1.0], true_sky, 120);
        let exact = on_level_ground(&c);
        for k in 0..3 {
            assert!((exact[k] / level[k] - 1.0).abs() < 1e-4, "{exact:?} {level:?}");
        }
        for n in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.8, 0.0, 0.6], [0.0, 0.6, 0.8]] {
            let (got, want) = (irradiance(&c, n), numeric(n, true_sky, 120));
            for k in 0..3 {
                assert!((got[k] / want[k] - 1.0).abs() < 0.02, "{n:?}: {got:?} {want:?}");
            }
        }
    }

    /// A floating leaf that faces down sees the ground: E = π L_ground, here over albedo × the sky's own irradiance.
    #[test]
    fn the_ground_lights_what_faces_down() {
        let c = direct(&Preetham.at(0.7, 3.0).unwrap(), 16);
        let lit = add_ground(&c, [0.2, 0.3, 0.4], [0.0, 1.0, 0.0]);
        let sky = on_level_ground(&c);
        let want = [0.2 * sky[0], 0.3 * (sky[1] + 1.0), 0.4 * sky[2]];
        // On a surface that faces down, the sky's own share is the ringing of its bands; it is subtracted to see that
        // of the ground.
        let (got, ring) = (irradiance(&lit, [0.0, 0.0, -1.0]), irradiance(&c, [0.0, 0.0, -1.0]));
        for k in 0..3 {
            assert!(((got[k] - ring[k]) / want[k] - 1.0).abs() < 2e-3, "{k}: {got:?} {ring:?} {want:?}");
        }
        // Sky and ground of the same radiance together are an even sphere.
        let mut half = HarmonicCoefficients::zero(6);
        for l in 0..6usize {
            let sign = if l % 2 == 0 { 1.0 } else { -1.0 };
            half.values_mut()[l * (l + 1)] = [sign * below_horizon(l); 3];
        }
        let whole = add_ground(&half, [1.0; 3], [0.0; 3]);
        assert!((whole.get(0, 0)[0] - (4.0 * PI).sqrt()).abs() < 1e-13);
        assert!((1..6).all(|l| whole.get(l, 0)[0].abs() < 1e-13), "{whole:?}");
    }
}
