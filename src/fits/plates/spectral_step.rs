//! The constants of all wavelengths, where the numbers of the leaves are known: one step of damped least squares, with
//! a penalty for constants that are not smooth over wavelength.

use super::banded::BandedMatrix;
use super::leaf::PlateLight;
use super::training::PlateExample;
use super::{FREE, PlatePoint, REACH};
use rayon::prelude::*;

/// The size of each constant; a step of a hundredth of it between two wavelengths costs as much as a reading.
const SIZE: [f64; FREE] = [2.5, 0.6, 0.5, 0.15, 0.5, 0.3, 1.0];
/// Weight of a second difference over steps of [`STEP`] nm, in units of [`SIZE`].
const SMOOTH: f64 = 0.01;
const STEP: f64 = 5.0;
/// Weights, for each leaf, of the pull of index and growth towards a usual one: they are weakly determined where leaves
/// are dark.
const PULL: [f64; FREE] = [0.0, 0.0, 0.0, 0.0, 0.0, 1e-3, 1e-2];
const LOWEST: [f64; FREE] = [0.0, 0.0, 0.0, 0.0, 0.0, 1.05, 0.05];
const HIGHEST: [f64; FREE] = [f64::MAX, f64::MAX, f64::MAX, f64::MAX, f64::MAX, 2.2, 10.0];

/// A usual index: that of a plate, which falls from 1.5 in blue light.
pub(super) fn usual_index(wavelength: f64) -> f64 {
    1.5 - 0.12 * (wavelength - 400.0) / 2100.0
}

/// The leaves, their numbers and the wavelengths.
pub(super) struct SpectralStep<'a> {
    pub wavelengths: &'a [f64],
    pub examples: &'a [&'a PlateExample],
    pub numbers: &'a [[f64; FREE]],
}

impl SpectralStep<'_> {
    /// The largest value of a constant at a wavelength.
    fn most(&self, at: usize, j: usize) -> f64 {
        let w = self.wavelengths[at];
        match REACH.get(j) {
            Some([low, high]) if !(*low..=*high).contains(&w) => 0.0,
            _ => HIGHEST[j],
        }
    }

    /// Weights of three neighbours in the second difference in the middle.
    fn second(&self, k: usize) -> [f64; 3] {
        let [a, b, c] = [0, 1, 2].map(|i| self.wavelengths[k + i]);
        let scale = 2.0 * STEP * STEP / (c - a) * ((c - a) / (2.0 * STEP)).sqrt();
        let (left, right) = (scale / (b - a), scale / (c - b));
        [left, -(left + right), right]
    }

    fn triples(&self) -> usize {
        self.wavelengths.len().saturating_sub(2)
    }

    fn target(&self, at: usize, j: usize) -> f64 {
        if j == 5 { usual_index(self.wavelengths[at]) } else { 1.0 }
    }

    /// Sum of squares of readings and penalties.
    pub fn cost(&self, points: &[PlatePoint]) -> f64 {
        let leaves = self.examples.len() as f64;
        let readings: Vec<f64> = (0..points.len())
            .into_par_iter()
            .map(|at| {
                let light = PlateLight::new(points[at]);
                let of = |(example, leaf): (&&PlateExample, &[f64; FREE])| {
                    let values = light.values(leaf);
                    let miss = |k: usize| example.spectra[at][k] - values[k];
                    [0, 1].map(miss).iter().filter(|r| !r.is_nan()).map(|r| r * r).sum::<f64>()
                };
                let pulled = |j: usize| leaves * PULL[j] * (points[at].all()[j] - self.target(at, j)).powi(2);
                self.examples.iter().zip(self.numbers).map(of).sum::<f64>() + (0..FREE).map(pulled).sum::<f64>()
            })
            .collect();
        let rough: f64 = (0..self.triples())
            .map(|k| {
                let weights = self.second(k);
                let all = [0, 1, 2].map(|i| points[k + i].all());
                let of = |j: usize| (0..3).map(|i| weights[i] * all[i][j]).sum::<f64>() / SIZE[j];
                (0..FREE).map(|j| SMOOTH * of(j).powi(2)).sum::<f64>()
            })
            .sum();
        readings.iter().sum::<f64>() + rough
    }

    /// Normal equations of one wavelength: the matrix and the right side.
    fn normal(&self, at: usize, point: PlatePoint) -> ([[f64; FREE]; FREE], [f64; FREE]) {
        let light = PlateLight::new(point);
        let (mut matrix, mut right) = ([[0.0; FREE]; FREE], [0.0; FREE]);
        for (example, leaf) in self.examples.iter().zip(self.numbers) {
            let (depth, crossings) = light.state(leaf);
            let response = light.index.response(depth, crossings, leaf[super::GLOSS]);
            for (x, measured) in response.iter().zip(example.spectra[at]) {
                let residual = measured - x.value;
                if residual.is_nan() {
                    continue;
                }
                let mut by = [0.0; FREE];
                for (by, c) in by.iter_mut().zip(&leaf[..5]) {
                    *by = c * x.by_depth;
                }
                by[5] = x.by_index;
                by[6] = leaf[super::PLATES] * x.by_crossings;
                for i in 0..FREE {
                    right[i] += by[i] * residual;
                    for j in 0..=i {
                        matrix[i][j] += by[i] * by[j];
                    }
                }
            }
        }
        (matrix, right)
    }

    /// Takes one step where it lowers the cost. Returns the cost; `damping` is adapted.
    pub fn step(&self, points: &mut Vec<PlatePoint>, cost: f64, damping: &mut f64) -> f64 {
        let (count, leaves) = (points.len(), self.examples.len() as f64);
        let mut normals: Vec<_> = (0..count).into_par_iter().map(|at| self.normal(at, points[at])).collect();
        let now: Vec<[f64; FREE]> = points.iter().map(PlatePoint::all).collect();
        for (at, (matrix, right)) in normals.iter_mut().enumerate() {
            for j in 0..FREE {
                right[j] -= leaves * PULL[j] * (now[at][j] - self.target(at, j));
                matrix[j][j] = (matrix[j][j] + leaves * PULL[j]) * (1.0 + *damping) + 1e-14;
            }
        }
        let mut rough: Vec<(usize, [f64; 3])> = Vec::new();
        for k in 0..self.triples() {
            let weights = self.second(k);
            for j in 0..FREE {
                let bend: f64 = (0..3).map(|i| weights[i] * now[k + i][j]).sum();
                for (i, w) in weights.iter().enumerate() {
                    normals[k + i].1[j] -= SMOOTH * w * bend / (SIZE[j] * SIZE[j]);
                }
            }
            rough.push((k, weights));
        }
        // What rests on a bound and is pushed beyond it stays.
        let fixed = |at: usize, j: usize| {
            let push = normals[at].1[j];
            now[at][j] <= LOWEST[j] && push <= 0.0 || now[at][j] >= self.most(at, j) && push >= 0.0
        };
        let mut system = BandedMatrix::zeros(count * FREE, 2 * FREE);
        for (at, (matrix, _)) in normals.iter().enumerate() {
            for i in 0..FREE {
                for j in 0..=i {
                    if i == j || !fixed(at, i) && !fixed(at, j) {
                        *system.at(at * FREE + i, at * FREE + j) += matrix[i][j];
                    }
                }
            }
        }
        for (k, weights) in rough {
            for a in 0..3 {
                for b in 0..=a {
                    for j in 0..FREE {
                        if a == b || !fixed(k + a, j) && !fixed(k + b, j) {
                            *system.at((k + a) * FREE + j, (k + b) * FREE + j) +=
                                SMOOTH * weights[a] * weights[b] / (SIZE[j] * SIZE[j]);
                        }
                    }
                }
            }
        }
        let right: Vec<f64> = (0..count)
            .flat_map(|at| (0..FREE).map(move |j| (at, j)))
            .map(|(at, j)| if fixed(at, j) { 0.0 } else { normals[at].1[j] })
            .collect();
        let moved = system.solve(right).map(|step| {
            let of = |at: usize| {
                let to = |j: usize| (now[at][j] + step[at * FREE + j]).clamp(LOWEST[j], self.most(at, j));
                PlatePoint::of(std::array::from_fn(to))
            };
            (0..count).map(of).collect::<Vec<_>>()
        });
        if let Some(moved) = moved {
            let next = self.cost(&moved);
            if next < cost {
                *points = moved;
                *damping = (*damping * 0.3).max(1e-8);
                return next;
            }
        }
        *damping = (*damping * 8.0).min(1e4);
        cost
    }
}
