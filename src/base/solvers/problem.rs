//! The input of the solver: residuals of `n` parameters, with derivatives where the model has them.

/// A least-squares problem: minimise ½ Σ r². Residuals are weighted: divided by their standard error where it is known.
pub trait Problem {
    /// How many parameters there are (n).
    fn parameters(&self) -> usize;
    /// How many residuals there are (m).
    fn residuals(&self) -> usize;
    /// Writes the `m` residuals at `params`. Where the model has no value it writes NaN; the solver then steps back.
    fn evaluate(&self, params: &[f64], out: &mut [f64]);
    /// Writes ∂r/∂p column by column (`m` rows, entry `i` of column `j` at `j·m + i`) and returns `true`. `false` makes
    /// the solver use numeric differences.
    fn jacobian(&self, _params: &[f64], _out: &mut [f64]) -> bool {
        false
    }
}

/// A problem made of a closure for the residuals and, optionally, one for the Jacobian.
pub struct ClosureProblem<R, J = fn(&[f64], &mut [f64])> {
    parameters: usize,
    residuals: usize,
    evaluate: R,
    jacobian: Option<J>,
}

impl<R: Fn(&[f64], &mut [f64])> ClosureProblem<R> {
    /// `evaluate(params, out)` writes `residuals` values; derivatives are numeric.
    pub fn new(parameters: usize, residuals: usize, evaluate: R) -> Self {
        ClosureProblem { parameters, residuals, evaluate, jacobian: None }
    }

    /// Adds an analytic Jacobian (layout as in [`Problem::jacobian`]).
    pub fn with_jacobian<J: Fn(&[f64], &mut [f64])>(self, jacobian: J) -> ClosureProblem<R, J> {
        ClosureProblem {
            parameters: self.parameters,
            residuals: self.residuals,
            evaluate: self.evaluate,
            jacobian: Some(jacobian),
        }
    }
}

impl<R: Fn(&[f64], &mut [f64]), J: Fn(&[f64], &mut [f64])> Problem for ClosureProblem<R, J> {
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
