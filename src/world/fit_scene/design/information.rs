//! What a picture tells of the numbers.

use crate::photographs::{PixelUse, ReadingKind, ScenePhotograph};
use crate::pictures::{LitScene, ShotSlopes, draw, exposure, rounds, variances};
use crate::steps::{PATHS, last_paths};
use crate::unknowns::SceneUnknowns;
use crate::{Result, SAMPLES};
use mesophyll_base::solvers::decomposition::symmetric_eigen;
use mesophyll_base::statistics::median_of;
use mesophyll_transport::path::slopes::DerivativePicture;
use nalgebra::DMatrix;

/// A picture as it is drawn for a plan: coarse, and each of its pixels stands for several readings.
pub struct PlannedShot {
    /// The picture.
    pub shot: ScenePhotograph,
    /// Readings that each pixel stands for.
    pub counts: Vec<f64>,
}

impl PlannedShot {
    /// A picture in at most so many columns.
    pub fn taken(shot: &ScenePhotograph, columns: usize) -> PlannedShot {
        let fitted = |k: usize| shot.uses[k] == PixelUse::Fitted;
        let [w, h] = shot.size;
        if w <= columns || !matches!(shot.by, ReadingKind::Camera(_)) {
            let counts = (0..shot.uses.len()).map(|k| f64::from(u8::from(fitted(k)))).collect();
            return PlannedShot { shot: shot.clone(), counts };
        }
        let size = [columns, ((h * columns) as f64 / w as f64).round().max(1.0) as usize];
        let all = size[0] * size[1];
        let (mut counts, mut squares, mut n) = (vec![0.0; all], vec![0.0; 3 * all], vec![0.0f64; all]);
        for k in 0..shot.uses.len() {
            let to = k / w * size[1] / h * size[0] + k % w * size[0] / w;
            counts[to] += f64::from(u8::from(fitted(k)));
            if let Some(error) = &shot.error {
                (0..3).for_each(|c| squares[3 * to + c] += error[3 * k + c].powi(2));
                n[to] += 1.0;
            }
        }
        let mean = |i: usize| (squares[i] / n[i / 3].max(1.0)).sqrt();
        let uses = counts.iter().map(|count| if *count > 0.0 { PixelUse::Fitted } else { PixelUse::Out }).collect();
        let error = shot.error.as_ref().map(|_| (0..3 * all).map(mean).collect());
        let coarse = ScenePhotograph { size, seen: vec![0.0; 3 * all], error, uses, ..shot.clone() };
        PlannedShot { shot: coarse, counts }
    }
}

/// All pictures, drawn without derivatives.
pub struct PlannedNoise {
    shown: Vec<DerivativePicture>,
    /// Variance of each reading, and that of the own noise of the pictures that a fit will draw.
    variances: Vec<Vec<[f64; 2]>>,
}

impl PlannedNoise {
    /// Draws the pictures, and finds out how many paths a fit will follow. All of its pictures have as many, so that
    /// their own noise is large where light comes in many ways: between leaves, and through them.
    pub fn drawn(
        numbers: &SceneUnknowns,
        lit: &[LitScene],
        planned: &[PlannedShot],
        [samples, seed]: [u64; 2],
    ) -> Result<PlannedNoise> {
        let [rounds, each] = rounds(samples as u32, 1);
        let (mut shown, mut all, mut owns) = (Vec::new(), Vec::new(), Vec::new());
        for (k, PlannedShot { shot, counts }) in planned.iter().enumerate() {
            let shots = std::slice::from_ref(shot);
            let picture = draw(lit, shots, |_| true, None, [2 * rounds, each], picture_seed(seed, k))?.swap_remove(0);
            let variances = variances(shot, [&picture, &picture], 2 * rounds, exposure(numbers, shot));
            // What shows nothing has no noise, and the fit leaves it out.
            let counted = |at: &usize| counts[at / shot.channels] > 0.0 && picture.mean[*at] != 0.0;
            let counted = (0..variances.len()).filter(counted);
            owns.extend(counted.map(|at| (variances[at][1] / variances[at][0]).sqrt()).filter(|own| own.is_finite()));
            shown.push(picture);
            all.push(variances);
        }
        // The variances are those of twice as many paths.
        let paths = f64::from(4 * rounds * each);
        let own = median_of(owns).unwrap_or(0.0) * (paths / f64::from(PATHS)).sqrt();
        let share = paths / f64::from(last_paths(own, SAMPLES));
        all.iter_mut().flatten().for_each(|[_, own]| *own *= share);
        Ok(PlannedNoise { shown, variances: all })
    }
}

fn picture_seed(seed: u64, k: usize) -> u64 {
    seed ^ (k as u64) << 40
}

/// Rows whose products sum to the information of picture `k` on the numbers.
pub fn rows(
    numbers: &SceneUnknowns,
    lit: &[LitScene],
    (planned, noise, k): (&[PlannedShot], &PlannedNoise, usize),
    unit: &[f64],
    [samples, seed]: [u64; 2],
) -> Result<Vec<f64>> {
    let (shot, counts) = (&planned[k].shot, &planned[k].counts);
    let shots = std::slice::from_ref(shot);
    let [rounds, each] = rounds(samples as u32, 1);
    let mine = picture_seed(seed, k);
    let all = |_: &ScenePhotograph| true;
    let one = &draw(lit, shots, all, Some(0), [rounds, each], mine + 1)?[0];
    let two = &draw(lit, shots, all, Some(1), [rounds, each], mine + 2)?[0];
    let (first, n) = numbers.places();
    let of = &lit.first().map(LitScene::by).unwrap_or_default();
    let slopes = ShotSlopes { numbers, shot, of, pictures: [one, two] };
    let factor = exposure(numbers, shot);
    let (shown, variances) = (&noise.shown[k], &noise.variances[k]);
    let (mut information, mut row) = (DMatrix::<f64>::zeros(n, n), Vec::with_capacity(n));
    for (k, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0.0) {
        for c in 0..shot.channels {
            let at = k * shot.channels + c;
            if shown.mean[at] == 0.0 {
                continue;
            }
            // The mean of 1/(ax² + b) of an uncertain x is larger than its value at the mean x, by the second
            // derivative.
            let [measured, own] = variances[at];
            let relative = (shot.noise * factor).powi(2);
            let bent = 4.0 * relative * shown.mean[at].powi(2) / (measured + own) - 1.0;
            let weight = count / (measured + own + relative * shown.variance[at] * bent.max(0.0));
            slopes.row(&first, k, c, &mut row);
            for (i, p, q) in &row {
                for (j, u, v) in &row {
                    information[(*i, *j)] += 0.5 * weight * (p * v + q * u);
                }
            }
        }
    }
    Ok(root(&information, unit))
}

/// Rows R with Rᵀ R = N. What noise has made negative is nothing.
fn root(information: &DMatrix<f64>, unit: &[f64]) -> Vec<f64> {
    let n = unit.len();
    let scaled = DMatrix::from_fn(n, n, |i, j| 0.5 * (information[(i, j)] + information[(j, i)]) * unit[i] * unit[j]);
    let Some(eigen) = symmetric_eigen(scaled) else { return Vec::new() };
    let mut rows = Vec::new();
    for (k, value) in eigen.eigenvalues.iter().enumerate().filter(|(_, value)| **value > 0.0) {
        rows.extend((0..n).map(|j| value.sqrt() * eigen.eigenvectors[(j, k)] / unit[j]));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rows' products sum to the matrix that they are a root of, in numbers of unlike units.
    #[test]
    fn rows_are_a_root() {
        let unit = [1.0, 1e-3, 50.0];
        let some = DMatrix::from_row_slice(2, 3, &[3.0, 4e3, 0.02, -1.0, 2e3, 0.05]);
        let information = some.transpose() * &some;
        let rows = root(&information, &unit);
        let found = DMatrix::from_row_slice(rows.len() / 3, 3, &rows);
        let again = found.transpose() * &found;
        for (a, b) in again.iter().zip(information.iter()) {
            assert!((a - b).abs() < 1e-9 * b.abs().max(1e-6), "{again} {information}");
        }
    }
}
