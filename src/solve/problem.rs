//! What the solver is given: residuals of `n` parameters, with derivatives where the model has them.

use super::dd::Dd;
use super::dual::Dual;
use super::real::Real;

/// A least-squares problem: minimise ½ Σ r². Residuals are weighted: divided by their standard error where it is known.
pub trait Problem {
    /// How many parameters there are (n).
    fn parameters(&self) -> usize;
    /// How many residuals there are (m).
    fn residuals(&self) -> usize;
    /// Writes the `m` residuals at `params`. Where the model has no value it writes NaN; the solver then steps back.
    fn evaluate(&self, params: &[f64], out: &mut [f64]);
    /// Writes ∂r/∂p column by column (`m` rows, entry `i` of column `j` at `j·m + i`) and says `true`; `false` asks for
    /// numeric differences.
    fn jacobian(&self, _params: &[f64], _out: &mut [f64]) -> bool {
        false
    }
    /// Residuals and Jacobian in double-double, for a last refinement; `false` where the problem has none.
    fn refined(&self, _params: &[Dd], _residuals: &mut [Dd], _jacobian: &mut [Dd]) -> bool {
        false
    }
}

/// A problem made of a closure for the residuals and, optionally, one for the Jacobian.
pub struct Closure<R, J = fn(&[f64], &mut [f64])> {
    parameters: usize,
    residuals: usize,
    evaluate: R,
    jacobian: Option<J>,
}

impl<R: Fn(&[f64], &mut [f64])> Closure<R> {
    /// `evaluate(params, out)` writes `residuals` values; derivatives are numeric.
    pub fn new(parameters: usize, residuals: usize, evaluate: R) -> Self {
        Closure { parameters, residuals, evaluate, jacobian: None }
    }

    /// Adds an analytic Jacobian (layout as in [`Problem::jacobian`]).
    pub fn with_jacobian<J: Fn(&[f64], &mut [f64])>(self, jacobian: J) -> Closure<R, J> {
        Closure {
            parameters: self.parameters,
            residuals: self.residuals,
            evaluate: self.evaluate,
            jacobian: Some(jacobian),
        }
    }
}

impl<R: Fn(&[f64], &mut [f64]), J: Fn(&[f64], &mut [f64])> Problem for Closure<R, J> {
    fn parameters(&self) -> usize {
        self.parameters
    }
    fn residuals(&self) -> usize {
        self.residuals
    }
    fn evaluate(&self, params: &[f64], out: &mut [f64]) {
        (self.evaluate)(params, out);
    }
    fn jacobian(&self, params: &[f64], out: &mut [f64]) -> bool {
        match &self.jacobian {
            Some(jacobian) => {
                jacobian(params, out);
                true
            }
            None => false,
        }
    }
}

/// A model of `N` parameters written once over any [`Real`]: [`Auto`] makes a problem of it, with exact derivatives and
/// a refined form.
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
    fn refined(&self, params: &[Dd], residuals: &mut [Dd], jacobian: &mut [Dd]) -> bool {
        let m = self.0.residuals();
        self.differentiate(params, |i, r| {
            residuals[i] = r.v;
            for (j, d) in r.d.iter().enumerate() {
                jacobian[j * m + i] = *d;
            }
        });
        true
    }
}
