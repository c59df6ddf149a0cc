//! The bounded gloss lobe f_s in f64 and its directional albedo a(N·v, m) as a table for the sky term.
//!
//! f_s = ρs·D·G/(4 (N·l)(N·v)), Beckmann or GGX D, V-cavity G (Cook & Torrance 1982 with π m² cos⁴α under the Beckmann
//! exponential so that ∫ D cosα dω = 1; Walter et al. 2007 Eq. 33 for GGX), times the dielectric Fresnel factor for
//! `CookTorrance`. a(N·v, m) = ∫ f_s/ρs cosθ dω ≤ 1. Limits: N·v is floored at 1e-3, m at 1e-3.

use crate::scene::Lobe;
use std::f64::consts::PI;

/// Smallest N·v and m that the shading uses.
pub const FLOOR: f64 = 1e-3;

/// Microfacet density D(α) (1/sr) from cos²α and m.
pub fn density(lobe: Lobe, cos2: f64, m: f64) -> f64 {
    if cos2 <= 0.0 {
        return 0.0;
    }
    let (tan2, m2) = ((1.0 - cos2).max(0.0) / cos2, m * m);
    match lobe {
        Lobe::Ggx => m2 / (PI * cos2 * cos2 * (m2 + tan2) * (m2 + tan2)),
        Lobe::Beckmann | Lobe::CookTorrance { .. } => (-tan2 / m2).exp() / (PI * m2 * cos2 * cos2),
    }
}

/// Unpolarised dielectric Fresnel reflectance at cosine `c` for relative index `n` (1 for the lobes without it).
pub fn fresnel(lobe: Lobe, c: f64) -> f64 {
    let Lobe::CookTorrance { index } = lobe else { return 1.0 };
    let n = f64::from(index);
    let sin2 = (1.0 - c * c) / (n * n);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let t = (1.0 - sin2).sqrt();
    let (s, p) = ((c - n * t) / (c + n * t), (n * c - t) / (n * c + t));
    0.5 * (s * s + p * p)
}

/// V-cavity shadowing and masking.
pub fn cavity(nh: f64, nv: f64, nl: f64, vh: f64) -> f64 {
    (2.0 * nh * nv.min(nl) / vh).clamp(0.0, 1.0)
}

/// Directional albedo per unit ρs at cosine `nv` and roughness `m`: the mean over half vectors h drawn from D cosα of
/// F·G·(v·h)/((N·v) cosα), which is what dω_l = 4 (v·h) dω_h makes of the integral. Gauss–Legendre in the share of D
/// and a midpoint rule in azimuth.
pub fn directional_albedo(lobe: Lobe, nv: f64, m: f64, polar: &[(f64, f64)], azimuths: usize) -> f64 {
    let (nv, m) = (nv.clamp(FLOOR, 1.0), m.max(FLOOR));
    let sin_v = (1.0 - nv * nv).sqrt();
    let mut sum = 0.0;
    for &(share, weight) in polar {
        let tan2 = match lobe {
            Lobe::Ggx => m * m * share / (1.0 - share),
            Lobe::Beckmann | Lobe::CookTorrance { .. } => -m * m * (-share).ln_1p(),
        };
        let nh = 1.0 / (1.0 + tan2).sqrt();
        let sin_h = (tan2.sqrt() * nh).min(1.0);
        for k in 0..azimuths {
            let phi = PI * (k as f64 + 0.5) / azimuths as f64;
            let vh = nv * nh + sin_v * sin_h * phi.cos();
            let nl = 2.0 * vh * nh - nv;
            if vh > 0.0 && nl > 0.0 {
                sum += weight * fresnel(lobe, vh) * cavity(nh, nv, nl, vh) * vh / (nv * nh);
            }
        }
    }
    sum / azimuths as f64
}

/// Nodes and weights on [0, 1]: Gauss–Legendre in x with share = 1 − (1 − x)², which crowds nodes where the lobe's tail
/// lies.
pub fn polar_nodes(n: usize) -> Vec<(f64, f64)> {
    gauss_legendre(n)
        .into_iter()
        .map(|(x, w)| {
            let x = 0.5 * (x + 1.0);
            (1.0 - (1.0 - x) * (1.0 - x), w * (1.0 - x))
        })
        .collect()
}

/// Gauss–Legendre nodes and weights on [−1, 1] by Newton's method on the Legendre recurrence.
pub fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    let mut nodes = Vec::with_capacity(n);
    for i in 0..n {
        let mut x = -(PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..50 {
            let (mut p0, mut p1) = (1.0, x);
            for k in 2..=n {
                let k = k as f64;
                (p0, p1) = (p1, ((2.0 * k - 1.0) * x * p1 - (k - 1.0) * p0) / k);
            }
            slope = n as f64 * (x * p1 - p0) / (x * x - 1.0);
            let step = p1 / slope;
            x -= step;
            if step.abs() < 1e-15 {
                break;
            }
        }
        nodes.push((x, 2.0 / ((1.0 - x * x) * slope * slope)));
    }
    nodes
}

/// The table the shader looks up: columns √(N·v) from √`FLOOR` to 1, rows ln m from `m_min` to `m_max`, bilinear
/// between.
#[derive(Debug, Clone, PartialEq)]
pub struct AlbedoTable {
    pub m_min: f64,
    pub m_max: f64,
    /// Row-major, `ROWS` × `COLUMNS`.
    pub values: Vec<f32>,
}

impl AlbedoTable {
    pub const COLUMNS: usize = 96;
    pub const ROWS: usize = 24;

    /// Integrates the table over the roughness range that a leaf's texels span.
    pub fn new(lobe: Lobe, m_min: f64, m_max: f64) -> AlbedoTable {
        let m_min = m_min.max(FLOOR);
        let m_max = m_max.max(m_min * 1.01);
        let polar = polar_nodes(32);
        let mut values = Vec::with_capacity(Self::ROWS * Self::COLUMNS);
        for row in 0..Self::ROWS {
            let m = m_min * (m_max / m_min).powf(row as f64 / (Self::ROWS - 1) as f64);
            for column in 0..Self::COLUMNS {
                let x = FLOOR.sqrt() + (1.0 - FLOOR.sqrt()) * column as f64 / (Self::COLUMNS - 1) as f64;
                values.push(directional_albedo(lobe, x * x, m, &polar, 48) as f32);
            }
        }
        AlbedoTable { m_min, m_max, values }
    }

    /// What the shader reads at (N·v, m).
    pub fn lookup(&self, nv: f64, m: f64) -> f64 {
        let x = (nv.clamp(FLOOR, 1.0).sqrt() - FLOOR.sqrt()) / (1.0 - FLOOR.sqrt()) * (Self::COLUMNS - 1) as f64;
        let y = (m.clamp(self.m_min, self.m_max) / self.m_min).ln() / (self.m_max / self.m_min).ln()
            * (Self::ROWS - 1) as f64;
        let (i, j) = ((x as usize).min(Self::COLUMNS - 2), (y as usize).min(Self::ROWS - 2));
        let (s, t) = (x - i as f64, y - j as f64);
        let at = |i: usize, j: usize| f64::from(self.values[j * Self::COLUMNS + i]);
        (at(i, j) * (1.0 - s) + at(i + 1, j) * s) * (1.0 - t) + (at(i, j + 1) * (1.0 - s) + at(i + 1, j + 1) * s) * t
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ f_s cosθ dω over light directions, by brute force: rings crowd towards the horizon, cosθ = s⁴, where grazing
    /// views reflect.
    fn brute(lobe: Lobe, nv: f64, m: f64) -> f64 {
        let sin_v = (1.0 - nv * nv).sqrt();
        let (rings, spokes) = (900, 900);
        let mut sum = 0.0;
        for i in 0..rings {
            let s = (i as f64 + 0.5) / rings as f64;
            let nl = s.powi(4);
            let sin_l = (1.0 - nl * nl).sqrt();
            for k in 0..spokes {
                // Crowded around the mirror direction, azimuth π.
                let t = (k as f64 + 0.5) / spokes as f64;
                let phi = PI * (1.0 - t * t);
                let (x, y, z) = (sin_l * phi.cos() + sin_v, sin_l * phi.sin(), nl + nv);
                let length = (x * x + y * y + z * z).sqrt();
                let nh = z / length;
                let vh = (sin_v * x + nv * z) / length;
                let f = density(lobe, nh * nh, m) * cavity(nh, nv, nl, vh) * fresnel(lobe, vh) / (4.0 * nl * nv);
                sum += f * nl * 4.0 * s.powi(3) * 2.0 * PI * t;
            }
        }
        // Both halves of the azimuth.
        2.0 * sum / (rings * spokes) as f64
    }

    #[test]
    fn table_meets_brute_force() {
        for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
            let table = AlbedoTable::new(lobe, 0.1, 0.5);
            for (nv, m) in
                [(0.95, 0.13), (0.6, 0.3), (0.3, 0.21), (0.12, 0.47), (0.05, 0.2), (0.01, 0.4), (0.001, 0.15)]
            {
                let (got, want) = (table.lookup(nv, m), brute(lobe, nv, m));
                assert!((got - want).abs() < 2e-3, "{lobe:?} nv {nv} m {m}: {got} against {want}");
            }
        }
    }

    #[test]
    fn no_direction_reflects_more_than_it_gets() {
        let polar = polar_nodes(32);
        for lobe in [Lobe::Beckmann, Lobe::Ggx] {
            for m in [0.02, 0.1, 0.3, 0.7] {
                for i in 0..20 {
                    let a = directional_albedo(lobe, 0.001 + 0.05 * i as f64, m, &polar, 48);
                    assert!((0.0..=1.0 + 1e-3).contains(&a), "{lobe:?} m {m}: {a}");
                }
            }
        }
        // A nearly smooth mirror returns all of it, with Fresnel the dielectric's share at normal incidence.
        let a = directional_albedo(Lobe::Beckmann, 1.0, 0.02, &polar, 48);
        assert!((a - 1.0).abs() < 1e-3, "{a}");
        let a = directional_albedo(Lobe::CookTorrance { index: 1.5 }, 1.0, 0.02, &polar, 48);
        assert!((a - 0.04).abs() < 1e-4, "{a}");
    }

    #[test]
    fn gauss_legendre_integrates_polynomials() {
        let nodes = gauss_legendre(8);
        let integral: f64 = nodes.iter().map(|(x, w)| w * x.powi(14)).sum();
        assert!((integral - 2.0 / 15.0).abs() < 1e-13);
    }
}
