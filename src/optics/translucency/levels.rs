//! Thickness levels: the kernel of any thickness as a sum of a few, weighted by the thickness of the texel that the light enters.
//!
//! Kernels are interpolated as *shapes* (sum 1); the transmitted total of each texel's own thickness multiplies the weights, so that the
//! energy is exact with any number of levels and only the shape is approximated. Weights of every kind add up to 1.

use std::f64::consts::PI;

/// How many levels, and how the shape between them is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Levels {
    pub count: usize,
    pub kind: LevelKind,
}

impl Default for Levels {
    fn default() -> Self {
        Levels { count: 8, kind: LevelKind::Chebyshev }
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

/// Thicknesses that kernels are built at, and the weights of a thickness between them.
#[derive(Debug, Clone)]
pub(crate) struct Nodes {
    /// mm, ascending.
    pub thickness: Vec<f64>,
    kind: Kind,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Exact,
    Linear,
    Cubic,
    Chebyshev,
}

impl Nodes {
    /// `count` ≥ 1 nodes over [thinnest, thickest] (mm, positive). SVD samples as Chebyshev does.
    pub fn new(kind: LevelKind, count: usize, thinnest: f64, thickest: f64) -> Nodes {
        if !(thickest > thinnest * (1.0 + 1e-12)) || count < 2 {
            return Nodes { thickness: vec![(thinnest * thickest).sqrt()], kind: Kind::Exact };
        }
        let (low, high) = (thinnest.ln(), thickest.ln());
        let even = |k: usize| k as f64 / (count - 1) as f64;
        let thickness = (0..count).map(|k| match kind {
            LevelKind::Linear => thinnest + (thickest - thinnest) * even(k),
            LevelKind::Cubic => (low + (high - low) * even(k)).exp(),
            LevelKind::Chebyshev | LevelKind::Svd => {
                (0.5 * (low + high) - 0.5 * (high - low) * (PI * (k as f64 + 0.5) / count as f64).cos()).exp()
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

    /// Weights of thickness `d` > 0; thicknesses beyond the range take the shape at its end.
    pub fn weights(&self, d: f64, out: &mut [f64]) {
        let n = self.thickness.len();
        out.fill(0.0);
        match self.kind {
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
            Kind::Chebyshev => {
                // Barycentric, on the ends of the range where the first and last node leave a little over.
                let edge = 1.0 / (PI / (2.0 * n as f64)).cos();
                let (first, last) = (self.thickness[0].ln(), self.thickness[n - 1].ln());
                let x = ((2.0 * d.ln() - first - last) / (last - first) / edge).clamp(-1.0, 1.0);
                let mut sum = 0.0;
                for k in 0..n {
                    let angle = PI * (k as f64 + 0.5) / n as f64;
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
    }
}

/// A smooth positive function as a Chebyshev series of its logarithm over ln x: quick, and to about 1e-12.
#[derive(Debug, Clone)]
pub(crate) struct Curve {
    low: f64,
    high: f64,
    coefficients: Vec<f64>,
}

impl Curve {
    /// `None` where `f` is not positive and finite all over [low, high], or too rough for 513 coefficients.
    pub fn fit(f: impl Fn(f64) -> f64 + Sync, low: f64, high: f64) -> Option<Curve> {
        use rayon::prelude::*;
        let (low, high) = (low.ln(), high.ln());
        for n in [32usize, 64, 128, 256, 512] {
            let x = |k: usize| (PI * (k as f64 + 0.5) / n as f64).cos();
            let values: Vec<f64> = (0..n).into_par_iter().map(|k| f((0.5 * (low + high) + 0.5 * (high - low) * x(k)).exp()).ln()).collect();
            if !values.iter().all(|v| v.is_finite()) {
                return None;
            }
            let coefficients: Vec<f64> = (0..n)
                .map(|j| {
                    let sum: f64 = values.iter().enumerate().map(|(k, v)| v * (PI * j as f64 * (k as f64 + 0.5) / n as f64).cos()).sum();
                    sum * if j == 0 { 1.0 } else { 2.0 } / n as f64
                })
                .collect();
            let size = coefficients.iter().fold(1.0f64, |m, c| m.max(c.abs()));
            let keep = coefficients.iter().rposition(|c| c.abs() > 1e-13 * size).unwrap_or(0) + 1;
            if keep + 4 <= n {
                return Some(Curve { low, high, coefficients: coefficients[..keep].to_vec() });
            }
        }
        None
    }

    /// The function at `x`, if it lies in the range.
    pub fn at(&self, x: f64) -> Option<f64> {
        let y = x.ln();
        let t = (2.0 * y - self.low - self.high) / (self.high - self.low);
        if !(t.abs() <= 1.0 + 1e-9) {
            return None;
        }
        let (mut b1, mut b2) = (0.0, 0.0);
        for c in self.coefficients.iter().skip(1).rev() {
            (b1, b2) = (2.0 * t * b1 - b2 + c, b1);
        }
        Some((self.coefficients[0] + t * b1 - b2).exp())
    }
}
