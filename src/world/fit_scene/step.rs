//! One step: the solution of the normal equations, and how much of it is taken.

use crate::covariance::unit;
use crate::quantity::UnknownKind;
use crate::steps::SceneNormal;
use crate::unknowns::SceneUnknowns;
use mesophyll_base::solvers::decomposition::symmetric_eigen;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;

/// The step, and standard errors as far as they are known yet. A weak pull of one unit keeps what no picture shows
/// where it is. Where ρd and ρt would be more than 1 together, their sum is held there, and all other numbers follow.
pub fn step(numbers: &SceneUnknowns, normal: &SceneNormal) -> (Vec<f64>, Vec<f64>) {
    let (unit, before) = (unit(numbers), numbers.values());
    let (mut matrix, mut gradient) = (normal.matrix.clone(), normal.gradient.clone());
    let mut pull =
        DMatrix::from_fn(unit.len(), unit.len(), |i, j| if i == j { 1.0 / (unit[i] * unit[i]) } else { 0.0 });
    matrix += &pull;
    let mut held = BTreeSet::new();
    loop {
        let (step, stderr) = solved([&matrix, &(&normal.upper + &pull)], &gradient, &unit);
        let over = |pair: &&[usize; 2]| pair.iter().map(|k| before[*k] + step[*k]).sum::<f64>() > 1.0 + 1e-9;
        let sides = sums(numbers);
        let new: Vec<[usize; 2]> = sides.iter().filter(|pair| !held.contains(*pair)).filter(over).copied().collect();
        if new.is_empty() {
            return (step, stderr);
        }
        for [d, t] in new {
            let weight = 1e4 * matrix[(d, d)].max(matrix[(t, t)]);
            for i in [d, t] {
                gradient[i] += weight * (1.0 - before[d] - before[t]);
                for j in [d, t] {
                    matrix[(i, j)] += weight;
                    pull[(i, j)] += weight;
                }
            }
            held.insert([d, t]);
        }
    }
}

/// The solution of the normal equations, and its standard errors. A direction's curvature counts as at least half of
/// that of `upper`, so that a step along it never makes the residuals of its own paths larger.
fn solved([matrix, upper]: [&DMatrix<f64>; 2], gradient: &DVector<f64>, unit: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let n = unit.len();
    let scale: Vec<f64> = (0..n).map(|k| 1.0 / matrix[(k, k)].max(1.0 / (unit[k] * unit[k])).sqrt()).collect();
    let scaled =
        |of: &DMatrix<f64>| DMatrix::from_fn(n, n, |i, j| 0.5 * (of[(i, j)] + of[(j, i)]) * scale[i] * scale[j]);
    let upper = scaled(upper);
    let Some(eigen) = symmetric_eigen(scaled(matrix)) else { return (vec![0.0; n], vec![f64::INFINITY; n]) };
    let right = DVector::from_fn(n, |k, _| gradient[k] * scale[k]);
    let mut out = DVector::zeros(n);
    let mut variance = vec![0.0; n];
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        // While noise is large, a direction's curvature may come out negative; nothing is known of it then.
        if *value > 1e-9 {
            let v = eigen.eigenvectors.column(k);
            out += v * (v.dot(&right) / value.max(0.5 * v.dot(&(&upper * v))));
            (0..n).for_each(|j| variance[j] += v[j] * v[j] / value);
        }
    }
    let stderr = (0..n).map(|k| (variance[k]).sqrt() * scale[k]).collect();
    ((0..n).map(|k| out[k] * scale[k]).collect(), stderr)
}

/// The numbers after a step, shortened where they would leave their limits or change much at once.
pub fn moved(numbers: &SceneUnknowns, before: &[f64], step: &[f64]) -> Vec<f64> {
    let mut out = Vec::with_capacity(before.len());
    for q in &numbers.list {
        for channel in 0..q.at.len() {
            let k = out.len();
            let most = q.reach(before[k]);
            out.push((before[k] + step[k].clamp(-most, most)).clamp(q.low, q.high[channel]));
        }
    }
    keep_energy(numbers, &mut out);
    out
}

/// Places of ρd and ρt of each side and channel where both are unknown.
fn sums(numbers: &SceneUnknowns) -> Vec<[usize; 2]> {
    let (first, _) = numbers.places();
    let all = || numbers.list.iter().zip(&first);
    let through = |leaf: usize| all().find(|(q, _)| q.kind == UnknownKind::RhoT(leaf)).map(|(_, first)| *first);
    all()
        .filter_map(|(q, first)| match q.kind {
            UnknownKind::RhoD(leaf, _) | UnknownKind::RhoDBoth(leaf) => Some((*first, through(leaf)?, q.at.len())),
            _ => None,
        })
        .flat_map(|(d, t, channels)| (0..channels).map(move |c| [d + c, t + c]))
        .collect()
}

/// ρd and ρt of a side are at most 1 together: what both are too large by is taken from both.
pub fn keep_energy(numbers: &SceneUnknowns, values: &mut [f64]) {
    for [d, t] in sums(numbers) {
        let sum = values[d] + values[t];
        if sum > 1.0 {
            (values[d], values[t]) = (values[d] / sum, values[t] / sum);
        }
    }
    numbers.keep_maps(values);
}
