//! What the photographs determine and what they do not: standard errors, correlations, and the weak directions in
//! words.

use mesophyll_base::solvers::decomposition;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Largest standard error of a logarithm that still counts as determined.
pub const DETERMINED: f64 = 0.1;
/// Eigenvalues of the matrix with unit diagonal that are below this are rounding.
const RANK: f64 = 1e-12;

/// How well the photographs determine the parameters: the logarithms of the coefficients and of the scale, in the order
/// of [`names`].
#[derive(Debug, Clone, Default)]
pub struct TissueCertainty {
    /// Names of the parameters, as [`names`] makes them.
    pub names: Vec<String>,
    /// Standard error of each logarithm, which is the relative standard error of its parameter; infinite where nothing
    /// is known.
    pub stderr: Vec<f64>,
    /// Correlations of the logarithms, row by row.
    pub correlation: Vec<Vec<f64>>,
    /// Condition number of the Jacobian after each column was scaled to length 1.
    pub condition: f64,
    /// How many directions the photographs determine.
    pub rank: usize,
    /// The factor by which the standard errors from noise were multiplied because of a misfit.
    pub misfit: f64,
    /// Directions that may change by more than [`DETERMINED`].
    pub weak: Vec<WeakCombination>,
    /// Which parameters ended at a limit of the search.
    pub at_limit: Vec<bool>,
}

/// A combination of parameters that the photographs hardly determine.
#[derive(Debug, Clone, PartialEq)]
pub struct WeakCombination {
    /// Exponents of the parameters, of length 1.
    pub exponents: Vec<f64>,
    /// Standard error of the logarithm of their product; infinite where a change of it has no effect at all.
    pub stderr: f64,
    /// The combination in words, for messages.
    pub text: String,
}

/// `sigma_a.R`, `sigma_s.R`, …, `thickness_scale`.
pub fn names(channels: &[&str], fixed: bool) -> Vec<String> {
    let pairs = channels.iter().flat_map(|c| [format!("sigma_a.{c}"), format!("sigma_s.{c}")]);
    pairs.chain((!fixed).then(|| "thickness_scale".to_string())).collect()
}

/// Judges the parameters from H = JᵀWJ of their logarithms. The covariance is H⁻¹ (misfit² H + scatter) H⁻¹, where
/// `scatter` is the part of the gradient's covariance that does not come from the noise of the readings.
pub fn judge(
    matrix: &DMatrix<f64>,
    misfit: f64,
    scatter: &DMatrix<f64>,
    names: &[String],
    at_limit: &[bool],
) -> TissueCertainty {
    let n = names.len();
    let root: Vec<f64> = (0..n).map(|k| if matrix[(k, k)] > 0.0 { matrix[(k, k)].sqrt() } else { 1.0 }).collect();
    let decompose = |matrix: DMatrix<f64>| {
        // A matrix that is not finite says nothing: every eigenvalue counts as zero, and every parameter as
        // undetermined.
        decomposition::symmetric_eigen(matrix)
            .unwrap_or_else(|| SymmetricEigen { eigenvectors: DMatrix::identity(n, n), eigenvalues: DVector::zeros(n) })
    };
    let scaled = decompose(DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] / (root[i] * root[j])));
    let largest = scaled.eigenvalues.max();
    let kept: Vec<bool> = scaled.eigenvalues.iter().map(|l| *l > RANK * largest).collect();
    let rank = kept.iter().filter(|k| **k).count();
    let vectors = &scaled.eigenvectors;
    // A parameter that takes part in a direction without effect is not known at all.
    let lost: Vec<bool> = (0..n).map(|i| (0..n).any(|k| !kept[k] && vectors[(i, k)].abs() > 1e-6)).collect();
    let inverse = DMatrix::from_fn(n, n, |i, j| {
        let sum: f64 =
            (0..n).filter(|k| kept[*k]).map(|k| vectors[(i, k)] * vectors[(j, k)] / scaled.eigenvalues[k]).sum();
        sum / (root[i] * root[j])
    });
    let covariance = &inverse * (misfit * misfit) + &inverse * scatter * &inverse;
    let stderr: Vec<f64> = (0..n).map(|i| if lost[i] { f64::INFINITY } else { covariance[(i, i)].sqrt() }).collect();
    let correlate = |i: usize, j: usize| match i == j {
        true => 1.0,
        false if lost[i] || lost[j] => f64::NAN,
        false => (covariance[(i, j)] / (stderr[i] * stderr[j])).clamp(-1.0, 1.0),
    };
    let plain = decompose(matrix.clone());
    let top = plain.eigenvalues.max();
    let mut weak: Vec<WeakCombination> = (0..n)
        .filter_map(|k| {
            let l = plain.eigenvalues[k];
            let vector: Vec<f64> = plain.eigenvectors.column(k).iter().copied().collect();
            let own = plain.eigenvectors.column(k).dot(&(scatter * plain.eigenvectors.column(k)));
            let stderr = if l > RANK * top { (misfit * misfit / l + own / (l * l)).sqrt() } else { f64::INFINITY };
            (!(stderr <= DETERMINED)).then(|| WeakCombination {
                text: describe(&vector, names),
                exponents: vector,
                stderr,
            })
        })
        .collect();
    weak.sort_by(|a, b| b.stderr.total_cmp(&a.stderr));
    let smallest = scaled.eigenvalues.min();
    TissueCertainty {
        names: names.to_vec(),
        correlation: (0..n).map(|i| (0..n).map(|j| correlate(i, j)).collect()).collect(),
        stderr,
        condition: if rank == n { (largest / smallest).sqrt() } else { f64::INFINITY },
        rank,
        misfit,
        weak,
        at_limit: at_limit.to_vec(),
    }
}

/// A direction in words.
fn describe(vector: &[f64], names: &[String]) -> String {
    let scale = names.iter().position(|n| n == "thickness_scale");
    let n = vector.len() as f64;
    if let Some(last) = scale {
        // All coefficients rise and the thickness falls, so that optical thicknesses do not change.
        let along: f64 =
            vector.iter().enumerate().map(|(k, v)| if k == last { -v } else { *v }).sum::<f64>() / n.sqrt();
        if along.abs() > 0.95 {
            return "only sigma_a and sigma_s times thickness_scale: nothing tells a length".into();
        }
    }
    let part: Vec<usize> = (0..vector.len()).filter(|k| vector[*k].abs() > 0.2).collect();
    if let [only] = part[..] {
        return names[only].clone();
    }
    if let [a, s] = part[..]
        && a + 1 == s
        && names[a].starts_with("sigma_a.")
    {
        return format!("{} against {}: only how much light comes through", names[a], names[s]);
    }
    let size = vector.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let first = part.first().map_or(1.0, |k| vector[*k].signum());
    let product: Vec<String> = part.iter().map(|k| format!("{}^{:.1}", names[*k], first * vector[*k] / size)).collect();
    product.join(" ")
}

impl TissueCertainty {
    /// Why parameter `k`, which has this value, is not determined; `None` where it is.
    pub fn undetermined(&self, k: usize, value: f64) -> Option<String> {
        let (name, stderr) = (&self.names[k], self.stderr[k]);
        if stderr <= DETERMINED && !self.at_limit[k] {
            return None;
        }
        if self.at_limit[k] && !(stderr > 1.0 && stderr.is_finite()) {
            return Some(format!("{name}: the search ended at its limit, {value:.3e}"));
        }
        let because =
            self.weak.iter().filter(|w| w.exponents[k].abs() > 0.2).map(|w| w.text.as_str()).find(|t| t != name);
        let bound = if stderr.is_finite() {
            format!("at most {:.3e}", value * (1.0 + 1.645 * stderr))
        } else {
            "no bound".into()
        };
        Some(because.map_or_else(|| format!("{name}: {bound}"), |b| format!("{name}: {bound} ({b})")))
    }
}
