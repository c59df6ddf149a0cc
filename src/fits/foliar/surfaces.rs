//! Surfaces of many wavelengths, interpolated from surfaces at few triples of refractive indices.
//!
//! Refractive indices change little and smoothly over a spectrum. At one absorption and oblateness, R and T are
//! therefore smooth functions of the three indices. They are computed at the nodes of Chebyshev polynomials over the
//! box that the indices of a spectrum fill, and interpolated in between. The axes of the box are √(n_cuticle −
//! n_mesophyll), n_mesophyll and √(n_mesophyll − n_antidermal), because the angles of total reflection start like the
//! square roots of these differences. The error is checked at some of the spectrum's own indices.

use super::surface::{FoliarFitSetting, ResponseSurface};
use mesophyll_base::chebyshev;
use mesophyll_optics::side::Side;
use rayon::prelude::*;

/// Largest error of R and T that is accepted.
const ERROR: f64 = 3e-5;
/// Nodes along the three axes; the coarsest grid is tried first.
const NODES: [[usize; 3]; 2] = [[4, 3, 2], [6, 4, 3]];
/// Indices of the spectrum at which the error is checked.
const CHECKS: usize = 3;
/// Indices that differ by less than this are treated as equal, and the interpolation is not used.
const APART: f64 = 1e-3;

/// Surfaces at the nodes.
pub struct ResponseSurfaceTable {
    /// Lowest and highest place along each axis.
    range: [[f64; 2]; 3],
    counts: [usize; 3],
    /// The last axis runs fastest.
    nodes: Vec<ResponseSurface>,
}

/// The place of a triple of indices along the axes; `None` where the indices do not have the order of a leaf's.
fn place([cuticle, mesophyll, antidermal]: [f64; 3]) -> Option<[f64; 3]> {
    let (outer, inner) = (cuticle - mesophyll, mesophyll - antidermal);
    let leafy = outer > APART && inner > APART && antidermal > 1.0 + APART;
    leafy.then(|| [outer.sqrt(), mesophyll, inner.sqrt()])
}

fn indices([outer, mesophyll, inner]: [f64; 3]) -> [f64; 3] {
    [mesophyll + outer * outer, mesophyll, mesophyll - inner * inner]
}

/// Weights of the values at `n` Chebyshev nodes on [−1, 1]: their weighted sum is the interpolating polynomial at `t`.
fn weights(n: usize, t: f64) -> Vec<f64> {
    // T_j(t) = cos(j arccos t); the same formula gives T_j at the nodes.
    let angle = t.clamp(-1.0, 1.0).acos();
    let weight = |k: usize| {
        let at = chebyshev::node(k, n).acos();
        let sum: f64 = (1..n).map(|j| (j as f64 * angle).cos() * (j as f64 * at).cos()).sum();
        (1.0 + 2.0 * sum) / n as f64
    };
    (0..n).map(weight).collect()
}

impl ResponseSurfaceTable {
    /// For a spectrum that has these triples of indices, each listed once. `None` where this would need as many
    /// surfaces as there are triples or more, where the indices do not have the order of a leaf's, or where the error
    /// is too large.
    pub fn new(triples: &[[f64; 3]], setting: &FoliarFitSetting, side: Side) -> Option<ResponseSurfaceTable> {
        let places: Vec<[f64; 3]> = triples.iter().map(|t| place(*t)).collect::<Option<_>>()?;
        let range: [[f64; 2]; 3] = std::array::from_fn(|axis| {
            let along = || places.iter().map(|p| p[axis]);
            [along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max)]
        });
        // A corner of the box may have indices out of order although no triple has.
        place(indices([range[0][0], range[1][0], range[2][1]]))?;
        let mut checks: Option<Vec<([f64; 3], ResponseSurface)>> = None;
        for counts in NODES {
            let counts: [usize; 3] =
                std::array::from_fn(|k| if range[k][1] - range[k][0] > 1e-9 { counts[k] } else { 1 });
            let [a, b, c] = counts;
            if a * b * c + CHECKS >= triples.len() {
                return None;
            }
            let at = |axis: usize, k: usize| {
                let [low, high] = range[axis];
                0.5 * (low + high) + 0.5 * (high - low) * chebyshev::node(k, counts[axis])
            };
            let node = |k: usize| indices([at(0, k / (b * c)), at(1, k / c % b), at(2, k % c)]);
            let nodes: Vec<ResponseSurface> =
                (0..a * b * c).into_par_iter().map(|k| ResponseSurface::new(node(k), setting, side)).collect();
            let shared = ResponseSurfaceTable { range, counts, nodes };
            let checks = checks.get_or_insert_with(|| {
                let of = |k: usize| triples[k * (triples.len() - 1) / (CHECKS - 1)];
                (0..CHECKS).into_par_iter().map(of).map(|t| (t, ResponseSurface::new(t, setting, side))).collect()
            });
            let off = |(t, surface): &([f64; 3], ResponseSurface)| {
                shared.at(*t).map_or(f64::INFINITY, |s| s.distance(surface))
            };
            if checks.iter().map(off).fold(0.0, f64::max) < ERROR {
                return Some(shared);
            }
        }
        None
    }

    /// The surface at a triple of indices within the box.
    pub fn at(&self, indices: [f64; 3]) -> Option<ResponseSurface> {
        let place = place(indices)?;
        let [x, y, z]: [Vec<f64>; 3] = std::array::from_fn(|k| {
            let [low, high] = self.range[k];
            let t = if self.counts[k] > 1 { (2.0 * place[k] - low - high) / (high - low) } else { 0.0 };
            weights(self.counts[k], t)
        });
        let [_, b, c] = self.counts;
        let all: Vec<f64> = (0..self.nodes.len()).map(|k| x[k / (b * c)] * y[k / c % b] * z[k % c]).collect();
        Some(ResponseSurface::mixed(&all, &self.nodes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_the_polynomial() {
        for n in [1, 2, 4, 6] {
            for t in [-1.0, -0.3, 0.77, 1.0] {
                let w = weights(n, t);
                for power in 0..n as i32 {
                    let sum: f64 = w.iter().enumerate().map(|(k, w)| w * chebyshev::node(k, n).powi(power)).sum();
                    assert!((sum - t.powi(power)).abs() < 1e-13, "{n} {t} {power}");
                }
            }
        }
    }

    #[test]
    fn indices_out_of_order_are_not_shared() {
        assert_eq!(place([1.4, 1.42, 1.41]), None);
        assert_eq!(place([1.5, 1.41, 1.41]), None);
        let there = place([1.5, 1.42, 1.41]).unwrap();
        assert!(indices(there).iter().zip([1.5, 1.42, 1.41]).all(|(a, b)| (a - b).abs() < 1e-15));
    }
}
