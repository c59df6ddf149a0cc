//! The shared step, and the covariance of σ under the gauges (mean thickness h and mean γ 1). The gauges fix as many
//! directions as they can; the transmittances fix the rest.

use super::{LeafSharedErrors, M6, Sums, V6};
use mesophyll_base::solvers::decomposition;
use nalgebra::{DMatrix, DVector, SMatrix};

/// Gauss–Newton step under the linearised gauges: a particular solution plus the best move in the null space of the
/// gauges. `None` where a sum is not finite.
pub(super) fn constrained_step(sums: &Sums, gauge: &[f64; 4], damping: f64) -> Option<V6> {
    let (particular, null) = split(&(sums.jacobian / sums.weight), gauge)?;
    let reduced = null.transpose() * sums.hessian * &null;
    let right = null.transpose() * (sums.gradient - sums.hessian * particular);
    let size = reduced.nrows();
    let scale = reduced.trace().max(f64::MIN_POSITIVE) / size.max(1) as f64;
    let damped = &reduced + DMatrix::identity(size, size) * (scale * (damping + 1e-12));
    let free = decomposition::svd(damped)?.solve(&right, 1e-14 * scale).ok()?;
    Some(particular + V6::from_iterator((null * free).iter().copied()))
}

/// Minimum-norm solution of C·dp = −gauge, and an orthonormal basis of C's null space (6 × (6 − rank)).
/// `None` where C is not finite.
fn split(c: &SMatrix<f64, 4, 6>, gauge: &[f64; 4]) -> Option<(V6, DMatrix<f64>)> {
    // Pad to 6×6 so that the SVD yields a full right basis.
    let mut padded = DMatrix::<f64>::zeros(6, 6);
    padded.view_mut((0, 0), (4, 6)).copy_from(c);
    let svd = decomposition::svd(padded)?;
    let (Some(u), Some(vt)) = (&svd.u, &svd.v_t) else { return None };
    let cut = svd.singular_values.max() * 1e-10;
    let mut particular = V6::zeros();
    let mut free = Vec::new();
    for k in 0..6 {
        let row: V6 = V6::from_iterator(vt.row(k).iter().copied());
        if svd.singular_values[k] > cut {
            let along: f64 = (0..4).map(|i| u[(i, k)] * -gauge[i]).sum();
            particular += row * (along / svd.singular_values[k]);
        } else {
            free.push(DVector::from_column_slice(row.as_slice()));
        }
    }
    let null = if free.is_empty() { DMatrix::zeros(6, 0) } else { DMatrix::from_columns(&free) };
    Some((particular, null))
}

/// An eigenvalue of the reduced problem below this share of the largest carries no information: its direction is lost.
const LOST: f64 = 1e-12;

/// Covariance of p, the logarithms of σa and σs: noise of the gauges carried through the constraints, plus noise of the
/// transmittances in the free directions. A parameter that takes part in a lost direction has an infinite variance.
/// Where a sum is not finite nothing is known: every variance is infinite and the rank is 0.
pub(super) fn covariance(sums: &Sums, common: &LeafSharedErrors) -> (M6, f64, usize) {
    let unknown = (M6::from_diagonal_element(f64::INFINITY), f64::INFINITY, 0);
    let (n, c) = (sums.weight, sums.jacobian / sums.weight);
    let Some((_, null)) = split(&c, &[0.0; 4]) else { return unknown };
    let size = null.ncols();
    let reduced = null.transpose() * sums.hessian * &null;
    let Some(eigen) = decomposition::symmetric_eigen(reduced) else { return unknown };
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let smallest = eigen.eigenvalues.iter().copied().fold(f64::INFINITY, f64::min).max(0.0);
    let kept = |k: usize| eigen.eigenvalues[k] > largest * LOST;
    let rank = 6 - size + (0..size).filter(|&k| kept(k)).count();
    let condition = if size == 0 { 1.0 } else { (largest / smallest).sqrt() };
    let mut inverse = DMatrix::zeros(size, size);
    let mut lost = [false; 6];
    for k in 0..size {
        let vector = eigen.eigenvectors.column(k);
        if kept(k) {
            inverse += vector * vector.transpose() / eigen.eigenvalues[k];
        } else {
            let direction = &null * vector;
            (0..6).filter(|&i| direction[i].abs() > 1e-4).for_each(|i| lost[i] = true);
        }
    }
    let shape = &null * &inverse * null.transpose();
    // dp = P·(−gauge noise) + shape·(…), where P maps gauge noise to p with the free directions optimised again.
    let mut carry = SMatrix::<f64, 6, 4>::zeros();
    for k in 0..4 {
        let mut unit = [0.0; 4];
        unit[k] = -1.0;
        let Some((particular, _)) = split(&c, &unit) else { return unknown };
        let free = &shape * (sums.hessian * particular);
        for i in 0..6 {
            carry[(i, k)] = particular[i] - free[i];
        }
    }
    let mut noise = sums.gauge_noise / (n * n);
    for i in 0..3 {
        for j in 0..3 {
            noise[(1 + i, 1 + j)] +=
                common.shared * common.shared + if i == j { common.own[i] * common.own[i] } else { 0.0 };
        }
    }
    let mut total = carry * noise * carry.transpose();
    for i in 0..6 {
        for j in 0..6 {
            total[(i, j)] += shape[(i, j)];
        }
    }
    for i in (0..6).filter(|&i| lost[i]) {
        total.row_mut(i).fill(0.0);
        total.column_mut(i).fill(0.0);
        total[(i, i)] = f64::INFINITY;
    }
    (total, condition, rank)
}
