//! The share of an even dome that a rough surface mirrors: the directional albedo of the lobe, which lies over the
//! leaf's own colour as a veil. It is given per unit ρs. The view is along the blade's normal; the surface leans by the
//! cosine `lean` and has the roughness `m`. It is used for synthesis only: the reduction does not use a lobe.

use crate::slab_truth::gauss_legendre;
use mesophyll_optics::gloss::Lobe;
use std::f64::consts::PI;

/// Nodes of the table in the cosine of the lean and in roughness.
const NODES: usize = 24;
const FLATTEST: f64 = 0.35;
const ROUGHEST: f64 = 0.9;

/// The veil for every lean and roughness, interpolated bilinearly (to a relative error of about 3e-3).
#[derive(Debug)]
pub struct Veil(Vec<f64>);

impl Veil {
    pub fn new(lobe: Lobe) -> Veil {
        let node = |k: usize, a: f64, b: f64| a + (b - a) * k as f64 / (NODES - 1) as f64;
        Veil(
            (0..NODES * NODES)
                .map(|k| share(lobe, node(k % NODES, FLATTEST, 1.0), node(k / NODES, 0.01, ROUGHEST)))
                .collect(),
        )
    }

    /// The veil at a lean (cosine of the angle between surface and blade normal) and a roughness, both clamped to the
    /// table's range.
    pub fn at(&self, lean: f64, m: f64) -> f64 {
        let place = |v: f64, a: f64, b: f64| ((v - a) / (b - a)).clamp(0.0, 1.0) * (NODES - 1) as f64;
        let (x, y) = (place(lean, FLATTEST, 1.0), place(m, 0.01, ROUGHEST));
        let (i, j) = ((x as usize).min(NODES - 2), (y as usize).min(NODES - 2));
        let (u, v) = (x - i as f64, y - j as f64);
        let at = |i: usize, j: usize| self.0[j * NODES + i];
        (at(i, j) * (1.0 - u) + at(i + 1, j) * u) * (1.0 - v) + (at(i, j + 1) * (1.0 - u) + at(i + 1, j + 1) * u) * v
    }
}

/// ∫ f cosθi dω over the directions above both the surface and the blade's plane. Half vectors h are drawn with the
/// density D cosα, so each counts f cosθi dω = (v·h)/((n·v) cosα) (Torrance & Sparrow 1967; dω = 4 (v·h) dω_h).
fn share(lobe: Lobe, lean: f64, m: f64) -> f64 {
    // Half a turn is enough, because the other half is its mirror image.
    const AZIMUTHS: usize = 48;
    let sin = (1.0 - lean * lean).max(0.0).sqrt();
    // The surface's frame: normal along z, view in the x–z plane; the blade's normal is the view.
    let v = [sin, 0.0, lean];
    let mut sum = 0.0;
    for (x, w) in gauss_legendre(64) {
        let tan2 = lobe.quantile(0.5 * (1.0 + x), m);
        let (cos_h, sin_h) = (1.0 / (1.0 + tan2).sqrt(), (tan2 / (1.0 + tan2)).sqrt());
        for k in 0..AZIMUTHS {
            let phi = (k as f64 + 0.5) * PI / AZIMUTHS as f64;
            let h = [sin_h * phi.cos(), sin_h * phi.sin(), cos_h];
            let vh = v[0] * h[0] + v[2] * h[2];
            let l = [0, 1, 2].map(|c| 2.0 * vh * h[c] - v[c]);
            let above_blade = l[0] * v[0] + l[2] * v[2];
            if vh <= 0.0 || l[2] <= 0.0 || above_blade <= 0.0 {
                continue;
            }
            let surface = lobe.index().map_or(1.0, |index| {
                let shadow = (2.0 * cos_h * lean / vh).min(2.0 * cos_h * l[2] / vh).min(1.0);
                dielectric(vh, index) * shadow
            });
            sum += 0.5 * w / AZIMUTHS as f64 * surface * vh / (lean * cos_h);
        }
    }
    sum
}

/// Fresnel reflectance for unpolarised light from Snell's law; `c` is the cosine of incidence.
fn dielectric(c: f64, index: f64) -> f64 {
    let inside = (1.0 - (1.0 - c * c) / (index * index)).max(0.0).sqrt();
    let s = (c - index * inside) / (c + index * inside);
    let p = (index * c - inside) / (index * c + inside);
    0.5 * (s * s + p * p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_optics::gloss;

    /// A smooth level surface mirrors the whole dome (per unit ρs), and with a Fresnel term its reflectance at normal
    /// incidence.
    #[test]
    fn a_mirror_shows_the_whole_dome() {
        assert!((share(Lobe::Beckmann, 1.0, 0.01) - 1.0).abs() < 1e-3);
        let n: f64 = 1.45;
        let f0 = ((n - 1.0) / (n + 1.0)).powi(2);
        assert!((share(Lobe::CookTorrance { index: n }, 1.0, 0.01) / f0 - 1.0).abs() < 1e-3);
        let veil = Veil::new(Lobe::Beckmann);
        for (lean, m) in [(1.0, 0.2), (0.93, 0.41), (0.71, 0.11)] {
            assert!((veil.at(lean, m) / share(Lobe::Beckmann, lean, m) - 1.0).abs() < 5e-3, "{lean} {m}");
        }
    }

    /// Level surfaces are compared with the directional albedo that the renderers use, which is other code (it also
    /// bounds the lobe by G).
    #[test]
    fn level_surfaces_agree_with_the_renderers_albedo() {
        for m in [0.1, 0.25, 0.4] {
            let lobe = gloss::Lobe::CookTorrance { index: 1.4 };
            let ours = share(Lobe::CookTorrance { index: 1.4 }, 1.0, m);
            assert!((ours / lobe.albedo(1.0, m) - 1.0).abs() < 2e-3, "{m}");
        }
    }
}
