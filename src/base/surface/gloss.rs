//! Gloss of a leaf's surface: W Eq. 6 and 7 (Torrance–Sparrow with F·G merged into ρs), the same with a long-tailed
//! distribution, the full Cook–Torrance form that Habel uses (H9 §3.3.3), and that form with the long-tailed
//! distribution.
//!
//! All values are f_s per unit ρs, in 1/sr. `m` is the surface slope (W: 2σ/l), unitless; `n`, `l`, `v` are unit
//! vectors: normal, towards the light, towards the viewer. Isotropic, one bounce. W's form exceeds energy conservation
//! at grazing angles (its directional albedo reaches 8.6 at 89°, m = .5); [`Lobe::bounded`] multiplies the V-cavity G
//! and stays at or below 1.

use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use strum::IntoEnumIterator;

/// Which surface the slopes follow, and what multiplies them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, strum::EnumDiscriminants)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, tag = "kind")]
#[strum_discriminants(
    name(LobeKind),
    doc = "The name of a [`Lobe`], as scenes, files and the command line write it.",
    derive(
        Hash,
        Deserialize,
        strum::Display,
        strum::EnumString,
        strum::EnumIter,
        strum::IntoStaticStr,
        strum::EnumMessage
    ),
    serde(rename_all = "kebab-case"),
    strum(serialize_all = "kebab-case")
)]
pub enum Lobe {
    /// W Eq. 7: Gaussian slopes; F and G are part of ρs.
    #[default]
    Beckmann,
    /// The same with the long-tailed distribution of Trowbridge and Reitz (Walter et al. 2007 name it GGX); no F, no G.
    Ggx,
    /// Beckmann's slopes with the unpolarised dielectric Fresnel reflectance of `index` and the V-cavity G.
    CookTorrance {
        /// Refractive index of the surface.
        index: f64,
    },
    /// The long-tailed distribution with the same Fresnel reflectance of `index` and the same V-cavity G.
    GgxFresnel {
        /// Refractive index of the surface.
        index: f64,
    },
}

impl LobeKind {
    /// Whether lobes of this name have an index of refraction.
    pub fn has_index(self) -> bool {
        Lobe::of(self, 1.5).index().is_some()
    }
}

impl Lobe {
    /// Name as on the command line.
    pub fn name(self) -> &'static str {
        LobeKind::from(self).into()
    }

    /// One lobe of every kind, for tests and studies that go through all of them; `index` as for [`Lobe::of`].
    pub fn all(index: f64) -> impl Iterator<Item = Lobe> {
        LobeKind::iter().map(move |kind| Lobe::of(kind, index))
    }

    /// The lobe of this name; `index` is read by those with Fresnel reflectance only.
    pub fn of(kind: LobeKind, index: f64) -> Lobe {
        match kind {
            LobeKind::Beckmann => Lobe::Beckmann,
            LobeKind::Ggx => Lobe::Ggx,
            LobeKind::CookTorrance => Lobe::CookTorrance { index },
            LobeKind::GgxFresnel => Lobe::GgxFresnel { index },
        }
    }

    /// Index of refraction, where the lobe has one: its form in the papers then holds F and G.
    pub fn index(self) -> Option<f64> {
        match self {
            Lobe::Beckmann | Lobe::Ggx => None,
            Lobe::CookTorrance { index } | Lobe::GgxFresnel { index } => Some(index),
        }
    }

    /// The density of slopes without its constants, and its decay: with u = tan²α/m², D = K(u)/(π m² cos⁴α); this
    /// returns K and −K′/K.
    #[inline]
    pub fn kernel(self, u: f64) -> [f64; 2] {
        match self {
            Lobe::Beckmann | Lobe::CookTorrance { .. } => [(-u).exp(), 1.0],
            Lobe::Ggx | Lobe::GgxFresnel { .. } => {
                let k = 1.0 / (1.0 + u);
                [k * k, 2.0 * k]
            }
        }
    }

    /// Whether the density of slopes falls like a power instead of an exponential. Then nothing may be cut off far from
    /// the peak.
    pub fn is_long_tailed(self) -> bool {
        match self {
            Lobe::Beckmann | Lobe::CookTorrance { .. } => false,
            Lobe::Ggx | Lobe::GgxFresnel { .. } => true,
        }
    }

    /// tan²α below which the `share` (0 to 1) of ∫ D cosα dω lies. Half vectors are drawn with it.
    #[inline]
    pub fn quantile(self, share: f64, m: f64) -> f64 {
        match self {
            Lobe::Beckmann | Lobe::CookTorrance { .. } => -m * m * (1.0 - share).ln(),
            Lobe::Ggx | Lobe::GgxFresnel { .. } => m * m * share / (1.0 - share),
        }
    }

    /// The Fresnel factor F for a facet that is met at this cosine; 1 where the lobe has no index.
    #[inline]
    pub fn fresnel(self, cos: f64) -> f64 {
        self.index().map_or(1.0, |index| fresnel(cos, index))
    }

    /// Microfacet distribution D for tan²α, per steradian: ∫ D cosα dω = 1 over the hemisphere.
    #[inline]
    pub fn distribution(self, tan2: f64, m: f64) -> f64 {
        let sec4 = (1.0 + tan2) * (1.0 + tan2);
        match self {
            Lobe::Beckmann | Lobe::CookTorrance { .. } => sec4 * (-tan2 / (m * m)).exp() / (PI * m * m),
            Lobe::Ggx | Lobe::GgxFresnel { .. } => {
                let w = m * m + tan2;
                sec4 * m * m / (PI * w * w)
            }
        }
    }

    /// f_s per unit ρs as the paper has it: D/(4 cosθi cosθr), with an index D·F·G/(4 cosθi cosθr). Zero below the
    /// horizon.
    pub fn value(self, n: [f64; 3], l: [f64; 3], v: [f64; 3], m: f64) -> f64 {
        let (a, b) = (dot(n, l), dot(n, v));
        if a <= 0.0 || b <= 0.0 {
            return 0.0;
        }
        let e = 1.0 + dot(l, v);
        let plain = self.distribution(tan2_half(a + b, e), m) / (4.0 * a * b);
        match self.index() {
            None => plain,
            Some(index) => plain * fresnel((0.5 * e).sqrt(), index) * v_cavity(a, b, e),
        }
    }

    /// The form that the renderers draw: [`Lobe::value`] times the V-cavity factor G where the value does not contain G
    /// already.
    pub fn bounded(self, n: [f64; 3], l: [f64; 3], v: [f64; 3], m: f64) -> f64 {
        let value = self.value(n, l, v, m);
        if self.index().is_none() && value > 0.0 {
            value * v_cavity(dot(n, l), dot(n, v), 1.0 + dot(l, v))
        } else {
            value
        }
    }

    /// Directional albedo of the bounded form per unit ρs, ∫ f cosθi dωi, for a viewer at cosine `cos_view` in (0, 1].
    ///
    /// It is integrated over half vectors drawn by the cumulative distribution of D (dωi = 4 (v·h) dωh): midpoint rule
    /// in azimuth, Gauss–Legendre in the cumulative. The error is about 1e-3.
    pub fn albedo(self, cos_view: f64, m: f64) -> f64 {
        let rule = crate::quadrature::symmetric(48);
        let v = [(1.0 - cos_view * cos_view).max(0.0).sqrt(), 0.0, cos_view];
        const AZIMUTHS: usize = 96;
        let mut sum = 0.0;
        for &(x, w) in &rule {
            let tan2 = self.quantile(0.5 * (1.0 + x), m);
            let cos = 1.0 / (1.0 + tan2).sqrt();
            let sin = (1.0 - cos * cos).max(0.0).sqrt();
            for k in 0..AZIMUTHS {
                let phi = (k as f64 + 0.5) * PI / AZIMUTHS as f64;
                let h = [sin * phi.cos(), sin * phi.sin(), cos];
                let vh = dot(v, h);
                let a = 2.0 * vh * h[2] - v[2];
                if vh <= 0.0 || a <= 0.0 {
                    continue;
                }
                sum +=
                    0.5 * w / AZIMUTHS as f64 * self.fresnel(vh) * v_cavity(a, v[2], 2.0 * vh * vh) * vh / (v[2] * cos);
            }
        }
        sum
    }
}

/// tan²α of the half vector from cosθi + cosθr and 1 + l·v: cos²α = (cosθi + cosθr)²/(2 (1 + l·v)).
#[inline]
pub fn tan2_half(cos_sum: f64, one_plus_lv: f64) -> f64 {
    (2.0 * one_plus_lv / (cos_sum * cos_sum) - 1.0).max(0.0)
}

/// V-cavity masking and shadowing (Torrance & Sparrow 1967): min(1, 2 (n·h)(n·v)/(v·h), 2 (n·h)(n·l)/(v·h)), with
/// (n·h)/(v·h) = (cosθi + cosθr)/(1 + l·v).
#[inline]
pub fn v_cavity(cos_i: f64, cos_r: f64, one_plus_lv: f64) -> f64 {
    (2.0 * cos_i.min(cos_r) * (cos_i + cos_r) / one_plus_lv).min(1.0)
}

/// Fresnel reflectance of a dielectric of `index` in air for unpolarised light; `cos` is the cosine of incidence.
#[inline]
pub fn fresnel(cos: f64, index: f64) -> f64 {
    let c = cos.clamp(0.0, 1.0);
    let g = (index * index - 1.0 + c * c).max(0.0).sqrt();
    let (d, s) = (g - c, g + c);
    let t = (c * s - 1.0) / (c * d + 1.0);
    0.5 * (d / s).powi(2) * (1.0 + t * t)
}

/// Scalar product.
#[inline]
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dir(theta: f64, phi: f64) -> [f64; 3] {
        [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
    }

    #[test]
    fn distributions_are_normalised() {
        for lobe in Lobe::all(1.45) {
            for m in [0.05, 0.3, 0.9] {
                let n = 200_000;
                let sum: f64 = (0..n)
                    .map(|k| {
                        // t = tan²α on (0, ∞) by t = m² x/(1−x); cosα dω = π dt/(1+t)²
                        let x = (k as f64 + 0.5) / n as f64;
                        let t = m * m * x / (1.0 - x);
                        lobe.distribution(t, m) * PI / (1.0 + t).powi(2) * m * m / (1.0 - x).powi(2) / n as f64
                    })
                    .sum();
                assert!((sum - 1.0).abs() < 1e-4, "{lobe:?} m {m}: {sum}");
            }
        }
    }

    #[test]
    fn quantiles_hold_their_share_of_the_distribution() {
        for lobe in Lobe::all(1.45) {
            for (share, m) in [(0.1, 0.05), (0.5, 0.3), (0.97, 0.9)] {
                let most = lobe.quantile(share, m);
                let n = 100_000;
                // cosα dω = π dt/(1+t)² with t = tan²α.
                let t = |k: usize| (k as f64 + 0.5) / n as f64 * most;
                let sum: f64 =
                    (0..n).map(|k| lobe.distribution(t(k), m) * PI / (1.0 + t(k)).powi(2) * most / n as f64).sum();
                assert!((sum - share).abs() < 1e-6, "{lobe:?} m {m}: {sum} of {share}");
            }
        }
    }

    #[test]
    fn stogryn_equals_the_slope_form() {
        // W Eq. 6 is compared with Stogryn's σ°: l²/σ² = 4/m², (1 + cosθi cosθr + sin sin cos)²/(cosθi + cosθr)⁴ ·
        // exp(…).
        let (m, n) = (0.35, [0.0, 0.0, 1.0]);
        for (ti, tr, p) in [(0.3, 0.9, 2.8), (1.1, 0.2, 0.4), (0.7, 0.7, 3.1)] {
            let (ti, tr, p): (f64, f64, f64) = (ti, tr, p);
            let cc = ti.cos() + tr.cos();
            let cross = ti.sin() * tr.sin() * p.cos();
            let top = 1.0 + ti.cos() * tr.cos() + cross;
            let slope2 = (ti.sin().powi(2) + tr.sin().powi(2) + 2.0 * cross) / (cc * cc);
            let stogryn = 4.0 / (m * m) * top * top / cc.powi(4) * (-slope2 / (m * m)).exp();
            let ours = Lobe::Beckmann.value(n, dir(ti, 0.0), dir(tr, p), m) * 4.0 * PI * ti.cos() * tr.cos();
            assert!((ours / stogryn - 1.0).abs() < 1e-12, "{ours} {stogryn}");
        }
    }

    #[test]
    fn grazing_albedo_of_the_paper_form_exceeds_one_the_bounded_does_not() {
        // Brute force over light directions: 8.6 at 89°, m = .5 for W's form.
        let (n, m, v) = ([0.0, 0.0, 1.0], 0.5, dir(89f64.to_radians(), 0.0));
        let (mut paper, mut bounded) = (0.0, 0.0);
        let (nt, np) = (600, 600);
        for i in 0..nt {
            let t = (i as f64 + 0.5) / nt as f64 * PI / 2.0;
            for j in 0..np {
                let l = dir(t, (j as f64 + 0.5) / np as f64 * 2.0 * PI);
                let w = t.cos() * t.sin() * (PI / 2.0 / nt as f64) * (2.0 * PI / np as f64);
                paper += Lobe::Beckmann.value(n, l, v, m) * w;
                bounded += Lobe::Beckmann.bounded(n, l, v, m) * w;
            }
        }
        assert!((paper - 8.6).abs() < 0.05, "{paper}");
        assert!(bounded <= 1.0, "{bounded}");
        assert!((bounded - Lobe::Beckmann.albedo(v[2], m)).abs() < 5e-3, "{bounded}");
        for lobe in Lobe::all(1.45) {
            for cos in [0.02, 0.3, 0.8, 1.0] {
                let a = lobe.albedo(cos, 0.3);
                assert!((0.0..=1.0 + 1e-3).contains(&a), "{lobe:?} {cos}: {a}");
            }
        }
    }

    #[test]
    fn fresnel_known_values() {
        assert!((fresnel(1.0, 1.5) - 0.04).abs() < 1e-12);
        assert!((fresnel(0.0, 1.5) - 1.0).abs() < 1e-12);
        // At Brewster's angle only the s-polarised half is reflected: ((n²−1)/(n²+1))²/2.
        let n: f64 = 1.45;
        let brewster = (1.0 / (1.0 + n * n)).sqrt();
        let want = 0.5 * ((n * n - 1.0) / (n * n + 1.0)).powi(2);
        assert!((fresnel(brewster, n) - want).abs() < 1e-12);
    }
}
