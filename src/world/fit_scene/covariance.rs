//! The errors of the numbers, and which of them the pictures do not determine.

use crate::quantity::UNKNOWN;
use crate::unknowns::SceneUnknowns;
use mesophyll_base::solvers::decomposition::symmetric_eigen;
use nalgebra::DMatrix;

/// The unit in which each number is uncertain at the start.
pub fn unit(numbers: &SceneUnknowns) -> Vec<f64> {
    numbers.list.iter().flat_map(|q| q.at.iter().map(|at| q.unit(*at))).collect()
}

/// The covariance of the numbers, and why some are not determined.
pub fn covariance(numbers: &SceneUnknowns, normal: &DMatrix<f64>) -> (DMatrix<f64>, Vec<Option<String>>) {
    let (unit, names) = (unit(numbers), names(numbers));
    let n = unit.len();
    let mut out: DMatrix<f64> = DMatrix::zeros(n, n);
    let mut why: Vec<Option<String>> = vec![None; n];
    let scale: Vec<f64> = (0..n).map(|k| 1.0 / normal[(k, k)].max(1e-300).sqrt()).collect();
    for k in 0..n {
        if !(normal[(k, k)] * unit[k] * unit[k] > 1.0 / (UNKNOWN * UNKNOWN)) {
            why[k] = Some("the pictures hardly depend on it".into());
        }
    }
    let seen: Vec<usize> = (0..n).filter(|k| why[*k].is_none()).collect();
    let m = seen.len();
    let scaled = DMatrix::from_fn(m, m, |i, j| {
        let (i, j) = (seen[i], seen[j]);
        0.5 * (normal[(i, j)] + normal[(j, i)]) * scale[i] * scale[j]
    });
    if let Some(eigen) = symmetric_eigen(scaled) {
        for (k, value) in eigen.eigenvalues.iter().enumerate() {
            let v = eigen.eigenvectors.column(k);
            for i in 0..m {
                for j in 0..m {
                    out[(seen[i], seen[j])] += v[i] * v[j] / value.max(1e-12) * scale[seen[i]] * scale[seen[j]];
                }
            }
        }
    }
    for &k in &seen {
        if !(out[(k, k)].sqrt() <= UNKNOWN * unit[k]) {
            let with = |j: &&usize| (out[(k, **j)] / (out[(k, k)] * out[(**j, **j)]).sqrt()).abs();
            let others = seen.iter().filter(|j| **j != k && with(j) > 0.9);
            let others: Vec<&str> = others.map(|j| names[*j].as_str()).take(4).collect();
            why[k] = Some(match others.is_empty() {
                true => "the pictures hardly depend on it".into(),
                false => format!("the pictures show it only together with {}", others.join(", ")),
            });
        }
    }
    for k in (0..n).filter(|k| why[*k].is_some()) {
        out[(k, k)] = f64::INFINITY;
    }
    (out, why)
}

/// Names of all numbers.
pub fn names(numbers: &SceneUnknowns) -> Vec<String> {
    numbers.list.iter().flat_map(|q| q.names(&numbers.channels)).collect()
}
