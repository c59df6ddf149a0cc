//! Thickness levels: a few thicknesses whose kernels are computed. The kernel of any other thickness is a weighted sum
//! of theirs; the weights depend on the thickness of the texel that the light enters.
//!
//! Kernels are interpolated as *shapes* (sum 1). Their weights are multiplied by the total transmittance of each
//! texel's own thickness. So the energy is exact with any number of levels, and only the shape is approximated. Weights
//! of every kind add up to 1.

use super::kernel::Kernel;
use mesophyll_base::chebyshev;
use rayon::prelude::*;
use std::f64::consts::PI;

/// How many levels there are, and how the shape between them is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ThicknessLevels {
    /// How many levels, 1 or more.
    pub count: usize,
    /// How the shape between them is found.
    pub kind: LevelKind,
}

impl Default for ThicknessLevels {
    fn default() -> Self {
        ThicknessLevels { count: 8, kind: LevelKind::Chebyshev }
    }
}

/// Interpolation between the levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LevelKind {
    /// Even steps of d, straight lines.
    Linear,
    /// Even steps of ln d, cubics through four neighbours.
    Cubic,
    /// One polynomial through Chebyshev nodes in ln d.
    Chebyshev,
    /// The mean shape and the principal shapes of many thicknesses.
    Svd,
}

/// The thicknesses for which kernels are built, and the weights of a thickness between them.
#[derive(Debug, Clone)]
pub(crate) struct Nodes {
    /// mm, ascending.
    pub thickness: Vec<f64>,
    kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Exact,
    Linear,
    Cubic,
    Chebyshev,
    /// Chebyshev weights of many thicknesses, then `[sample * count + level]` weights of the principal shapes.
    Mixed(Vec<f64>),
}

/// How many thicknesses the principal shapes are computed from.
pub(crate) const SAMPLES: usize = 32;

impl Nodes {
    /// `count` ≥ 1 nodes over [thinnest, thickest] (mm, positive). For SVD they are the samples that
    /// [`Nodes::principal`] mixes.
    pub fn new(kind: LevelKind, count: usize, thinnest: f64, thickest: f64) -> Nodes {
        if !(thickest > thinnest * (1.0 + 1e-12)) || count < 2 {
            return Nodes { thickness: vec![(thinnest * thickest).sqrt()], kind: Kind::Exact };
        }
        let count = if kind == LevelKind::Svd { SAMPLES.max(count) } else { count };
        let (low, high) = (thinnest.ln(), thickest.ln());
        let even = |k: usize| k as f64 / (count - 1) as f64;
        let thickness = (0..count).map(|k| match kind {
            LevelKind::Linear => thinnest + (thickest - thinnest) * even(k),
            LevelKind::Cubic => (low + (high - low) * even(k)).exp(),
            LevelKind::Chebyshev | LevelKind::Svd => {
                (0.5 * (low + high) - 0.5 * (high - low) * chebyshev::node(k, count)).exp()
            }
        });
        let kind = match kind {
            LevelKind::Linear => Kind::Linear,
            LevelKind::Cubic if count >= 4 => Kind::Cubic,
            _ => Kind::Chebyshev,
        };
        Nodes { thickness: thickness.collect(), kind }
    }

    /// Each of a few thicknesses has its own kernel.
    pub fn exact(thickness: Vec<f64>) -> Nodes {
        Nodes { thickness, kind: Kind::Exact }
    }

    /// The mean shape, and the `count` − 1 principal deviations from it, of the shapes at the nodes. From here on the
    /// weights are those of the new shapes. Deviations sum to 0, so the sum stays 1 with any number of them.
    pub(crate) fn principal(&mut self, shapes: &[Kernel], count: usize) -> Vec<Kernel> {
        let (n, count) = (shapes.len(), count.min(shapes.len()));
        let mean = Kernel::combine(shapes, &vec![1.0 / n as f64; n]);
        let apart: Vec<Kernel> =
            shapes.iter().map(|s| Kernel::combine(&[s.clone(), mean.clone()], &[1.0, -1.0])).collect();
        let gram = nalgebra::DMatrix::from_fn(n, n, |a, b| apart[a].dot(&apart[b]));
        let eigen = gram.symmetric_eigen();
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let mut mix = vec![0.0; n * count];
        let mut found = vec![mean];
        for (level, &at) in order.iter().take(count - 1).enumerate() {
            let direction: Vec<f64> = eigen.eigenvectors.column(at).iter().copied().collect();
            found.push(Kernel::combine(&apart, &direction));
            for sample in 0..n {
                mix[sample * count + level + 1] = direction[sample];
            }
        }
        (0..n).for_each(|sample| mix[sample * count] = 1.0);
        self.kind = Kind::Mixed(mix);
        found
    }

    /// Number of weights.
    pub fn count(&self) -> usize {
        match &self.kind {
            Kind::Mixed(mix) => mix.len() / self.thickness.len(),
            _ => self.thickness.len(),
        }
    }

    /// Weights of thickness `d` > 0; thicknesses beyond the range take the shape at its end.
    pub fn weights(&self, d: f64, out: &mut [f64]) {
        let n = self.thickness.len();
        out.fill(0.0);
        match &self.kind {
            Kind::Mixed(mix) => {
                let mut samples = vec![0.0; n];
                self.chebyshev(d, &mut samples);
                let count = out.len();
                for (sample, w) in samples.iter().enumerate() {
                    out.iter_mut().zip(&mix[sample * count..]).for_each(|(o, m)| *o += w * m);
                }
            }
            Kind::Exact => {
                let k = self.thickness.partition_point(|&t| t < d).min(n - 1);
                let nearer = k > 0 && d - self.thickness[k - 1] < self.thickness[k] - d;
                out[k - usize::from(nearer)] = 1.0;
            }
            Kind::Linear => {
                let d = d.clamp(self.thickness[0], self.thickness[n - 1]);
                let k = self.thickness.partition_point(|&t| t <= d).clamp(1, n - 1);
                let share = (d - self.thickness[k - 1]) / (self.thickness[k] - self.thickness[k - 1]);
                (out[k - 1], out[k]) = (1.0 - share, share);
            }
            Kind::Cubic => {
                let (low, high) = (self.thickness[0].ln(), self.thickness[n - 1].ln());
                let at = ((d.ln() - low) / (high - low)).clamp(0.0, 1.0) * (n - 1) as f64;
                let first = (at as usize).saturating_sub(1).min(n - 4);
                let u = at - first as f64;
                out[first] = -(u - 1.0) * (u - 2.0) * (u - 3.0) / 6.0;
                out[first + 1] = u * (u - 2.0) * (u - 3.0) / 2.0;
                out[first + 2] = -u * (u - 1.0) * (u - 3.0) / 2.0;
                out[first + 3] = u * (u - 1.0) * (u - 2.0) / 6.0;
            }
            Kind::Chebyshev => self.chebyshev(d, out),
        }
    }

    /// Barycentric weights on the nodes' ln d.
    fn chebyshev(&self, d: f64, out: &mut [f64]) {
        let n = self.thickness.len();
        // The range ends a little beyond the first and last node.
        let edge = 1.0 / (PI / (2.0 * n as f64)).cos();
        let (first, last) = (self.thickness[0].ln(), self.thickness[n - 1].ln());
        let x = ((2.0 * d.ln() - first - last) / (last - first) * (1.0 / edge)).clamp(-1.0, 1.0);
        let mut sum = 0.0;
        for k in 0..n {
            let angle = chebyshev::angle(k, n);
            let gap = x + angle.cos();
            if gap.abs() < 1e-15 {
                out.fill(0.0);
                out[k] = 1.0;
                return;
            }
            out[k] = angle.sin() / gap * if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += out[k];
        }
        out.iter_mut().for_each(|w| *w /= sum);
    }
}

/// Smooth functions of x as Chebyshev series in ln x. The first function is positive and stored as its logarithm; the
/// others are stored divided by the first.
#[derive(Debug, Clone)]
pub(crate) struct Curves<const M: usize> {
    low: f64,
    high: f64,
    series: [Vec<f64>; M],
}

impl<const M: usize> Curves<M> {
    /// The relative error is about 1e-12 for the first function and 1e-9 for the others. `None` where, in [low, high],
    /// the first function is not positive, a function is not finite, or one is too rough for 512 terms.
    pub fn fit(f: impl Fn(f64) -> [f64; M] + Sync, low: f64, high: f64) -> Option<Curves<M>> {
        let (low, high) = (low.ln(), high.ln());
        for n in [32usize, 64, 128, 256, 512] {
            let values: Vec<[f64; M]> = (0..n)
                .into_par_iter()
                .map(|k| {
                    let v = f((0.5 * (low + high) + 0.5 * (high - low) * chebyshev::node(k, n)).exp());
                    std::array::from_fn(|m| if m == 0 { v[0].ln() } else { v[m] / v[0] })
                })
                .collect();
            if !values.iter().flatten().all(|v| v.is_finite()) {
                return None;
            }
            let series: [Vec<f64>; M] = std::array::from_fn(|m| {
                let term = |j: usize| {
                    let sum: f64 = values
                        .iter()
                        .enumerate()
                        .map(|(k, v)| v[m] * (PI * j as f64 * (k as f64 + 0.5) / n as f64).cos())
                        .sum();
                    sum * if j == 0 { 1.0 } else { 2.0 } / n as f64
                };
                let all: Vec<f64> = (0..n).map(term).collect();
                let small = all.iter().fold(1.0f64, |s, c| s.max(c.abs())) * if m == 0 { 1e-13 } else { 1e-10 };
                let keep = all.iter().rposition(|c| c.abs() > small).unwrap_or(0) + 1;
                all[..keep].to_vec()
            });
            if series.iter().all(|s| s.len() + 4 <= n) {
                return Some(Curves { low, high, series });
            }
        }
        None
    }

    /// The functions at `x`, if it lies in the range.
    pub fn at(&self, x: f64) -> Option<[f64; M]> {
        let t = (2.0 * x.ln() - self.low - self.high) / (self.high - self.low);
        if !(t.abs() <= 1.0 + 1e-9) {
            return None;
        }
        let mut values: [f64; M] = std::array::from_fn(|m| chebyshev::sum(&self.series[m], t));
        values[0] = values[0].exp();
        for m in 1..M {
            values[m] *= values[0];
        }
        Some(values)
    }
}
