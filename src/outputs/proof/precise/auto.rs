//! Models written once for every kind of number, and the least-squares problems that they make.

use super::{Dd, Dual, Real};
use mesophyll_base::solve::Problem;

/// A problem that can also be evaluated in double-double arithmetic.
pub trait Precise: Problem {
    /// Writes residuals and Jacobian (laid out as in [`Problem::jacobian`]) at `params`.
    fn precise(&self, params: &[Dd], residuals: &mut [Dd], jacobian: &mut [Dd]);
}

/// A model of `N` parameters, written once over any [`Real`]. [`Auto`] makes a problem of it, with exact derivatives
/// and in double-double.
pub trait Model<const N: usize> {
    /// How many residuals there are.
    fn residuals(&self) -> usize;
    /// Residual number `index` at `params`.
    fn residual<T: Real>(&self, params: &[T; N], index: usize) -> T;
}

/// Derivatives by forward-mode differentiation of a [`Model`].
#[derive(Debug, Clone)]
pub struct Auto<M, const N: usize>(pub M);

impl<M: Model<N>, const N: usize> Auto<M, N> {
    fn array<T: Real>(params: &[T]) -> [T; N] {
        std::array::from_fn(|k| params[k])
    }

    fn differentiate<T: Real>(&self, params: &[T], mut put: impl FnMut(usize, Dual<T, N>)) {
        let variables: [Dual<T, N>; N] = std::array::from_fn(|k| Dual::variable(params[k], k));
        for i in 0..self.0.residuals() {
            put(i, self.0.residual(&variables, i));
        }
    }
}

impl<M: Model<N>, const N: usize> Problem for Auto<M, N> {
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

impl<M: Model<N>, const N: usize> Precise for Auto<M, N> {
    fn precise(&self, params: &[Dd], residuals: &mut [Dd], jacobian: &mut [Dd]) {
        let m = self.0.residuals();
        self.differentiate(params, |i, r| {
            residuals[i] = r.v;
            for (j, d) in r.d.iter().enumerate() {
                jacobian[j * m + i] = *d;
            }
        });
    }
}
