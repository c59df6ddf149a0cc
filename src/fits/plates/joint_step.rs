//! Leaves and wavelengths in one step of damped least squares.
//!
//! In turns, what leaves and constants share moves slowly: a little more of the index is a little less of the plates in
//! all leaves. One step for both finds it at once. The constants are eliminated, and the numbers of the leaves are
//! solved for by conjugate gradients, because each leaf has to do with each wavelength.

use super::leaf::{PlateClue, PlateLight};
use super::spectral_step::{SpectralStep, SpectralSystem};
use super::{FREE, GLOSS, LOWER, PLATES, PlatePoint, UPPER};
use mesophyll_optics::plates::PlateSensitivity;
use nalgebra::{Cholesky, Const, SMatrix, SVector};
use rayon::prelude::*;

type Matrix = SMatrix<f64, FREE, FREE>;
type Vector = SVector<f64, FREE>;

/// Conjugate gradients end where the residual has fallen by this.
const FALL: f64 = 1e-4;
/// Steps of conjugate gradients at most.
const MOST: usize = 150;

/// The leaves with what else is known of them, and the constants.
pub(super) struct JointStep<'a> {
    /// The spectra.
    pub spectral: SpectralStep<'a>,
    /// What is known of each leaf beside its spectra.
    pub clues: &'a [Vec<PlateClue>],
    /// What a reading weighs beside them: its standard error.
    pub weight: f64,
}

/// R and T of all leaves at all wavelengths, with derivatives. These are 0 where a reading is missing.
struct JointSlopes<'a> {
    points: &'a [PlatePoint],
    numbers: &'a [[f64; FREE]],
    /// R and T of each leaf at each wavelength.
    responses: Vec<Vec<[PlateSensitivity; 2]>>,
}

impl JointSlopes<'_> {
    /// Derivatives of a reading by the numbers of the leaf, and by the constants of the wavelength.
    fn of(&self, leaf: usize, at: usize, k: usize) -> [[f64; FREE]; 2] {
        let of = &self.responses[leaf][at][k];
        let (point, numbers) = (&self.points[at], &self.numbers[leaf]);
        let (mut by_leaf, mut by_point) = ([0.0; FREE], [0.0; FREE]);
        for j in 0..PLATES {
            by_leaf[j] = point.specific[j] * of.by_depth;
            by_point[j] = numbers[j] * of.by_depth;
        }
        by_leaf[PLATES] = point.growth * of.by_crossings;
        by_leaf[GLOSS] = of.by_gloss;
        by_point[5] = of.by_index;
        by_point[6] = numbers[PLATES] * of.by_crossings;
        [by_leaf, by_point]
    }

    /// What a change of the leaves is to the constants: `Jₚᵀ Jₗ x`.
    fn to_points(&self, x: &[Vector]) -> Vec<f64> {
        let at = |at: usize| {
            let mut out = [0.0; FREE];
            for (leaf, x) in x.iter().enumerate() {
                for k in 0..2 {
                    let [by_leaf, by_point] = self.of(leaf, at, k);
                    let moved: f64 = by_leaf.iter().zip(x.iter()).map(|(a, b)| a * b).sum();
                    out.iter_mut().zip(by_point).for_each(|(o, by)| *o += by * moved);
                }
            }
            out
        };
        (0..self.points.len()).into_par_iter().map(at).collect::<Vec<_>>().concat()
    }

    /// What a change of the constants is to the leaves: `Jₗᵀ Jₚ y`.
    fn to_leaves(&self, y: &[f64]) -> Vec<Vector> {
        let of = |leaf: usize| {
            let mut out = Vector::zeros();
            for at in 0..self.points.len() {
                for k in 0..2 {
                    let [by_leaf, by_point] = self.of(leaf, at, k);
                    let moved: f64 = by_point.iter().zip(&y[at * FREE..]).map(|(a, b)| a * b).sum();
                    out.iter_mut().zip(by_leaf).for_each(|(o, by)| *o += by * moved);
                }
            }
            out
        };
        (0..self.numbers.len()).into_par_iter().map(of).collect()
    }
}

impl JointStep<'_> {
    /// Sum of squares of readings, clues and penalties.
    pub fn cost(&self, points: &[PlatePoint]) -> f64 {
        let of = |(clues, leaf): (&Vec<PlateClue>, &[f64; FREE])| {
            clues.iter().map(|c| c.residual(leaf).powi(2)).sum::<f64>() * self.weight * self.weight
        };
        self.spectral.cost(points) + self.clues.iter().zip(self.spectral.numbers).map(of).sum::<f64>()
    }

    fn slopes<'a>(&'a self, points: &'a [PlatePoint]) -> JointSlopes<'a> {
        let lights: Vec<PlateLight> = points.iter().map(|p| PlateLight::new(*p)).collect();
        let of = |(leaf, numbers): (usize, &[f64; FREE])| {
            let at = |(light, measured): (&PlateLight, &[f64; 2])| {
                let flat =
                    |value| PlateSensitivity { value, by_depth: 0.0, by_crossings: 0.0, by_gloss: 0.0, by_index: 0.0 };
                let mut response = light.sensitivity(numbers);
                for (of, measured) in response.iter_mut().zip(measured) {
                    if measured.is_nan() {
                        *of = flat(of.value);
                    }
                }
                response
            };
            lights.iter().zip(&self.spectral.examples[leaf].spectra).map(at).collect()
        };
        let numbers = self.spectral.numbers;
        JointSlopes { points, numbers, responses: numbers.par_iter().enumerate().map(of).collect() }
    }

    /// The normal equations of each leaf alone, and which of its numbers rest on a bound and are pushed beyond it.
    fn leaves(&self, slopes: &JointSlopes, damping: f64) -> Vec<(Matrix, Vector, [bool; FREE])> {
        let of = |leaf: usize| {
            let numbers = &self.spectral.numbers[leaf];
            let (mut matrix, mut right) = (Matrix::zeros(), Vector::zeros());
            for (at, response) in slopes.responses[leaf].iter().enumerate() {
                for k in 0..2 {
                    let residual = self.spectral.examples[leaf].spectra[at][k] - response[k].value;
                    if !residual.is_nan() {
                        let by = Vector::from(slopes.of(leaf, at, k)[0]);
                        right += by * residual;
                        matrix += by * by.transpose();
                    }
                }
            }
            for clue in &self.clues[leaf] {
                let by = Vector::from(clue.weights) * (self.weight / clue.sigma);
                right -= by * (self.weight * clue.residual(numbers));
                matrix += by * by.transpose();
            }
            let fixed: [bool; FREE] = std::array::from_fn(|j| {
                numbers[j] <= LOWER[j] && right[j] <= 0.0 || numbers[j] >= UPPER[j] && right[j] >= 0.0
            });
            for j in 0..FREE {
                matrix[(j, j)] = matrix[(j, j)] * (1.0 + damping) + 1e-14;
                if fixed[j] {
                    right[j] = 0.0;
                    (0..FREE).filter(|i| *i != j).for_each(|i| {
                        matrix[(i, j)] = 0.0;
                        matrix[(j, i)] = 0.0;
                    });
                }
            }
            (matrix, right, fixed)
        };
        (0..self.spectral.numbers.len()).into_par_iter().map(of).collect()
    }

    /// The step of the leaves and that of the constants.
    fn solve(&self, slopes: &JointSlopes, damping: f64) -> Option<(Vec<Vector>, Vec<f64>)> {
        let leaves = self.leaves(slopes, damping);
        let SpectralSystem { factor, right, fixed } =
            self.spectral.system_of(slopes.points, damping, &|leaf, at| slopes.responses[leaf][at])?;
        let own: Vec<Cholesky<f64, Const<FREE>>> =
            leaves.iter().map(|(matrix, ..)| matrix.cholesky()).collect::<Option<_>>()?;
        let free = |y: Vec<f64>| y.into_iter().zip(&fixed).map(|(y, f)| if *f { 0.0 } else { y }).collect::<Vec<_>>();
        let kept = |mut x: Vec<Vector>| {
            for (x, (.., fixed)) in x.iter_mut().zip(&leaves) {
                (0..FREE).filter(|j| fixed[*j]).for_each(|j| x[j] = 0.0);
            }
            x
        };
        let beyond = |x: &[Vector]| free(slopes.to_points(x));
        let back = |y: &[f64]| kept(slopes.to_leaves(y));
        let apply = |x: &[Vector]| -> Vec<Vector> {
            let through = back(&factor.solve(beyond(x)));
            leaves.iter().zip(x).zip(through).map(|(((matrix, ..), x), t)| matrix * x - t).collect()
        };
        let dot = |a: &[Vector], b: &[Vector]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        let alone = back(&factor.solve(right.clone()));
        let mut residual: Vec<Vector> = leaves.iter().zip(alone).map(|((_, right, _), a)| right - a).collect();
        let prepared = |r: &[Vector]| r.iter().zip(&own).map(|(r, own)| own.solve(r)).collect::<Vec<Vector>>();
        let mut x = vec![Vector::zeros(); leaves.len()];
        let mut along = prepared(&residual);
        let mut size = dot(&residual, &along);
        let enough = size * FALL * FALL;
        for _ in 0..MOST {
            let moved = apply(&along);
            let bend = dot(&along, &moved);
            if size <= enough || bend <= 0.0 || !bend.is_finite() {
                break;
            }
            let share = size / bend;
            x.iter_mut().zip(&along).for_each(|(x, a)| *x += a * share);
            residual.iter_mut().zip(&moved).for_each(|(r, m)| *r -= m * share);
            let next = prepared(&residual);
            let (before, now) = (size, dot(&residual, &next));
            size = now;
            along.iter_mut().zip(next).for_each(|(a, n)| *a = n + *a * (now / before));
        }
        let rest: Vec<f64> = right.iter().zip(beyond(&x)).map(|(r, b)| r - b).collect();
        Some((x, factor.solve(rest)))
    }

    /// Takes one step where it lowers the cost: the numbers of the leaves, the constants and the cost after it.
    /// `damping` is adapted.
    pub fn step(
        &self,
        points: &[PlatePoint],
        cost: f64,
        damping: &mut f64,
    ) -> Option<(Vec<[f64; FREE]>, Vec<PlatePoint>, f64)> {
        if let Some((leaves, constants)) = self.solve(&self.slopes(points), *damping) {
            let to = |(now, step): (&[f64; FREE], &Vector)| {
                std::array::from_fn(|j| (now[j] + step[j]).clamp(LOWER[j], UPPER[j]))
            };
            let numbers: Vec<[f64; FREE]> = self.spectral.numbers.iter().zip(&leaves).map(to).collect();
            let moved = self.spectral.moved(points, &constants);
            let after = JointStep { spectral: SpectralStep { numbers: &numbers, ..self.spectral }, ..*self };
            let next = after.cost(&moved);
            if next < cost {
                *damping = (*damping * 0.2).max(1e-6);
                return Some((numbers, moved, next));
            }
        }
        *damping = (*damping * 8.0).min(1e4);
        None
    }
}
