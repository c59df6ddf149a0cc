//! Poisson's equation on a rectangle with insulated sides (Neumann), solved by cosine transforms: the eigenvectors of
//! the five-point Laplacian are those of the DCT-II. Transforms use complex FFTs of the same length (Makhoul 1980),
//! with two real lines in each. Any size is allowed.

use mesophyll_base::fourier::{self as fourier, Complex, FourierTransform};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Solver for maps of one size.
pub struct PoissonSolver {
    width: usize,
    height: usize,
    rows: Cosine,
    columns: Cosine,
}

impl PoissonSolver {
    /// The solver for rectangles of this size.
    pub fn new(width: usize, height: usize) -> PoissonSolver {
        PoissonSolver { width, height, rows: Cosine::new(width), columns: Cosine::new(height) }
    }

    /// The z with Σ over neighbours (z_k − z_n) = r_k, row-major. No z gives the mean of r; it is treated like the
    /// slowest wave.
    pub fn solve(&self, r: &[f64]) -> Vec<f64> {
        let (w, h) = (self.width, self.height);
        let mut rows = r.to_vec();
        self.rows.forward(&mut rows);
        let mut columns = transpose(&rows, w, h);
        self.columns.forward(&mut columns);
        let along = |n: usize, k: usize| (2.0 * (PI * k as f64 / (2 * n) as f64).sin()).powi(2);
        let slowest = along(w.max(h).max(2), 1);
        columns.par_chunks_mut(h).enumerate().for_each(|(i, column)| {
            for (j, v) in column.iter_mut().enumerate() {
                let e = along(w, i) + along(h, j);
                *v /= if i + j == 0 { slowest } else { e };
            }
        });
        self.columns.backward(&mut columns);
        let mut rows = transpose(&columns, h, w);
        self.rows.backward(&mut rows);
        rows
    }
}

/// DCT-II of lines of one length and its inverse.
struct Cosine {
    n: usize,
    forward: FourierTransform,
    backward: FourierTransform,
    /// e^(−iπk/2n).
    turn: Vec<Complex<f64>>,
}

impl Cosine {
    fn new(n: usize) -> Cosine {
        let turn = (0..n).map(|k| Complex::from_polar(1.0, -PI * k as f64 / (2 * n) as f64)).collect();
        Cosine { n, forward: fourier::forward(n), backward: fourier::inverse(n), turn }
    }

    /// X_k = 2 Σ x_n cos(πk(2n+1)/2N) of every line of length N.
    fn forward(&self, lines: &mut [f64]) {
        let n = self.n;
        self.pairs(lines, |x, v| {
            for k in 0..n.div_ceil(2) {
                v[k] = x[2 * k];
            }
            for k in 0..n / 2 {
                v[n - 1 - k] = x[2 * k + 1];
            }
            self.forward.process(v);
            for k in 0..n {
                x[k] = self.turn[k] * v[k] + self.turn[k].conj() * v[if k == 0 { 0 } else { n - k }];
            }
        });
    }

    /// The inverse.
    fn backward(&self, lines: &mut [f64]) {
        let n = self.n;
        let share = 0.5 / n as f64;
        self.pairs(lines, |x, v| {
            for k in 0..n {
                let opposite = if k == 0 { Complex::new(0.0, 0.0) } else { x[n - k] };
                v[k] = self.turn[k].conj() * (x[k] - Complex::new(0.0, 1.0) * opposite) * share;
            }
            self.backward.process(v);
            for k in 0..n.div_ceil(2) {
                x[2 * k] = v[k];
            }
            for k in 0..n / 2 {
                x[2 * k + 1] = v[n - 1 - k];
            }
        });
    }

    /// Works on two lines at a time, with the second as the imaginary part. This is possible because the work is linear
    /// over the complex numbers.
    fn pairs(&self, lines: &mut [f64], work: impl Fn(&mut [Complex<f64>], &mut [Complex<f64>]) + Sync) {
        let n = self.n;
        let start = || (vec![Complex::new(0.0, 0.0); n], vec![Complex::new(0.0, 0.0); n]);
        lines.par_chunks_mut(2 * n).for_each_init(start, |(x, v), pair| {
            for k in 0..n {
                x[k] = Complex::new(pair[k], pair.get(n + k).copied().unwrap_or(0.0));
            }
            work(x, v);
            for (k, p) in pair.iter_mut().enumerate() {
                *p = if k < n { x[k].re } else { x[k - n].im };
            }
        });
    }
}

/// `map` has `height` rows of `width`.
fn transpose(map: &[f64], width: usize, height: usize) -> Vec<f64> {
    const BLOCK: usize = 16;
    let mut out = vec![0.0; map.len()];
    out.par_chunks_mut(BLOCK * height).enumerate().for_each(|(band, out)| {
        let columns = out.len() / height;
        for top in (0..height).step_by(BLOCK) {
            for c in 0..columns {
                for r in top..(top + BLOCK).min(height) {
                    out[c * height + r] = map[r * width + band * BLOCK + c];
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_is_the_sum() {
        for n in [1, 2, 3, 7, 16] {
            let x: Vec<f64> = (0..3 * n).map(|k| (k as f64 * 1.7).sin() + 0.1).collect();
            let mut lines = x.clone();
            let cosine = Cosine::new(n);
            cosine.forward(&mut lines);
            for (line, from) in lines.chunks(n).zip(x.chunks(n)) {
                for (k, found) in line.iter().enumerate() {
                    let term =
                        |(m, v): (usize, &f64)| 2.0 * v * (PI * k as f64 * (2 * m + 1) as f64 / (2 * n) as f64).cos();
                    let want: f64 = from.iter().enumerate().map(term).sum();
                    assert!((found - want).abs() < 1e-12, "{n} {k}: {found} {want}");
                }
            }
            cosine.backward(&mut lines);
            assert!(lines.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-13));
        }
    }

    #[test]
    fn poisson_is_solved() {
        for (w, h) in [(13, 8), (1, 5), (6, 1), (9, 9)] {
            let z: Vec<f64> = (0..w * h).map(|k| (k as f64 * 0.9).cos()).collect();
            let mut r = vec![0.0; w * h];
            for k in 0..w * h {
                for (there, n) in [(k % w + 1 < w, k + 1), (k / w + 1 < h, k + w)] {
                    if there {
                        r[k] += z[k] - z[n];
                        r[n] -= z[k] - z[n];
                    }
                }
            }
            let found = PoissonSolver::new(w, h).solve(&r);
            let mean = |z: &[f64]| z.iter().sum::<f64>() / z.len() as f64;
            let (a, b) = (mean(&z), mean(&found));
            assert!(z.iter().zip(&found).all(|(x, y)| (x - a - y + b).abs() < 1e-12), "{w}×{h}");
        }
    }
}
