//! Singular values and eigenvalues that always end: nalgebra iterates without a limit, and on a matrix that holds a NaN
//! or an infinity it never stops.

use nalgebra::{DMatrix, DVector, Dyn, SVD, SymmetricEigen};

/// Largest number of sweeps for each singular value. A decomposition takes about two; LAPACK allows thirty.
const SWEEPS: usize = 30;
/// nalgebra's own tolerance of convergence.
const TOLERANCE: f64 = 5.0 * f64::EPSILON;

fn limit<R, C, S>(matrix: &nalgebra::Matrix<f64, R, C, S>) -> Option<usize>
where
    R: nalgebra::Dim,
    C: nalgebra::Dim,
    S: nalgebra::RawStorage<f64, R, C>,
{
    // nalgebra panics where there is nothing to decompose.
    let sound = !matrix.is_empty() && matrix.iter().all(|v| v.is_finite());
    sound.then(|| SWEEPS * matrix.nrows().max(matrix.ncols()))
}

/// Singular value decomposition with both bases, largest value first; `None` where an entry is not finite, the matrix
/// is empty, or the iteration does not end.
pub fn svd(matrix: DMatrix<f64>) -> Option<SVD<f64, Dyn, Dyn>> {
    let limit = limit(&matrix)?;
    SVD::try_new(matrix, true, true, TOLERANCE, limit)
}

/// Singular values alone, largest first; `None` as for [`svd`].
pub fn singular_values(matrix: DMatrix<f64>) -> Option<DVector<f64>> {
    let limit = limit(&matrix)?;
    SVD::try_new(matrix, false, false, TOLERANCE, limit).map(|svd| svd.singular_values)
}

/// Eigenvalues and eigenvectors of a symmetric matrix; `None` as for [`svd`].
pub fn symmetric_eigen(matrix: DMatrix<f64>) -> Option<SymmetricEigen<f64, Dyn>> {
    let limit = limit(&matrix)?;
    SymmetricEigen::try_new(matrix, TOLERANCE, limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_matrix_is_refused() {
        let none = DMatrix::zeros(0, 0);
        assert!(svd(none.clone()).is_none() && singular_values(none.clone()).is_none());
        assert!(symmetric_eigen(none).is_none());
    }

    #[test]
    fn what_is_not_finite_is_refused_instead_of_iterated_for_ever() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let matrix =
                DMatrix::from_fn(4, 4, |i, j| if (i, j) == (1, 2) || (i, j) == (2, 1) { bad } else { (i * j) as f64 });
            assert!(
                svd(matrix.clone()).is_none()
                    && singular_values(matrix.clone()).is_none()
                    && symmetric_eigen(matrix).is_none()
            );
        }
    }

    #[test]
    fn extreme_entries_end() {
        for scale in [1e-308, 1e-160, 1.0, 1e150, 1e307] {
            let matrix = DMatrix::from_fn(6, 6, |i, j| scale / (1.0 + i as f64 + j as f64));
            // A Hilbert matrix' largest singular value is 1.6188998589 at order 6.
            if let Some(values) = singular_values(matrix.clone()) {
                assert!(
                    !(1e-150..=1e150).contains(&scale) || (values[0] / scale - 1.6188998589243).abs() < 1e-9,
                    "{scale}: {values}"
                );
            }
            let _ = symmetric_eigen(matrix);
        }
    }
}
