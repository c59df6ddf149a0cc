//! The directional albedo a(N·v, m) of the bounded gloss lobe as a table for light from the sky. It is computed from
//! the lobe's formulas in double precision ([`mesophyll_base::surface::gloss`]). The lobe itself is evaluated by
//! `passes/lobe.wgsl`.
//!
//! f_s = ρs·D·G·F/(4 (N·l)(N·v)) with a V-cavity factor G, and a(N·v, m) = ∫ f_s/ρs cosθ dω ≤ 1. N·v and m are at least
//! 1e-3.

use crate::dome::MeanTable;
use crate::scene::Lobe;
use std::f64::consts::PI;

/// Smallest N·v and m that the shading uses.
pub const FLOOR: f64 = 1e-3;

/// The V-cavity factor for shadowing and masking.
pub fn cavity(nh: f64, nv: f64, nl: f64, vh: f64) -> f64 {
    (2.0 * nh * nv.min(nl) / vh).clamp(0.0, 1.0)
}

/// Directional albedo for ρs = 1 at cosine `nv` and roughness `m`. It is the mean of F·G·(v·h)/((N·v) cosα) over half
/// vectors h drawn from D cosα, because dω_l = 4 (v·h) dω_h. The quadrature is Gauss–Legendre in the share of D and a
/// midpoint rule in azimuth.
pub fn directional_albedo(lobe: Lobe, nv: f64, m: f64, polar: &[(f64, f64)], azimuths: usize) -> f64 {
    let (nv, m) = (nv.clamp(FLOOR, 1.0), m.max(FLOOR));
    let sin_v = (1.0 - nv * nv).sqrt();
    let mut sum = 0.0;
    for &(share, weight) in polar {
        let tan2 = lobe.quantile(share, m);
        let nh = 1.0 / (1.0 + tan2).sqrt();
        let sin_h = (tan2.sqrt() * nh).min(1.0);
        for k in 0..azimuths {
            let phi = PI * (k as f64 + 0.5) / azimuths as f64;
            let vh = nv * nh + sin_v * sin_h * phi.cos();
            let nl = 2.0 * vh * nh - nv;
            if vh > 0.0 && nl > 0.0 {
                sum += weight * lobe.fresnel(vh) * cavity(nh, nv, nl, vh) * vh / (nv * nh);
            }
        }
    }
    sum / azimuths as f64
}

/// Nodes and weights on [0, 1]: Gauss–Legendre in x, where share = 1 − (1 − x)². This puts more nodes into the lobe's
/// tail.
pub fn polar_nodes(n: usize) -> Vec<(f64, f64)> {
    mesophyll_base::quadrature::symmetric(n)
        .into_iter()
        .map(|(x, w)| {
            let x = 0.5 * (x + 1.0);
            (1.0 - (1.0 - x) * (1.0 - x), w * (1.0 - x))
        })
        .collect()
}

/// The table that the shader reads. Columns are √(N·v) from √`FLOOR` to 1, rows are ln m from `m_min` to `m_max`, and
/// values between are bilinear.
#[derive(Debug, Clone, PartialEq)]
pub struct ShaderAlbedoTable {
    /// Roughness of the first row.
    pub m_min: f64,
    /// Roughness of the last row.
    pub m_max: f64,
    /// Row-major, `ROWS` × `COLUMNS`.
    pub values: Vec<f32>,
}

impl ShaderAlbedoTable {
    /// Number of steps of √(N·v).
    pub const COLUMNS: usize = 96;
    /// Number of steps of ln m.
    pub const ROWS: usize = 24;

    /// Integrates the table over the roughness range that a leaf's texels span.
    pub fn new(lobe: Lobe, m_min: f64, m_max: f64) -> ShaderAlbedoTable {
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
        ShaderAlbedoTable { m_min, m_max, values }
    }

    /// The value that the shader reads at (N·v, m).
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

/// Tables that were integrated already. They are kept from scene to scene.
#[derive(Default)]
pub(crate) struct Tables(Vec<(Lobe, ShaderAlbedoTable)>, Vec<(Lobe, MeanTable)>);

impl Tables {
    /// A table that covers roughness from `m_min` to `m_max`.
    pub(crate) fn albedo(&mut self, lobe: Lobe, m_min: f64, m_max: f64) -> ShaderAlbedoTable {
        // The range is rounded outwards to powers of two, so that edits in the window rarely need a new table.
        let (low, high) = (m_min.max(FLOOR).log2().floor().exp2(), m_max.max(FLOOR).log2().ceil().exp2());
        if let Some((_, table)) =
            self.0.iter().find(|(l, t)| *l == lobe && t.m_min <= low && t.m_max >= high && t.m_max <= 4.0 * high)
        {
            return table.clone();
        }
        let table = ShaderAlbedoTable::new(lobe, low, high);
        self.0.push((lobe, table.clone()));
        table
    }

    /// The table of mean directions on the grid of an albedo table.
    pub(crate) fn means(&mut self, lobe: Lobe, like: &ShaderAlbedoTable) -> MeanTable {
        if let Some((_, table)) =
            self.1.iter().find(|(l, t)| *l == lobe && (t.m_min, t.m_max) == (like.m_min, like.m_max))
        {
            return table.clone();
        }
        let table = MeanTable::new(lobe, like.m_min, like.m_max);
        self.1.push((lobe, table.clone()));
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ∫ f_s cosθ dω over light directions, by brute force. With cosθ = s⁴ the rings are dense near the horizon, where
    /// grazing views reflect.
    fn brute(lobe: Lobe, nv: f64, m: f64) -> f64 {
        let sin_v = (1.0 - nv * nv).sqrt();
        let (rings, spokes) = (900, 900);
        let mut sum = 0.0;
        for i in 0..rings {
            let s = (i as f64 + 0.5) / rings as f64;
            let nl = s.powi(4);
            let sin_l = (1.0 - nl * nl).sqrt();
            for k in 0..spokes {
                // The nodes are dense around the mirror direction, azimuth π.
                let t = (k as f64 + 0.5) / spokes as f64;
                let phi = PI * (1.0 - t * t);
                let (x, y, z) = (sin_l * phi.cos() + sin_v, sin_l * phi.sin(), nl + nv);
                let length = (x * x + y * y + z * z).sqrt();
                let nh = z / length;
                let vh = (sin_v * x + nv * z) / length;
                let f = lobe.distribution(1.0 / (nh * nh) - 1.0, m) * cavity(nh, nv, nl, vh) * lobe.fresnel(vh)
                    / (4.0 * nl * nv);
                sum += f * nl * 4.0 * s.powi(3) * 2.0 * PI * t;
            }
        }
        // The factor 2 is for both halves of the azimuth.
        2.0 * sum / (rings * spokes) as f64
    }

    #[test]
    fn table_meets_brute_force() {
        for lobe in Lobe::all(1.45) {
            let table = ShaderAlbedoTable::new(lobe, 0.1, 0.5);
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
        // A nearly smooth mirror returns all light. With Fresnel's factor it returns a dielectric's share at normal
        // incidence.
        let a = directional_albedo(Lobe::Beckmann, 1.0, 0.02, &polar, 48);
        assert!((a - 1.0).abs() < 1e-3, "{a}");
        let a = directional_albedo(Lobe::CookTorrance { index: 1.5 }, 1.0, 0.02, &polar, 48);
        assert!((a - 0.04).abs() < 1e-4, "{a}");
    }
}
