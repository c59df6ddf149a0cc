//! Householder QR over any [`MatrixScalar`], column by column in one flat slice (column-major). Small dense problems:
//! up to a few dozen columns.
//!
//! G. H. Golub, "Numerical methods for solving linear least squares problems", Numer. Math. 7 (1965), 206–216.

use crate::number::Arithmetic;

/// The operations that linear algebra needs: for `f64`, or for a number with more digits that results are checked with.
pub trait MatrixScalar: Arithmetic {
    /// A constant: exact in every implementation.
    fn constant(value: f64) -> Self;
    /// The nearest `f64`.
    fn value(self) -> f64;
    /// Square root.
    fn sqrt(self) -> Self;

    /// The constant 0.
    fn zero() -> Self {
        Self::constant(0.0)
    }

    /// The constant 1.
    fn one() -> Self {
        Self::constant(1.0)
    }
}

impl MatrixScalar for f64 {
    fn constant(value: f64) -> Self {
        value
    }
    fn value(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
}

/// Reduces the `m × n` matrix `a` to upper triangular form in place (R in its upper triangle, zeros below) and applies
/// the same reflections to `b` (length `m`). Afterwards `b[..n]` is the top of Qᵀb, and `b[n..]` holds the part that no
/// combination of columns can explain. With `m < n` the last rows of R are missing.
pub fn reduce<T: MatrixScalar>(a: &mut [T], m: usize, n: usize, b: &mut [T]) {
    for k in 0..n.min(m) {
        let (before, rest) = a.split_at_mut((k + 1) * m);
        let column = &mut before[k * m..];
        let norm = length(&column[k..m]);
        if norm.value() == 0.0 || !norm.value().is_finite() {
            continue;
        }
        // The reflection v = x/|x| ± e₁, with the sign that avoids cancellation. Its length is about 1, so that no
        // product leaves the range.
        for x in &mut column[k..m] {
            *x = *x / norm;
        }
        let sign = if column[k].value() > 0.0 { -T::one() } else { T::one() };
        column[k] = column[k] - sign;
        let scale = -(sign * column[k]);
        let v = &column[k..m];
        let reflect = |x: &mut [T]| {
            let mut dot = T::zero();
            for (vi, xi) in v.iter().zip(x.iter()) {
                dot = dot + *vi * *xi;
            }
            let factor = dot / scale;
            for (vi, xi) in v.iter().zip(x.iter_mut()) {
                *xi = *xi - factor * *vi;
            }
        };
        for other in rest.chunks_exact_mut(m).take(n - k - 1) {
            reflect(&mut other[k..m]);
        }
        reflect(&mut b[k..m]);
        column[k] = sign * norm;
        for x in &mut column[k + 1..m] {
            *x = T::zero();
        }
    }
}

/// Euclidean length, scaled so that the squares of tiny or huge components stay in range.
pub fn length<T: MatrixScalar>(x: &[T]) -> T {
    let largest = x.iter().map(|v| v.value().abs()).fold(0.0, nan_max);
    if largest == 0.0 || !largest.is_finite() {
        return T::constant(largest);
    }
    let scale = T::constant(largest);
    let mut sum = T::zero();
    for v in x {
        let s = *v / scale;
        sum = sum + s * s;
    }
    scale * sum.sqrt()
}

/// A `max` that returns NaN if either number is NaN.
pub fn nan_max(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

/// Solves R x = b for the upper triangle of a column-major matrix with `m` rows. A zero on the diagonal gives a
/// non-finite result.
pub fn solve_upper<T: MatrixScalar>(r: &[T], m: usize, n: usize, b: &[T]) -> Vec<T> {
    let mut x = b[..n].to_vec();
    for j in (0..n).rev() {
        x[j] = x[j] / r[j * m + j];
        for i in 0..j {
            x[i] = x[i] - r[j * m + i] * x[j];
        }
    }
    x
}

/// Solves Rᵀ x = b.
pub fn solve_upper_transposed<T: MatrixScalar>(r: &[T], m: usize, n: usize, b: &[T]) -> Vec<T> {
    let mut x = b[..n].to_vec();
    for j in 0..n {
        for i in 0..j {
            x[j] = x[j] - r[j * m + i] * x[i];
        }
        x[j] = x[j] / r[j * m + j];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_any_scale_are_reduced_alike() {
        let base = [1.0, 2.0, 2.0, 0.5, -1.0, 3.0];
        let (mut plain, mut b) = (base.to_vec(), vec![1.0, 0.0, 2.0]);
        reduce(&mut plain, 3, 2, &mut b);
        for (s, t) in [(1e200, 1e-150), (1e-300, 1e300)] {
            let mut a: Vec<f64> = base.iter().enumerate().map(|(k, v)| v * if k < 3 { s } else { t }).collect();
            let mut c = vec![1.0, 0.0, 2.0];
            reduce(&mut a, 3, 2, &mut c);
            for (got, expected) in
                [(a[0] / s, plain[0]), (a[3] / t, plain[3]), (a[4] / t, plain[4]), (c[0], b[0]), (c[1], b[1])]
            {
                assert!((got / expected - 1.0).abs() < 1e-14, "{got} against {expected}");
            }
        }
    }

    #[test]
    fn length_survives_extreme_scales() {
        assert!((length(&[3e-200, 4e-200]) / 5e-200 - 1.0).abs() < 1e-15);
        assert!((length(&[3e200, 4e200]) / 5e200 - 1.0).abs() < 1e-15);
        assert!(length(&[1.0, f64::NAN]).is_nan());
    }
}
