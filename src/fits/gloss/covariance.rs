//! The covariance of a texel's nonlinear parameters from their normal matrix.

use super::projection::NONLINEAR;

/// A matrix of the nonlinear parameters: ln m and two tilts.
pub(super) type Matrix = [[f64; NONLINEAR]; NONLINEAR];

/// Covariance of the nonlinear parameters and the condition number of the scaled matrix; unknown ones are infinite.
pub(super) fn covariance(normal: &Matrix, count: usize, matte: bool) -> (Matrix, f64) {
    let live: [bool; NONLINEAR] = std::array::from_fn(|k| k < count && normal[k][k] > 0.0 && !(matte && k == 0));
    let scale: [f64; NONLINEAR] = std::array::from_fn(|k| if live[k] { 1.0 / normal[k][k].sqrt() } else { 0.0 });
    // Parameters that are not live get unit rows, which do not affect the others.
    let scaled = nalgebra::Matrix3::from_fn(|i, j| {
        if live[i] && live[j] { normal[i][j] * scale[i] * scale[j] } else { f64::from(u8::from(i == j)) }
    });
    let (least, most) = extremes(&scaled, &live);
    let mut cov = Matrix::default();
    let inverse = if least > 1e-13 { scaled.try_inverse() } else { None };
    for (i, row) in cov.iter_mut().enumerate() {
        for (j, v) in row.iter_mut().enumerate() {
            *v = match (&inverse, i < count && j < count) {
                (Some(inverse), true) if live[i] && live[j] => inverse[(i, j)] * scale[i] * scale[j],
                (_, true) if i == j => f64::INFINITY,
                _ => 0.0,
            };
        }
    }
    (cov, if least > 0.0 { most / least } else { f64::INFINITY })
}

/// Smallest and largest eigenvalue of the live part of a scaled 3 × 3 matrix, in closed form (the roots of its cubic).
fn extremes(a: &nalgebra::Matrix3<f64>, live: &[bool; NONLINEAR]) -> (f64, f64) {
    let off = a[(0, 1)].powi(2) + a[(0, 2)].powi(2) + a[(1, 2)].powi(2);
    if off < 1e-30 || !off.is_finite() {
        return (1.0, 1.0);
    }
    // The diagonal is 1, so the eigenvalues are 1 + 2 p cos(…) with p² = off/3.
    let p = (off / 3.0).sqrt();
    let half = a[(0, 1)] * a[(0, 2)] * a[(1, 2)] / (p * p * p);
    let angle = half.clamp(-1.0, 1.0).acos() / 3.0;
    let at = |k: f64| 1.0 + 2.0 * p * (angle + k * std::f64::consts::TAU / 3.0).cos();
    let all = [at(0.0), at(1.0), at(2.0)];
    let (mut least, most) =
        (all.iter().copied().fold(f64::INFINITY, f64::min), all.iter().copied().fold(0.0, f64::max));
    if live.iter().filter(|l| **l).count() == 2 {
        // The unit row adds the eigenvalue 1 in the middle.
        least = 2.0 - most;
    }
    (least, most)
}
