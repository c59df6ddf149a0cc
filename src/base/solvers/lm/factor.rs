//! The linear algebra of a step: one QR of the free columns serves all dampings, which work on its small triangle.

// A comparison with NaN is false, so `!(a < b)` is written where NaN must fail.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::iteration::{Run, dot};
use crate::solvers::{decomposition, qr};
use nalgebra::DMatrix;

/// QR of the free columns of the Jacobian, for steps with any damping.
pub(super) struct Factor {
    /// n × n upper triangle, column-major.
    r: Vec<f64>,
    /// Top of −Qᵀ residuals.
    b: Vec<f64>,
    weight: Vec<f64>,
    n: usize,
    /// Whether no diagonal entry is zero to rounding.
    regular: bool,
}

impl Factor {
    pub(super) fn new(run: &Run, free: &[usize]) -> Self {
        let (n, m) = (free.len(), run.m);
        let mut j: Vec<f64> = free.iter().flat_map(|&k| run.column(k).iter().copied()).collect();
        let mut b: Vec<f64> = run.r.iter().map(|r| -r).collect();
        qr::reduce(&mut j, m, n, &mut b);
        // Where there are fewer residuals than parameters, the missing rows are zero.
        let r: Vec<f64> =
            (0..n * n).map(|k| if k % n <= k / n && k % n < m { j[k / n * m + k % n] } else { 0.0 }).collect();
        b.resize(n, 0.0);
        let weight: Vec<f64> = free.iter().map(|&k| run.weight(k)).collect();
        let diagonal = |k: usize| (r[k * n + k] / weight[k]).abs();
        let largest = (0..n).map(diagonal).fold(0.0, f64::max);
        let regular = (0..n).all(|k| diagonal(k) > n as f64 * f64::EPSILON * largest);
        Factor { r, b, weight, n, regular }
    }

    /// Returns whether λ = 0, and the step p. |D p| is within a tenth of `radius`, or p is shorter and undamped (Moré,
    /// section 5).
    pub(super) fn step(&self, radius: f64) -> (bool, Vec<f64>) {
        let n = self.n;
        let mut lower = 0.0;
        if self.regular {
            let p = qr::solve_upper(&self.r, n, n, &self.b);
            let length = self.length(&p);
            if length <= 1.1 * radius {
                return (true, p);
            }
            lower = (length - radius) / (radius * self.newton_slope(&self.r, &p, length));
        }
        // |D⁻¹ Rᵀ b| / Δ is an upper bound of λ.
        let pull: Vec<f64> = (0..n).map(|k| dot(&self.r[k * n..=k * n + k], &self.b[..=k]) / self.weight[k]).collect();
        let pull = qr::length(&pull);
        let mut upper = pull / radius;
        let mut lambda = if lower > 0.0 { lower } else { 1e-3 * upper };
        let mut p = vec![0.0; n];
        for _ in 0..20 {
            if !(lambda > lower && lambda < upper) && lambda != lower {
                lambda = (lower * upper).sqrt().max(1e-3 * upper);
            }
            if !(lambda > 0.0 && lambda.is_finite()) {
                break;
            }
            let (triangle, step) = self.damp(lambda);
            p = step;
            let length = self.length(&p);
            let excess = length - radius;
            if excess.abs() <= 0.1 * radius || !excess.is_finite() {
                break;
            }
            if excess > 0.0 {
                lower = lower.max(lambda);
            } else {
                upper = upper.min(lambda);
            }
            lambda = (lambda + excess / (radius * self.newton_slope(&triangle, &p, length))).max(lower);
        }
        (false, p)
    }

    /// Length of the residuals' projection on the model's tangent. Divided by |r| it is the cosine of Bates and Watts;
    /// the cosine's square is the share of the cost that a linear model could still remove. Directions without rank do
    /// not count, because the tangent is only rounding there.
    pub(super) fn offset(&self, tolerance: f64) -> f64 {
        let n = self.n;
        let scale: Vec<f64> = (0..n).map(|k| qr::length(&self.r[k * n..(k + 1) * n])).collect();
        let scaled = DMatrix::from_fn(n, n, |i, j| if scale[j] > 0.0 { self.r[j * n + i] / scale[j] } else { 0.0 });
        let Some(svd) = decomposition::svd(scaled) else { return f64::NAN };
        let Some(u) = svd.u else { return f64::NAN };
        let cut = tolerance * svd.singular_values.max();
        let kept = (0..n).filter(|k| svd.singular_values[*k] > cut);
        qr::length(&kept.map(|k| dot(u.column(k).as_slice(), &self.b)).collect::<Vec<_>>())
    }

    fn length(&self, p: &[f64]) -> f64 {
        qr::length(&p.iter().zip(&self.weight).map(|(p, w)| p * w).collect::<Vec<_>>())
    }

    /// |R⁻ᵀ D² p|² / |D p|²: minus the derivative of |D p| to λ, over |D p|.
    fn newton_slope(&self, triangle: &[f64], p: &[f64], length: f64) -> f64 {
        let n = self.n;
        let rows = triangle.len() / n;
        let v: Vec<f64> = p.iter().zip(&self.weight).map(|(p, w)| w * (w * p / length)).collect();
        let s = qr::length(&qr::solve_upper_transposed(triangle, rows, n, &v));
        s * s
    }

    /// Solves [R; √λ D] p = [b; 0]; returns the triangle (2n rows) and p.
    fn damp(&self, lambda: f64) -> (Vec<f64>, Vec<f64>) {
        let n = self.n;
        let root = lambda.sqrt();
        let mut a = vec![0.0; 2 * n * n];
        for k in 0..n {
            a[2 * n * k..2 * n * k + n].copy_from_slice(&self.r[n * k..n * (k + 1)]);
            a[2 * n * k + n + k] = root * self.weight[k];
        }
        let mut b = self.b.clone();
        b.resize(2 * n, 0.0);
        qr::reduce(&mut a, 2 * n, n, &mut b);
        let p = qr::solve_upper(&a, 2 * n, n, &b);
        (a, p)
    }
}
