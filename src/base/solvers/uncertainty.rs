//! What a fit knows about its parameters: covariance, rank, condition, and the directions that the data do not
//! determine.

use super::decomposition;
use super::qr::{self, MatrixScalar};
use nalgebra::DMatrix;

/// A component of an undetermined direction that is below this (in column-scaled coordinates) is rounding: the
/// parameter does not take part.
const ABSENT: f64 = 1e-8;

/// Whether the residuals are divided by their true standard errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ResidualNoise {
    /// Residuals are in units of their standard error: the covariance is (JᵀJ)⁻¹.
    Known,
    /// Only the relative weights of the residuals are known: the covariance is scaled by the reduced χ². With no
    /// degrees of freedom left, nothing is known about the noise, and every standard error is infinite.
    #[default]
    Estimated,
}

/// Standard errors and what they are based on. All of it refers to the Jacobian at the solution.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// Numerical rank of the Jacobian, after scaling its columns to length 1.
    pub rank: usize,
    /// Condition number of the scaled Jacobian; infinite where it lacks rank.
    pub condition: f64,
    /// Standard error of each parameter; infinite where undetermined.
    pub stderr: Vec<f64>,
    /// n × n, NaN in the rows and columns of undetermined parameters (their variances are infinite).
    pub covariance: DMatrix<f64>,
    /// Parameters that take part in an undetermined direction, by index.
    pub undetermined: Vec<usize>,
    /// The undetermined directions themselves, of length 1 in scaled coordinates: a step along one does not change the
    /// residuals.
    pub directions: Vec<Vec<f64>>,
    /// Σ r².
    pub chi2: f64,
    /// χ² over the degrees of freedom; NaN where none are left.
    pub reduced_chi2: f64,
    /// Residuals less rank.
    pub freedom: usize,
}

impl Uncertainty {
    /// For fits that failed: nothing is known.
    pub fn none(n: usize) -> Self {
        Uncertainty {
            rank: 0,
            condition: f64::INFINITY,
            stderr: vec![f64::INFINITY; n],
            covariance: DMatrix::from_element(n, n, f64::NAN),
            undetermined: (0..n).collect(),
            directions: Vec::new(),
            chi2: f64::NAN,
            reduced_chi2: f64::NAN,
            freedom: 0,
        }
    }

    /// Computes everything from the upper triangle `r` (column-major, `rows` rows) of a QR factorisation of a Jacobian
    /// with `m` rows and `n` columns. Singular values below `tolerance` times the largest count as zero. Where the rank
    /// is full, the covariance is formed in `T`'s precision.
    pub fn from_triangle<T: MatrixScalar>(
        r: &[T],
        rows: usize,
        m: usize,
        n: usize,
        chi2: T,
        noise: ResidualNoise,
        tolerance: f64,
    ) -> Self {
        let top = n.min(m);
        let lengths: Vec<T> = (0..n).map(|j| qr::length(&r[j * rows..j * rows + (j + 1).min(top)])).collect();
        if lengths.iter().any(|l| !l.value().is_finite()) || !chi2.value().is_finite() {
            return Uncertainty::none(n);
        }
        let scale: Vec<T> = lengths.iter().map(|l| if l.value() > 0.0 { *l } else { T::one() }).collect();
        // A matrix with fewer rows is filled with zeros, so that the decomposition always has n right singular vectors.
        let scaled =
            DMatrix::from_fn(n, n, |i, j| if i <= j && i < top { (r[j * rows + i] / scale[j]).value() } else { 0.0 });
        let Some(svd) = decomposition::svd(scaled) else { return Uncertainty::none(n) };
        let sigma = &svd.singular_values;
        let largest = sigma.iter().copied().fold(0.0, f64::max);
        let kept: Vec<bool> = sigma.iter().map(|s| *s > tolerance * largest && *s > 0.0).collect();
        let rank = kept.iter().filter(|k| **k).count();
        let Some(vt) = svd.v_t else { return Uncertainty::none(n) };

        let freedom = m.saturating_sub(rank);
        let reduced = if freedom > 0 { chi2 / T::constant(freedom as f64) } else { T::constant(f64::NAN) };
        let variance = match noise {
            ResidualNoise::Known => T::one(),
            ResidualNoise::Estimated if freedom > 0 => reduced,
            ResidualNoise::Estimated => T::constant(f64::INFINITY),
        };
        let directions: Vec<Vec<f64>> = (0..n)
            .filter(|k| !kept[*k])
            .map(|k| {
                (0..n).map(|j| if vt[(k, j)].abs() > ABSENT { vt[(k, j)] / scale[j].value() } else { 0.0 }).collect()
            })
            .collect();
        let undetermined: Vec<usize> = (0..n).filter(|j| directions.iter().any(|d| d[*j] != 0.0)).collect();

        let mut covariance = DMatrix::zeros(n, n);
        let mut stderr = vec![f64::INFINITY; n];
        if rank == n {
            // Rows of the scaled R⁻¹. Row i of the inverse says how the i-th parameter depends on each orthogonal
            // residual.
            let scaled: Vec<T> = (0..n * rows).map(|k| r[k] / scale[k / rows]).collect();
            let inverse: Vec<Vec<T>> = (0..n)
                .map(|k| {
                    let mut unit = vec![T::zero(); n];
                    unit[k] = T::one();
                    qr::solve_upper(&scaled, rows, n, &unit)
                })
                .collect();
            for i in 0..n {
                for j in 0..=i {
                    let dot = (i..n).fold(T::zero(), |s, k| s + inverse[k][i] * inverse[k][j]);
                    let entry = (variance * dot / (scale[i] * scale[j])).value();
                    covariance[(i, j)] = entry;
                    covariance[(j, i)] = entry;
                    if i == j {
                        stderr[i] = ((variance * dot).sqrt() / scale[i]).value();
                    }
                }
            }
        } else {
            let unknown = |j: &usize| undetermined.contains(j);
            for i in 0..n {
                for j in 0..n {
                    covariance[(i, j)] = if unknown(&i) || unknown(&j) {
                        if i == j { f64::INFINITY } else { f64::NAN }
                    } else {
                        let sum: f64 =
                            (0..n).filter(|k| kept[*k]).map(|k| vt[(k, i)] * vt[(k, j)] / sigma[k].powi(2)).sum();
                        variance.value() * sum / (scale[i].value() * scale[j].value())
                    };
                }
                stderr[i] = covariance[(i, i)].sqrt();
            }
        }
        let smallest = sigma.iter().copied().fold(f64::INFINITY, f64::min);
        let condition = if rank == n { largest / smallest } else { f64::INFINITY };
        let (chi2, reduced_chi2) = (chi2.value(), reduced.value());
        Uncertainty { rank, condition, stderr, covariance, undetermined, directions, chi2, reduced_chi2, freedom }
    }

    /// Correlation of two parameters in [−1, 1]; NaN where either is undetermined.
    pub fn correlation(&self, i: usize, j: usize) -> f64 {
        let value = self.covariance[(i, j)] / (self.stderr[i] * self.stderr[j]);
        if i == j && value.is_finite() { 1.0 } else { value.clamp(-1.0, 1.0) }
    }

    /// All correlations, row by row.
    pub fn correlations(&self) -> Vec<Vec<f64>> {
        let n = self.stderr.len();
        (0..n).map(|i| (0..n).map(|j| self.correlation(i, j)).collect()).collect()
    }
}
