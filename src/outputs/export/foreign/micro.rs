//! The microfacet lobes of other programs: D·G/(4 cosθi cosθo), without the Fresnel factor.
//!
//! Sources: Walter et al. 2007 (Beckmann with its rational fit of G1, Eq. 27; GGX, Eq. 33 and 34); Heitz 2014 (masking
//! and shadowing correlated by height); Mitsuba 3 `microfacet.h`; glTF 2.0, Appendix B; pbrt-v4 `util/scattering.h`.

use mesophyll_base::surface::gloss::{Lobe, dot};

/// The distribution of the facets' slopes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlopeDistribution {
    /// Gaussian slopes.
    Beckmann,
    /// Trowbridge and Reitz.
    Ggx,
}

impl SlopeDistribution {
    /// The distribution of a lobe of ours. Other programs have no further ones.
    pub fn of(lobe: Lobe) -> SlopeDistribution {
        if lobe.is_long_tailed() { SlopeDistribution::Ggx } else { SlopeDistribution::Beckmann }
    }

    /// The name that other programs have for it, in small letters.
    pub fn name(self) -> &'static str {
        match self {
            SlopeDistribution::Beckmann => "beckmann",
            SlopeDistribution::Ggx => "ggx",
        }
    }

    /// Our lobe with this distribution.
    pub fn lobe(self) -> Lobe {
        match self {
            SlopeDistribution::Beckmann => Lobe::Beckmann,
            SlopeDistribution::Ggx => Lobe::Ggx,
        }
    }
}

/// How masking and shadowing are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaskingRule {
    /// G = G1(i)·G1(o).
    Separable,
    /// G = 1/(1 + Λi + Λo).
    Correlated,
}

/// A lobe without its roughness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MicrofacetLobe {
    /// Distribution of slopes.
    pub slopes: SlopeDistribution,
    /// Masking and shadowing.
    pub masking: MaskingRule,
}

impl MicrofacetLobe {
    /// D·G/(4 cosθi cosθo) (1/sr) for directions above the surface, z the normal; 0 for others. `alpha` is the slope.
    pub fn value(self, v: [f64; 3], l: [f64; 3], alpha: f64) -> f64 {
        if v[2] <= 0.0 || l[2] <= 0.0 {
            return 0.0;
        }
        let h = half(v, l);
        let tan2 = (1.0 - h[2] * h[2]).max(0.0) / (h[2] * h[2]);
        self.slopes.lobe().distribution(tan2, alpha) * self.masked(v[2], l[2], alpha) / (4.0 * v[2] * l[2])
    }

    fn masked(self, cos_v: f64, cos_l: f64, alpha: f64) -> f64 {
        let tan2 = |c: f64| (1.0 - c * c).max(0.0) / (c * c);
        // Λ = 1/G1 − 1; of Beckmann's G1 by the rational fit.
        let lambda = |c: f64| match self.slopes {
            SlopeDistribution::Beckmann => {
                let a = 1.0 / (alpha * tan2(c).sqrt()).max(1e-12);
                if a >= 1.6 { 0.0 } else { (1.0 + a * (2.276 + 2.577 * a)) / (a * (3.535 + 2.181 * a)) - 1.0 }
            }
            SlopeDistribution::Ggx => 0.5 * ((1.0 + alpha * alpha * tan2(c)).sqrt() - 1.0),
        };
        let (a, b) = (lambda(cos_v), lambda(cos_l));
        match self.masking {
            MaskingRule::Separable => 1.0 / ((1.0 + a) * (1.0 + b)),
            MaskingRule::Correlated => 1.0 / (1.0 + a + b),
        }
    }
}

/// The unit vector half way between two directions.
pub fn half(v: [f64; 3], l: [f64; 3]) -> [f64; 3] {
    let h = [v[0] + l[0], v[1] + l[1], v[2] + l[2]];
    let length = dot(h, h).sqrt();
    if length > 1e-12 { h.map(|x| x / length) } else { [0.0, 0.0, 1.0] }
}

/// Fresnel reflectance of a conductor with index 1 + i·k in air for unpolarised light at this cosine. pbrt-v4 makes
/// a conductor of a reflectance r by k = 2 √r/√(1 − r).
pub fn conductor(cos: f64, k: f64) -> f64 {
    // The general formula (Born and Wolf) with η = 1.
    let (c2, k2) = (cos * cos, k * k);
    let s2 = 1.0 - c2;
    let t0 = 1.0 - k2 - s2;
    let a2b2 = (t0 * t0 + 4.0 * k2).sqrt();
    let a = (0.5 * (a2b2 + t0)).max(0.0).sqrt();
    let (t1, t2) = (a2b2 + c2, 2.0 * a * cos);
    let rs = (t1 - t2) / (t1 + t2);
    let (t3, t4) = (c2 * a2b2 + s2 * s2, t2 * s2);
    0.5 * rs * (1.0 + (t3 - t4) / (t3 + t4))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foreign::nodes::DirectionPairs;

    /// The visible facets' projected area is the surface's (Heitz 2014, Eq. 14): ∫ G1 D (v·h) dω_h = cosθ_v for GGX,
    /// whose G1 is exact, and within the rational fit's .4 % for Beckmann.
    #[test]
    fn masking_keeps_the_projected_area() {
        for (slopes, tolerance) in [(SlopeDistribution::Ggx, 2e-3), (SlopeDistribution::Beckmann, 6e-3)] {
            let micro = MicrofacetLobe { slopes, masking: MaskingRule::Separable };
            let lobe = slopes.lobe();
            for (cos, alpha) in [(0.9f64, 0.3), (0.4, 0.5)] {
                let v = [(1.0 - cos * cos).sqrt(), 0.0, cos];
                // G1 alone is the masking against a light straight above, whose own G1 is 1.
                let g1 = micro.masked(cos, 1.0, alpha);
                let (n, mut sum) = (400, 0.0);
                for i in 0..n {
                    // The share is 1 − y², so that the tail of steep facets is resolved.
                    let y = (f64::from(i) + 0.5) / f64::from(n);
                    let tan2 = lobe.quantile(1.0 - y * y, alpha);
                    let c = 1.0 / (1.0 + tan2).sqrt();
                    let s = (1.0 - c * c).sqrt();
                    for j in 0..n {
                        let phi = std::f64::consts::TAU * (f64::from(j) + 0.5) / f64::from(n);
                        sum += 2.0 * y * dot(v, [s * phi.cos(), s * phi.sin(), c]).max(0.0) / c / f64::from(n * n);
                    }
                }
                assert!((g1 * sum / cos - 1.0).abs() < tolerance, "{slopes:?} {cos} {alpha}: {}", g1 * sum / cos);
            }
        }
    }

    #[test]
    fn lobes_are_reciprocal_and_lose_energy_only() {
        let nodes = DirectionPairs::new(Lobe::Ggx, 0.4);
        for slopes in [SlopeDistribution::Beckmann, SlopeDistribution::Ggx] {
            for masking in [MaskingRule::Separable, MaskingRule::Correlated] {
                let micro = MicrofacetLobe { slopes, masking };
                let (v, l) = ([0.6, 0.0, 0.8], [0.0, -0.8, 0.6]);
                assert!((micro.value(v, l, 0.4) / micro.value(l, v, 0.4) - 1.0).abs() < 1e-12);
                let albedo = nodes.albedo(|v, l| micro.value(v, l, 0.4));
                assert!((0.5..=1.0).contains(&albedo), "{micro:?}: {albedo}");
            }
        }
    }

    #[test]
    fn a_conductor_of_a_reflectance_has_it_at_normal_incidence() {
        for r in [0.1f64, 0.5, 0.98] {
            let k = 2.0 * r.sqrt() / (1.0 - r).sqrt();
            assert!((conductor(1.0, k) - r).abs() < 1e-12);
            assert!(conductor(1e-9, k) > 0.999_99);
        }
    }
}
