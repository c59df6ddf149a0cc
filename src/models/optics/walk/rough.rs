//! A rough dielectric face: Beckmann slopes, Fresnel's reflectance, light followed from facet to facet until it leaves
//! the surface.
//!
//! Smith's uncorrelated microsurface as a random walk (Heitz et al. 2016, *Multiple-scattering microfacet BSDFs with
//! the Smith model*) with uniform heights. Every ray leaves somewhere with weight 1, so the face neither loses nor
//! creates energy, and both directions agree. Facets are drawn as the ray sees them. Slope 0 is a smooth pane.
//! Directions are along the light's travel; +z is out of the medium.

use super::phase::{Direction, dot};
use super::tally::uniform;
use crate::gloss::fresnel;
use mesophyll_base::error::{Error, Result};
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// A rough dielectric surface. Its slope is the square root of twice the mean square slope along one axis (`m` of
/// [`crate::gloss`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoughSurface {
    /// Refractive index of the medium over that outside.
    pub index: f64,
    /// Slope m of the facets; 0 is a smooth pane.
    pub slope: f64,
}

/// Largest number of facets that a ray may meet at one crossing; after that it is given up.
const FACETS: u32 = 100_000;

impl RoughSurface {
    pub(super) fn check(&self) -> Result<()> {
        if !(self.index >= 1.0 && self.index < 10.0) {
            return Err(Error::Usage(format!("random walk: the refractive index is {}, expected 1 to 10", self.index)));
        }
        if !(0.0..=2.0).contains(&self.slope) {
            return Err(Error::Usage(format!("random walk: the facets' slope is {}, expected 0 to 2", self.slope)));
        }
        Ok(())
    }

    /// The direction in which a ray that arrives along `d` (z < 0: from outside, z > 0: from within) leaves: z > 0 is
    /// outside, z < 0 inside. `None` where it is given up.
    pub fn scatter(&self, d: Direction, rng: &mut Pcg64) -> Option<Direction> {
        // Rays inside are treated in coordinates mirrored at the origin, in which the surface looks as it does from
        // outside.
        let mut outside = d[2] < 0.0;
        let mut w = if outside { d } else { [-d[0], -d[1], -d[2]] };
        // Cumulative distribution of the height, at the ray: 1 at the top, 0 at the bottom.
        let mut c = 1.0;
        for _ in 0..FACETS {
            c = match self.next(w, c, rng) {
                Some(c) => c,
                None => return Some(if outside { w } else { [-w[0], -w[1], -w[2]] }),
            };
            let towards = [-w[0], -w[1], -w[2]];
            let facet = self.facet(towards, rng);
            let cos = dot(towards, facet).clamp(0.0, 1.0);
            let ratio = if outside { self.index } else { 1.0 / self.index };
            if uniform(rng) <= fresnel(cos, ratio) {
                w = std::array::from_fn(|k| 2.0 * cos * facet[k] - towards[k]);
            } else {
                let along = cos / ratio - (1.0 - (1.0 - cos * cos) / (ratio * ratio)).max(0.0).sqrt();
                w = std::array::from_fn(|k| towards[k] / ratio - along * facet[k]);
                (outside, c) = (!outside, 1.0 - c);
            }
            let length = dot(w, w).sqrt();
            w = w.map(|x| x / length);
        }
        None
    }

    /// Cumulative height of the next facet on the way along `w`; None where the ray leaves the surface.
    fn next(&self, w: Direction, c: f64, rng: &mut Pcg64) -> Option<f64> {
        let lambda = self.lambda(w);
        let u = uniform(rng);
        if w[2] > 0.0 && u <= c.powf(lambda) {
            return None;
        }
        Some(if lambda.is_finite() { (c * u.powf(-1.0 / lambda)).clamp(0.0, 1.0) } else { c })
    }

    /// Smith's Λ for Beckmann slopes; −1 − Λ(−w) downwards.
    fn lambda(&self, w: Direction) -> f64 {
        let sin = (w[0] * w[0] + w[1] * w[1]).sqrt();
        let a = w[2].abs() / (self.slope * sin);
        let upward = if !(a < 6.0) {
            0.0 // below 1e-17; also a smooth pane and the vertical
        } else if a == 0.0 {
            f64::INFINITY
        } else {
            0.5 * ((-a * a).exp() / (a * PI.sqrt()) - erfc(a)).max(0.0)
        };
        if w[2] > 0.0 { upward } else { -1.0 - upward }
    }

    /// Normal of a facet that the direction `v` (from the facet to where the ray comes from) sees, with a density ∝ D
    /// cosα max(0, v·h)/cosα.
    ///
    /// With the slope t towards the azimuth of v, v·h/cosα = v_z + sinθ t, where t is Gaussian. It is drawn exactly, by
    /// rejection.
    fn facet(&self, v: Direction, rng: &mut Pcg64) -> Direction {
        let (m, sin, cos) = (self.slope, (v[0] * v[0] + v[1] * v[1]).sqrt(), v[2]);
        if m == 0.0 {
            return [0.0, 0.0, 1.0];
        }
        let gaussian = |rng: &mut Pcg64| m * (-uniform(rng).ln()).sqrt() * (2.0 * PI * uniform(rng)).cos();
        let t = loop {
            if cos < 0.0 {
                let t0 = -cos / sin;
                let t = (t0 * t0 - m * m * uniform(rng).ln()).sqrt();
                if uniform(rng) <= 1.0 - t0 / t {
                    break t;
                }
                continue;
            }
            let (flat, rising) = (cos * m * PI.sqrt(), 0.5 * sin * m * m);
            if uniform(rng) * (flat + rising) > flat {
                break m * (-uniform(rng).ln()).sqrt();
            }
            let t = gaussian(rng);
            if t >= 0.0 || uniform(rng) * cos <= cos + sin * t {
                break t;
            }
        };
        let q = gaussian(rng);
        let (x, y) = if sin > 0.0 { (v[0] / sin, v[1] / sin) } else { (1.0, 0.0) };
        let scale = 1.0 / (1.0 + t * t + q * q).sqrt();
        [(t * x - q * y) * scale, (t * y + q * x) * scale, scale]
    }
}

/// 1 − erf(x), 0 ≤ x: the series of Abramowitz & Stegun 7.1.6 below 2, their continued fraction 7.1.14 above.
fn erfc(x: f64) -> f64 {
    if x < 2.0 {
        let (mut term, mut sum) = (x, x);
        for n in 1..60 {
            term *= 2.0 * x * x / (2 * n + 1) as f64;
            sum += term;
        }
        return 1.0 - 2.0 / PI.sqrt() * (-x * x).exp() * sum;
    }
    let tail = (1..=60).rev().fold(x, |tail, n| x + 0.5 * n as f64 / tail);
    (-x * x).exp() / (PI.sqrt() * tail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab::quadrature::gauss;
    use rand::SeedableRng;

    #[test]
    fn erfc_known_values() {
        for (x, want) in [
            (0.5, 0.4795001221869535),
            (1.0, 0.15729920705028513),
            (2.0, 0.004677734981047266),
            (4.0, 1.541725790028002e-8),
        ] {
            assert!((erfc(x) / want - 1.0).abs() < 1e-12, "{x}: {}", erfc(x));
        }
    }

    #[test]
    fn a_smooth_pane_refracts_and_reflects_as_fresnel_and_snell_say() {
        let pane = RoughSurface { index: 1.4, slope: 0.0 };
        let mut rng = Pcg64::seed_from_u64(1);
        for (z, ratio) in [(-0.6f64, 1.4), (0.8, 1.0 / 1.4), (0.5, 1.0 / 1.4)] {
            let sin = (1.0 - z * z).sqrt();
            let n = 40_000;
            let mut back = 0;
            for _ in 0..n {
                let o = pane.scatter([sin, 0.0, z], &mut rng).unwrap();
                if o[2] * z < 0.0 {
                    back += 1;
                    assert!((o[2] + z).abs() < 1e-12 && (o[0] - sin).abs() < 1e-12);
                } else {
                    assert!((o[0] * ratio - sin).abs() < 1e-12, "{o:?}");
                }
            }
            let f = fresnel(z.abs(), ratio);
            let sigma = (f * (1.0 - f) / n as f64).sqrt();
            assert!((back as f64 / n as f64 - f).abs() <= 4.0 * sigma, "{z}: {} {f}", back as f64 / n as f64);
        }
    }

    /// First facets seen from above have density D(h) max(0, v·h)/(cosθ (1 + Λ)): moments by quadrature over slopes.
    #[test]
    fn visible_facets_have_the_slopes_they_should() {
        let mut rng = Pcg64::seed_from_u64(2);
        for (m, cos) in [(0.3f64, 0.9f64), (0.5, 0.3), (0.8, 0.05), (0.4, -0.2)] {
            let face = RoughSurface { index: 1.4, slope: m };
            let sin = (1.0 - cos * cos).sqrt();
            // the slope towards the viewer; the one across is independent
            let (mut area, mut first, mut second) = (0.0, 0.0, 0.0);
            let steps = 40_000;
            for k in 0..steps {
                let t = m * 8.0 * (2.0 * (k as f64 + 0.5) / steps as f64 - 1.0);
                let seen = (cos + sin * t).max(0.0) * (-t * t / (m * m)).exp();
                area += seen;
                first += seen * t;
                second += seen * t * t;
            }
            let (mean, square) = (first / area, second / area);
            let n = 40_000;
            let (mut s, mut s2, mut across) = (0.0, 0.0, 0.0);
            for _ in 0..n {
                let h = face.facet([sin, 0.0, cos], &mut rng);
                let t = h[0] / h[2];
                s += t;
                s2 += t * t;
                across += (h[1] / h[2]).powi(2);
            }
            let n = n as f64;
            let sigma = ((square - mean * mean) / n).sqrt();
            assert!((s / n - mean).abs() < 4.0 * sigma, "m {m} cos {cos}: {} {mean} ± {sigma}", s / n);
            // The spread of the squares themselves is about √2 of their mean.
            assert!(
                (s2 / n / square - 1.0).abs() < 4.0 * 1.5 / n.sqrt()
                    && (across / n / (0.5 * m * m) - 1.0).abs() < 4.0 * 1.5 / n.sqrt()
            );
        }
    }

    /// Light in thermal balance: a Lambertian flux from both sides, n² times as strong inside, leaves as it came
    /// (reciprocity and energy).
    #[test]
    fn a_rough_face_passes_the_same_flux_both_ways() {
        let mut rng = Pcg64::seed_from_u64(3);
        for slope in [0.0, 0.2, 0.7] {
            let face = RoughSurface { index: 1.33, slope };
            let n = 60_000;
            let mut through = [0.0; 2];
            for _ in 0..n {
                let d = super::super::phase::lambert(&mut rng);
                through[0] += f64::from(u8::from(face.scatter([d[0], d[1], -d[2]], &mut rng).unwrap()[2] < 0.0));
                through[1] += f64::from(u8::from(face.scatter(d, &mut rng).unwrap()[2] > 0.0));
            }
            let (into, out) = (through[0] / n as f64, through[1] / n as f64);
            let sigma = ((into * (1.0 - into) + out * (1.0 - out) * 1.33f64.powi(4)) / n as f64).sqrt();
            assert!(
                (into - 1.33 * 1.33 * out).abs() < 4.0 * sigma,
                "slope {slope}: {into} {} ± {sigma}",
                1.33 * 1.33 * out
            );
            if slope == 0.0 {
                let want: f64 = gauss(64).iter().map(|q| 2.0 * q.x * q.w * fresnel(q.x, 1.33)).sum();
                assert!((1.0 - into - want).abs() < 4.0 * (want / n as f64).sqrt(), "{} {want}", 1.0 - into);
            }
        }
    }
}
