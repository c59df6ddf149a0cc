//! The kernel of one thickness on a texel grid: the light that enters at a texel's centre, integrated over every texel it leaves from.
//!
//! The radial flow j(r) = G(r)/(2πr), G(r) = 2π ∫_r^∞ T s ds, has the divergence −T away from the source. What a texel receives is therefore what flows in
//! over its edges less what flows out: one smooth integral an edge, however thin the blade and even where T itself is infinite, and the sum over
//! all texels is the total, exactly, because every inner edge counts once with each sign. No aliasing, no sampling of the peak.

use super::levels::Curve;
use crate::optics::slab::quadrature::gauss;

/// Weights of one quadrant, (i, j) ≥ 0 texels away, row j: `weights[j * (reach + 1) + i]`; symmetric in i and j and under both reflections.
#[derive(Debug, Clone)]
pub(crate) struct Kernel {
    /// Farthest texel on either side.
    pub reach: usize,
    pub weights: Vec<f64>,
}

impl Kernel {
    pub fn at(&self, i: usize, j: usize) -> f64 {
        if i > self.reach || j > self.reach { 0.0 } else { self.weights[j * (self.reach + 1) + i] }
    }

    /// All light leaves where it entered.
    pub fn delta(reach: usize) -> Kernel {
        let mut weights = vec![0.0; (reach + 1) * (reach + 1)];
        weights[0] = 1.0;
        Kernel { reach, weights }
    }

    /// From the share `beyond` of the light that leaves farther than r (mm) away (1 at r = 0), on texels of `texel` mm. `closed`: what lies beyond
    /// the reach is given to the outermost texels, so that the sum is 1; otherwise it is left out.
    pub fn build(beyond: impl Fn(f64) -> f64 + Sync, texel: f64, reach: usize, closed: bool) -> Kernel {
        let curve = Curve::fit(&beyond, 0.499 * texel, farthest(texel, reach));
        let [kernel] = Kernel::with_partials(|r| [curve.as_ref().and_then(|c| c.at(r)).unwrap_or_else(|| beyond(r))], texel, reach, closed);
        kernel
    }

    /// A kernel and its derivatives by some parameters: `beyond(r)` holds the share (1 at r = 0) and then its derivatives (0 at r = 0), for r from half a
    /// texel to [`farthest`]. Weights are linear in it, so that the derivatives are exact.
    pub fn with_partials<const N: usize>(beyond: impl Fn(f64) -> [f64; N] + Sync, texel: f64, reach: usize, closed: bool) -> [Kernel; N] {
        let edges = edges(beyond, texel, reach, closed);
        let n = reach + 1;
        std::array::from_fn(|which| {
            let mut weights = vec![0.0; n * n];
            let source = if which == 0 { 1.0 } else { 0.0 };
            for j in 0..n {
                for i in 0..=j {
                    // Flow over the edges at i ± 1/2 along x and at j ± 1/2 along y.
                    let across = |a: usize, b: usize| match a {
                        0 => -2.0 * edges[b][which],
                        _ => edges[(a - 1) * n + b][which] - edges[a * n + b][which],
                    };
                    let w = if i + j == 0 { source } else { 0.0 } + across(i, j) + across(j, i);
                    weights[j * n + i] = w;
                    weights[i * n + j] = w;
                }
            }
            Kernel { reach, weights }
        })
    }

    #[cfg(test)]
    pub fn sum(&self) -> f64 {
        let n = self.reach + 1;
        let times = |k: usize| if k == 0 { 1.0 } else { 2.0 };
        (0..n * n).rev().map(|k| self.weights[k] * times(k % n) * times(k / n)).sum()
    }
}

/// Radius (mm) that no edge of a kernel lies beyond.
pub(crate) fn farthest(texel: f64, reach: usize) -> f64 {
    std::f64::consts::SQRT_2 * (reach as f64 + 1.0) * texel
}

/// Flow over the edge x = (i + ½) texels, y from (j − ½) to (j + ½): `[i * (reach + 1) + j]`.
fn edges<const N: usize>(beyond: impl Fn(f64) -> [f64; N] + Sync, texel: f64, reach: usize, closed: bool) -> Vec<[f64; N]> {
    use rayon::prelude::*;
    let (fine, coarse) = (gauss(24), gauss(10));
    let n = reach + 1;
    let mut edges = vec![[0.0; N]; n * n];
    edges.par_chunks_mut(n).enumerate().for_each(|(i, row)| {
        if closed && i == reach {
            return;
        }
        let x = (i as f64 + 0.5) * texel;
        let rule = if i < 2 { &fine } else { &coarse };
        for (j, edge) in row.iter_mut().enumerate() {
            for q in rule {
                let y = (j as f64 - 0.5 + q.x) * texel;
                let r2 = x * x + y * y;
                let weight = q.w * texel * x / (2.0 * std::f64::consts::PI * r2);
                edge.iter_mut().zip(beyond(r2.sqrt())).for_each(|(e, g)| *e += weight * g);
            }
        }
    });
    edges
}
