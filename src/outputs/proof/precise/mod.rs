//! Arithmetic that answers are checked with: about 31 digits ([`DoubleDouble`]), exact derivatives ([`PreciseDual`]),
//! models written once for both ([`PreciseModel`]), and the last digits of a fit ([`refined`]). No fit of a user needs
//! it.

mod dd;
mod dual;
mod model;
mod real;
mod refine;

pub use dd::DoubleDouble;
pub use dual::PreciseDual;
pub use model::{PreciseModel, PreciseModelProblem, PreciseProblem};
pub use real::PreciseReal;
pub use refine::refined;

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::solvers::qr::{MatrixScalar, reduce, solve_upper};

    /// A Vandermonde system with a known solution: the residual part of Qᵀb vanishes and back substitution returns the
    /// coefficients.
    #[test]
    fn a_polynomial_is_recovered_in_both_precisions() {
        fn worst<T: MatrixScalar>() -> f64 {
            let (m, n) = (12, 5);
            let x = |i: usize| T::constant(i as f64) / T::constant(7.0);
            let mut a = vec![T::zero(); m * n];
            let mut b = vec![T::zero(); m];
            for i in 0..m {
                let mut power = T::one();
                for j in 0..n {
                    a[j * m + i] = power;
                    b[i] = b[i] + power * T::constant(j as f64 - 1.5);
                    power = power * x(i);
                }
            }
            reduce(&mut a, m, n, &mut b);
            let solution = solve_upper(&a, m, n, &b);
            (0..n).map(|j| (solution[j] - T::constant(j as f64 - 1.5)).value().abs()).fold(0.0, f64::max)
        }
        assert!(worst::<f64>() < 1e-11);
        assert!(worst::<DoubleDouble>() < 1e-27);
    }
}
