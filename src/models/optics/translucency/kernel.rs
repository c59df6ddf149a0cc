//! The kernel of one thickness on a grid of texels: light enters at a texel's centre, and the light that leaves is
//! integrated over each texel.
//!
//! The radial flow j(r) = G(r)/(2πr), with G(r) = 2π ∫_r^∞ T s ds, has the divergence −T away from the source. So the
//! light of a texel is the flow over its edges inwards less the flow outwards. That takes one smooth integral for each
//! edge, however thin the blade is, and even where T itself is infinite. The sum over all texels is exactly the total,
//! because every inner edge counts once with each sign. There is no aliasing, and the peak is never sampled.

use super::levels::Curves;
use crate::slab::quadrature::gauss;
use rayon::prelude::*;

/// Weights of one quadrant: `weights[j * (reach + 1) + i]` belongs to the texel i columns and j rows away, i, j ≥ 0.
/// They are symmetric in i and j and under both reflections.
#[derive(Debug, Clone)]
pub(crate) struct Kernel {
    /// Largest number of texels to either side.
    pub reach: usize,
    pub weights: Vec<f64>,
}

impl Kernel {
    pub fn at(&self, i: usize, j: usize) -> f64 {
        if i > self.reach || j > self.reach { 0.0 } else { self.weights[j * (self.reach + 1) + i] }
    }

    /// The kernel of light that leaves where it entered.
    pub fn delta(reach: usize) -> Kernel {
        let mut delta = Kernel::none(reach);
        delta.weights[0] = 1.0;
        delta
    }

    /// The kernel without any light.
    pub fn none(reach: usize) -> Kernel {
        Kernel { reach, weights: vec![0.0; (reach + 1) * (reach + 1)] }
    }

    /// Σ weight × kernel; all kernels have the same reach.
    pub fn combine(kernels: &[Kernel], weights: &[f64]) -> Kernel {
        let mut sum = Kernel { reach: kernels[0].reach, weights: vec![0.0; kernels[0].weights.len()] };
        for (kernel, w) in kernels.iter().zip(weights) {
            sum.weights.iter_mut().zip(&kernel.weights).for_each(|(s, k)| *s += w * k);
        }
        sum
    }

    /// Scalar product over the whole plane.
    pub fn dot(&self, other: &Kernel) -> f64 {
        let n = self.reach + 1;
        let times = |k: usize| if k == 0 { 1.0 } else { 2.0 };
        (0..n * n).rev().map(|k| self.weights[k] * other.weights[k] * times(k % n) * times(k / n)).sum()
    }

    /// Builds the kernel from `beyond`, the share of the light that leaves farther than r (mm) away (1 at r = 0), on
    /// texels of `texel` mm. With `closed`, the light beyond the reach is given to the outermost texels, so that the
    /// sum is 1; otherwise it is left out. Further components of `beyond` are derivatives of the first (0 at r = 0) and
    /// become derivatives of the kernel.
    pub fn build<const M: usize>(
        beyond: impl Fn(f64) -> [f64; M] + Sync,
        texel: f64,
        reach: usize,
        closed: bool,
    ) -> [Kernel; M] {
        let edges = edges(beyond, texel, reach, closed);
        let n = reach + 1;
        std::array::from_fn(|m| {
            // Flow over the edges at a ± 1/2 along one axis and at b along the other.
            let across = |a: usize, b: usize| {
                if a == 0 { -2.0 * edges[b][m] } else { edges[(a - 1) * n + b][m] - edges[a * n + b][m] }
            };
            let mut weights = vec![0.0; n * n];
            for j in 0..n {
                for i in 0..=j {
                    let w = if m + i + j == 0 { 1.0 } else { 0.0 } + across(i, j) + across(j, i);
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

/// Flow over the edge x = (i + ½) texels, y from (j − ½) to (j + ½): `[i * (reach + 1) + j]`.
fn edges<const M: usize>(
    beyond: impl Fn(f64) -> [f64; M] + Sync,
    texel: f64,
    reach: usize,
    closed: bool,
) -> Vec<[f64; M]> {
    let (near, middle, far) = (gauss(24), gauss(10), gauss(4));
    let n = reach + 1;
    let mut edges = vec![[0.0; M]; n * n];
    let curves = Curves::fit(&beyond, 0.499 * texel, std::f64::consts::SQRT_2 * n as f64 * texel);
    edges.par_chunks_mut(n).enumerate().for_each(|(i, row)| {
        if closed && i == reach {
            return;
        }
        let x = (i as f64 + 0.5) * texel;
        for (j, edge) in row.iter_mut().enumerate() {
            let rule = if i < 2 && j < 8 {
                &near
            } else if i.max(j) < 8 {
                &middle
            } else {
                &far
            };
            for q in rule {
                let y = (j as f64 - 0.5 + q.x) * texel;
                let r2 = x * x + y * y;
                let g = curves.as_ref().and_then(|c| c.at(r2.sqrt())).unwrap_or_else(|| beyond(r2.sqrt()));
                let part = q.w * texel * x / (2.0 * std::f64::consts::PI * r2);
                edge.iter_mut().zip(&g).for_each(|(e, g)| *e += part * g);
            }
        }
    });
    edges
}
