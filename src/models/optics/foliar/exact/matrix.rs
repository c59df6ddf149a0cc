//! Small dense matrices of any [`Real`].

use crate::number::Real;

/// A matrix, row by row.
#[derive(Debug, Clone)]
pub struct Matrix<N> {
    /// How many rows.
    pub rows: usize,
    /// How many columns.
    pub columns: usize,
    /// Its entries.
    pub entries: Vec<N>,
}

impl<N: Real> Matrix<N> {
    /// From a function of row and column.
    pub fn from_fn(rows: usize, columns: usize, f: impl Fn(usize, usize) -> N) -> Self {
        let entries = (0..rows * columns).map(|k| f(k / columns.max(1), k % columns.max(1))).collect();
        Matrix { rows, columns, entries }
    }

    /// Row `k`.
    pub fn row(&self, k: usize) -> &[N] {
        &self.entries[k * self.columns..(k + 1) * self.columns]
    }

    /// Entry.
    pub fn at(&self, row: usize, column: usize) -> N {
        self.entries[row * self.columns + column]
    }

    /// The product with `o`. If `o` has more rows than this matrix has columns, only its first rows are used.
    pub fn times(&self, o: &Matrix<N>) -> Matrix<N> {
        let mut entries = vec![N::of(0.0); self.rows * o.columns];
        for (row, out) in entries.chunks_exact_mut(o.columns.max(1)).enumerate() {
            for (k, &x) in self.row(row).iter().enumerate() {
                for (to, &y) in out.iter_mut().zip(o.row(k)) {
                    *to = *to + x * y;
                }
            }
        }
        Matrix { rows: self.rows, columns: o.columns, entries }
    }

    /// Each row times a number.
    pub fn scaled(mut self, by: &[N]) -> Matrix<N> {
        for (row, &x) in self.entries.chunks_exact_mut(self.columns.max(1)).zip(by) {
            row.iter_mut().for_each(|y| *y = *y * x);
        }
        self
    }

    /// The row vector `weights` times this matrix.
    pub fn applied(&self, weights: &[N]) -> Vec<N> {
        let row = Matrix { rows: 1, columns: weights.len(), entries: weights.to_vec() };
        row.times(self).entries
    }

    /// The first `rows` rows.
    pub fn head(&self, rows: usize) -> Matrix<N> {
        Matrix { rows, columns: self.columns, entries: self.entries[..rows * self.columns].to_vec() }
    }

    /// Adds `o`. If `o` has fewer rows, the other rows stay.
    pub fn plus(mut self, o: &Matrix<N>) -> Matrix<N> {
        self.entries.iter_mut().zip(&o.entries).for_each(|(a, &b)| *a = *a + b);
        self
    }

    /// Solves (1 − self) x = right by elimination with row pivots. The matrices here pass on less than all of the
    /// light, so there is a solution.
    pub fn solve_rest(&self, right: Matrix<N>) -> Matrix<N> {
        let n = self.rows;
        let mut a = Matrix::from_fn(n, n, |i, j| N::of(f64::from(i == j)) - self.at(i, j));
        let mut b = right;
        let width = b.columns;
        for k in 0..n {
            let pivot = (k..n).max_by(|&i, &j| a.at(i, k).value().abs().total_cmp(&a.at(j, k).value().abs()));
            let pivot = pivot.unwrap_or(k);
            for j in 0..n {
                a.entries.swap(k * n + j, pivot * n + j);
            }
            for j in 0..width {
                b.entries.swap(k * width + j, pivot * width + j);
            }
            if a.at(k, k).value() == 0.0 {
                // This light would be caught for ever in a clear layer, but none ever comes there.
                a.entries[k * n + k] = N::of(1.0);
            }
            for i in k + 1..n {
                let factor = a.at(i, k) / a.at(k, k);
                let (above, below) = a.entries.split_at_mut(i * n);
                for (to, &x) in below[k..n].iter_mut().zip(&above[k * n + k..(k + 1) * n]) {
                    *to = *to - factor * x;
                }
                let (above, below) = b.entries.split_at_mut(i * width);
                for (to, &x) in below[..width].iter_mut().zip(&above[k * width..(k + 1) * width]) {
                    *to = *to - factor * x;
                }
            }
        }
        for k in (0..n).rev() {
            for j in 0..width {
                let mut sum = b.at(k, j);
                for i in k + 1..n {
                    sum = sum - a.at(k, i) * b.at(i, j);
                }
                b.entries[k * width + j] = sum / a.at(k, k);
            }
        }
        b
    }
}
