//! Pairs of directions over which two materials are compared.
//!
//! The integral is ∬ f cosθi cosθo dωi dωo over both hemispheres. Outgoing directions are Gauss–Legendre nodes in
//! √cosθo at one azimuth, because every material here is isotropic. Incoming ones are drawn half from the cosine and
//! half around the lobe's own half vectors by a fixed sequence, and weighted by both densities (Veach & Guibas 1995).
//! The same nodes give the same numbers in every run. Integrals are within about one per cent of their value.

use mesophyll_base::surface::gloss::{Lobe, dot};
use std::f64::consts::{PI, TAU};

/// Outgoing directions, and incoming ones of each kind for each of them.
const OUT: usize = 24;
const IN: usize = 256;

/// A pair of directions above the surface with its weight, which contains both cosines.
#[derive(Debug, Clone, Copy)]
pub struct DirectionPair {
    /// Towards the viewer.
    pub view: [f64; 3],
    /// Towards the light.
    pub light: [f64; 3],
    /// Weight of the pair in ∬ f cosθi cosθo dωi dωo.
    pub weight: f64,
}

/// The pairs for a lobe of one roughness.
#[derive(Debug, Clone)]
pub struct DirectionPairs {
    /// All pairs, in order of the outgoing directions.
    pub all: Vec<DirectionPair>,
}

impl DirectionPairs {
    /// Pairs that resolve `lobe` with slope `m`.
    pub fn new(lobe: Lobe, m: f64) -> DirectionPairs {
        DirectionPairs::fine(lobe, m, OUT, IN)
    }

    fn fine(lobe: Lobe, m: f64, out: usize, inward: usize) -> DirectionPairs {
        let m = m.max(1e-3);
        let mut all = Vec::with_capacity(2 * out * inward);
        for (k, (t, w)) in mesophyll_base::quadrature::unit(out).into_iter().enumerate() {
            // Clustered at grazing, where a lobe is largest: cosθ = t².
            let (mu, w) = (t * t, 2.0 * t * w);
            let view = [(1.0 - mu * mu).sqrt(), 0.0, mu];
            let lobe_density = |l: [f64; 3]| {
                let h = crate::foreign::micro::half(view, l);
                let tan2 = (1.0 - h[2] * h[2]).max(0.0) / (h[2] * h[2]);
                lobe.distribution(tan2, m) * h[2] / (4.0 * dot(view, h)).max(1e-12)
            };
            let mut add = |light: [f64; 3]| {
                if light[2] > 1e-9 {
                    let density = inward as f64 * (light[2] / PI + lobe_density(light));
                    all.push(DirectionPair { view, light, weight: TAU * mu * w * light[2] / density });
                }
            };
            for j in 0..inward {
                // The R2 sequence (Roberts 2018), shifted for each outgoing direction.
                let at = |a: f64| (0.5 + a * (j + 1) as f64 + 0.381_966 * k as f64).fract();
                let (x, y) = (at(0.754_877_666_246_692_8), at(0.569_840_290_998_053_3));
                let (sin, cos) = (TAU * y).sin_cos();
                let r = x.sqrt();
                add([r * cos, r * sin, (1.0 - x).sqrt()]);
                let tan = lobe.quantile(x.min(1.0 - 1e-12), m).sqrt();
                let c = 1.0 / (1.0 + tan * tan).sqrt();
                let h = [tan * c * cos, tan * c * sin, c];
                let vh = dot(view, h);
                if vh > 0.0 {
                    add([0, 1, 2].map(|i| 2.0 * vh * h[i] - view[i]));
                }
            }
        }
        DirectionPairs { all }
    }

    /// ∬ g cosθi cosθo dωi dωo.
    pub fn integral(&self, mut g: impl FnMut([f64; 3], [f64; 3]) -> f64) -> f64 {
        self.all.iter().map(|n| n.weight * g(n.view, n.light)).sum()
    }

    /// The share of even light from everywhere that a material f sends back: its integral over π.
    pub fn albedo(&self, f: impl FnMut([f64; 3], [f64; 3]) -> f64) -> f64 {
        self.integral(f) / PI
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A matte surface has its own albedo, and a lobe that of the closed quadrature in `surface`.
    #[test]
    fn albedos_are_those_of_other_rules() {
        for (lobe, m) in [(Lobe::Beckmann, 0.08), (Lobe::Beckmann, 0.4), (Lobe::Ggx, 0.2)] {
            let nodes = DirectionPairs::new(lobe, m);
            let matte = nodes.albedo(|_, _| 0.3 / PI);
            assert!((matte / 0.3 - 1.0).abs() < 0.01, "{lobe:?} {m}: {matte}");
            let n = [0.0, 0.0, 1.0];
            let found = nodes.albedo(|v, l| lobe.bounded(n, l, v, m));
            // ∫ a(cosθ) 2 cosθ dcosθ by 32 nodes.
            let rule = mesophyll_base::quadrature::unit(32);
            let exact: f64 = rule.iter().map(|(c, w)| 2.0 * c * w * lobe.albedo(*c, m)).sum();
            assert!((found / exact - 1.0).abs() < 0.01, "{lobe:?} {m}: {found} against {exact}");
        }
    }

    /// The squares, by which losses are measured, agree with those of eight times as many pairs.
    #[test]
    fn squares_have_settled() {
        let n = [0.0, 0.0, 1.0];
        for m in [0.1, 0.35] {
            let square = |nodes: DirectionPairs| nodes.integral(|v, l| Lobe::Beckmann.bounded(n, l, v, m).powi(2));
            let (few, many) = (
                square(DirectionPairs::new(Lobe::Beckmann, m)),
                square(DirectionPairs::fine(Lobe::Beckmann, m, 24, 1024)),
            );
            assert!((few / many - 1.0).abs() < 0.03, "{m}: {few} against {many}");
        }
    }
}
