//! Surfaces of many wavelengths, interpolated from surfaces at few triples of refractive indices.
//!
//! Refractive indices change little and smoothly over a spectrum. At one absorption and oblateness, R and T are
//! therefore smooth functions of the three indices. They are computed at the nodes of Chebyshev polynomials over the
//! box that the indices of a spectrum fill, and interpolated in between. The axes of the box are √|n_cuticle −
//! n_mesophyll|, n_mesophyll and n_mesophyll − n_antidermal. The first is a root because the angle of total reflection
//! between cuticle and mesophyll starts like it. On which side of the interface it is changes where the two indices
//! cross, so the wavelengths on either side of a crossing have boxes of their own. The antidermal wall lies between air
//! and the cuticle, and light that comes from the air is never totally reflected at it. The error is checked at some of
//! the spectrum's own indices.

use super::surface::{FoliarFitSetting, ResponseSurface};
use mesophyll_base::chebyshev;
use mesophyll_optics::side::Side;
use rayon::prelude::*;

/// Largest error of R and T that is accepted.
const ERROR: f64 = 3e-5;
/// Nodes along the three axes; the coarsest grid is tried first.
const NODES: [[usize; 3]; 2] = [[4, 3, 2], [6, 4, 3]];
/// The same where the indices of cuticle and mesophyll come nearer than the square of `NEAR`. Narrow lobes then meet
/// the angle of total reflection near grazing light, and an error of 1e-4 is accepted.
const NEAR: f64 = 0.05;
const NEAR_NODES: [usize; 3] = [7, 3, 2];
const NEAR_ERROR: f64 = 1e-4;
/// Indices of the spectrum at which the error is checked.
const CHECKS: usize = 3;
/// An index that is above that of air by less than this is not interpolated.
const APART: f64 = 1e-3;

/// Surfaces at the nodes.
pub struct ResponseSurfaceTable {
    /// Whether the cuticle has a larger index than the mesophyll, or the same.
    order: bool,
    /// Lowest and highest place along each axis.
    range: [[f64; 2]; 3],
    counts: [usize; 3],
    /// The last axis runs fastest.
    nodes: Vec<ResponseSurface>,
}

/// Whether the cuticle's index is that of the mesophyll or larger.
fn order([cuticle, mesophyll, _]: [f64; 3]) -> bool {
    cuticle >= mesophyll
}

/// The place of a triple of indices along the axes.
fn place([cuticle, mesophyll, antidermal]: [f64; 3]) -> [f64; 3] {
    [(cuticle - mesophyll).abs().sqrt(), mesophyll, mesophyll - antidermal]
}

fn indices(order: bool, [outer, mesophyll, inner]: [f64; 3]) -> [f64; 3] {
    let outer = if order { outer * outer } else { -outer * outer };
    [mesophyll + outer, mesophyll, mesophyll - inner]
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
    /// For a spectrum that has these triples of indices, each listed once: one table where the cuticle's index is above
    /// the mesophyll's, and one where it is below. A table is left out where it would need as many surfaces as there
    /// are triples or more, and where its error is too large.
    pub fn both(triples: &[[f64; 3]], setting: &FoliarFitSetting, side: Side) -> Vec<ResponseSurfaceTable> {
        let of = |above: bool| {
            let own: Vec<[f64; 3]> = triples.iter().copied().filter(|t| order(*t) == above).collect();
            ResponseSurfaceTable::new(&own, setting, side)
        };
        [true, false].into_iter().filter_map(of).collect()
    }

    /// For triples of one order.
    fn new(triples: &[[f64; 3]], setting: &FoliarFitSetting, side: Side) -> Option<ResponseSurfaceTable> {
        let order = order(*triples.first()?);
        let places: Vec<[f64; 3]> = triples.iter().map(|t| place(*t)).collect();
        let range: [[f64; 2]; 3] = std::array::from_fn(|axis| {
            let along = || places.iter().map(|p| p[axis]);
            [along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max)]
        });
        // A corner of the box may have the index of air although no triple has.
        let lowest = indices(order, [range[0][usize::from(!order)], range[1][0], range[2][1]]);
        if lowest.iter().any(|n| *n <= 1.0 + APART) {
            return None;
        }
        let mut checks: Option<Vec<([f64; 3], ResponseSurface)>> = None;
        let near = range[0][0] < NEAR;
        let (grids, allowed) = if near { (vec![NEAR_NODES], NEAR_ERROR) } else { (NODES.to_vec(), ERROR) };
        for counts in grids {
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
            let node = |k: usize| indices(order, [at(0, k / (b * c)), at(1, k / c % b), at(2, k % c)]);
            let nodes: Vec<ResponseSurface> =
                (0..a * b * c).into_par_iter().map(|k| ResponseSurface::new(node(k), setting, side)).collect();
            let shared = ResponseSurfaceTable { order, range, counts, nodes };
            let checks = checks.get_or_insert_with(|| {
                let of = |k: usize| triples[k * (triples.len() - 1) / (CHECKS - 1)];
                (0..CHECKS).into_par_iter().map(of).map(|t| (t, ResponseSurface::new(t, setting, side))).collect()
            });
            let off = |(t, surface): &([f64; 3], ResponseSurface)| {
                shared.at(*t).map_or(f64::INFINITY, |s| s.distance(surface))
            };
            if checks.iter().map(off).fold(0.0, f64::max) < allowed {
                return Some(shared);
            }
        }
        None
    }

    /// The surface at a triple of indices within the box; `None` for a triple of the other order.
    pub fn at(&self, indices: [f64; 3]) -> Option<ResponseSurface> {
        if order(indices) != self.order {
            return None;
        }
        let place = place(indices);
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
    fn places_are_those_of_their_indices() {
        for triple in [[1.5, 1.42, 1.41], [1.4, 1.42, 1.43]] {
            let back = indices(order(triple), place(triple));
            assert!(back.iter().zip(triple).all(|(a, b)| (a - b).abs() < 1e-15), "{back:?}");
        }
    }

    /// Where the cuticle's index has fallen below the mesophyll's, and the mesophyll's below the wall's, a table holds
    /// the triples of that side down to the crossing. The other side has too few triples for one.
    #[test]
    fn indices_that_have_crossed_are_interpolated() {
        let setting = FoliarFitSetting {
            palisade: 1.0,
            spongy: 5.0,
            path: mesophyll_optics::foliar::MesophyllPath::Sieve,
            incidence: 0.14,
        };
        let triple = |k: usize| {
            let x = k as f64 / 50.0;
            [1.4301 - 0.05 * x, 1.43 - 0.02 * x, 1.425 - 0.012 * x]
        };
        let triples: Vec<[f64; 3]> = (0..51).map(triple).collect();
        let tables = ResponseSurfaceTable::both(&triples, &setting, Side::Front);
        assert_eq!(tables.len(), 1);
        assert!(tables[0].at(triples[0]).is_none());
        for k in [2, 30] {
            let shared = tables[0].at(triples[k]).unwrap();
            let off = shared.distance(&ResponseSurface::new(triples[k], &setting, Side::Front));
            assert!(off < 2.0 * NEAR_ERROR, "{k}: {off}");
        }
    }
}
