//! ρd and ρt of a slab, interpolated over its thickness. The reference renderer asks for them at every place that a ray
//! meets. This code is independent of the renderer's own table, so the two can check each other.
//!
//! It is barycentric interpolation of ln ρ in Chebyshev points of the second kind (Berrut & Trefethen 2004, Eq. 4.2). A
//! slab's response is analytic in the thickness, so a few dozen points are exact to rounding. Lengths in mm.

use super::medium;
use std::f64::consts::PI;

/// The interpolant of one slab, for three channels.
#[derive(Debug, Clone)]
pub struct SlabInterpolant {
    nodes: Vec<f64>,
    /// ln ρd and ln ρt: for each node, one number a channel.
    values: Vec<[f64; 6]>,
}

/// Points of the interpolant.
const NODES: usize = 25;

impl SlabInterpolant {
    /// The slab with these coefficients (1/mm, a channel each) between the thicknesses `low` and `high` (mm).
    pub fn new(sigma_a: [f64; 3], sigma_s: [f64; 3], low: f64, high: f64) -> SlabInterpolant {
        let half = ((high - low) / 2.0).max(1e-9 * high);
        let nodes: Vec<f64> =
            (0..NODES).map(|k| (low + high) / 2.0 + half * (PI * k as f64 / (NODES - 1) as f64).cos()).collect();
        let values = nodes
            .iter()
            .map(|&h| {
                let r = [0, 1, 2].map(|c| medium::response(sigma_a[c], sigma_s[c], h));
                [r[0].rho_d, r[1].rho_d, r[2].rho_d, r[0].rho_t, r[1].rho_t, r[2].rho_t].map(|v| v.max(1e-300).ln())
            })
            .collect();
        SlabInterpolant { nodes, values }
    }

    /// ρd and ρt (shares of the light, a channel each) at the thickness `h` (mm). A thickness outside the range takes
    /// the nearest end of it.
    pub fn at(&self, h: f64) -> ([f64; 3], [f64; 3]) {
        let h = h.clamp(self.nodes[NODES - 1], self.nodes[0]);
        let (mut sum, mut weights) = ([0.0; 6], 0.0);
        for (k, (node, value)) in self.nodes.iter().zip(&self.values).enumerate() {
            if h == *node {
                (sum, weights) = (*value, 1.0);
                break;
            }
            let end = if k == 0 || k == NODES - 1 { 0.5 } else { 1.0 };
            let w = end * if k % 2 == 0 { 1.0 } else { -1.0 } / (h - node);
            weights += w;
            for (s, v) in sum.iter_mut().zip(value) {
                *s += w * v;
            }
        }
        let rho = sum.map(|s| (s / weights).exp());
        ([rho[0], rho[1], rho[2]], [rho[3], rho[4], rho[5]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interpolant_is_the_slab() {
        let (sa, ss) = ([9.0, 4.2, 0.02], [6.0, 7.0, 5.0]);
        let curve = SlabInterpolant::new(sa, ss, 0.08, 0.4);
        for k in 0..=40 {
            let h = 0.08 + 0.32 * f64::from(k) / 40.0;
            let (rho_d, rho_t) = curve.at(h);
            for c in 0..3 {
                let exact = medium::response(sa[c], ss[c], h);
                assert!(
                    (rho_d[c] / exact.rho_d - 1.0).abs() < 1e-7 && (rho_t[c] / exact.rho_t - 1.0).abs() < 1e-7,
                    "{h} {c}"
                );
            }
        }
    }
}
