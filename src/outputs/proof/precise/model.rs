//! Models written once for every kind of number, and the least-squares problems that they make.

use super::{DoubleDouble, PreciseDual, PreciseReal};
use mesophyll_base::solvers::Problem;

/// A problem that can also be evaluated in double-double arithmetic.
pub trait PreciseProblem: Problem {
    /// Writes residuals and Jacobian (laid out as in [`Problem::jacobian`]) at `params`.
    fn precise(&self, params: &[DoubleDouble], residuals: &mut [DoubleDouble], jacobian: &mut [DoubleDouble]);
}

/// A model of `N` parameters, written once over any [`PreciseReal`]. [`PreciseModelProblem`] makes a problem of it,
/// with exact derivatives and in double-double.
pub trait PreciseModel<const N: usize> {
    /// How many residuals there are.
    fn residuals(&self) -> usize;
    /// Residual number `index` at `params`.
    fn residual<T: PreciseReal>(&self, params: &[T; N], index: usize) -> T;
}

/// Derivatives by forward-mode differentiation of a [`PreciseModel`].
#[derive(Debug, Clone)]
pub struct PreciseModelProblem<M, const N: usize>(pub M);

impl<M: PreciseModel<N>, const N: usize> PreciseModelProblem<M, N> {
    fn array<T: PreciseReal>(params: &[T]) -> [T; N] {
        std::array::from_fn(|k| params[k])
    }

    fn differentiate<T: PreciseReal>(&self, params: &[T], mut put: impl FnMut(usize, PreciseDual<T, N>)) {
        let variables: [PreciseDual<T, N>; N] = std::array::from_fn(|k| PreciseDual::variable(params[k], k));
        for i in 0..self.0.residuals() {
            put(i, self.0.residual(&variables, i));
        }
    }
}

impl<M: PreciseModel<N>, const N: usize> Problem for PreciseModelProblem<M, N> {
    fn parameters(&self) -> usize {
        N
    }
    fn residuals(&self) -> usize {
        self.0.residuals()
    }
    fn evaluate(&self, params: &[f64], out: &mut [f64]) {
        let params = Self::array(params);
        for (i, r) in out.iter_mut().enumerate() {
            *r = self.0.residual(&params, i);
        }
    }
    fn jacobian(&self, params: &[f64], out: &mut [f64]) -> bool {
        let m = self.0.residuals();
        self.differentiate(params, |i, r| {
            for (j, d) in r.d.iter().enumerate() {
                out[j * m + i] = *d;
            }
        });
        true
    }
}

impl<M: PreciseModel<N>, const N: usize> PreciseProblem for PreciseModelProblem<M, N> {
    fn precise(&self, params: &[DoubleDouble], residuals: &mut [DoubleDouble], jacobian: &mut [DoubleDouble]) {
        let m = self.0.residuals();
        self.differentiate(params, |i, r| {
            residuals[i] = r.v;
            for (j, d) in r.d.iter().enumerate() {
                jacobian[j * m + i] = *d;
            }
        });
    }
}
