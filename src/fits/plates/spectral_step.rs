//! The constants of all wavelengths, where the numbers of the leaves are known: one step of damped least squares, with
//! a penalty for constants that are not smooth over wavelength.

use super::banded::{BandedFactor, BandedMatrix};
use super::leaf::PlateLight;
use super::training::PlateExample;
use super::{FREE, PlatePoint, REACH};
use mesophyll_optics::plates::PlateSensitivity;
use nalgebra::SMatrix;
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

/// How much less what is assumed of the constants counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpectralGuard {
    /// Factor of the weight of smoothness.
    pub smooth: f64,
    /// Factor of the pull towards a usual index and growth.
    pub pull: f64,
}

impl SpectralGuard {
    /// All of it.
    pub const FULL: SpectralGuard = SpectralGuard { smooth: 1.0, pull: 1.0 };
}

/// The leaves, their numbers and the wavelengths.
#[derive(Clone, Copy)]
pub(super) struct SpectralStep<'a> {
    pub wavelengths: &'a [f64],
    pub examples: &'a [&'a PlateExample],
    pub numbers: &'a [[f64; FREE]],
    pub guard: SpectralGuard,
}

/// The linear system of a step.
pub(super) struct SpectralSystem {
    /// The matrix, factorised.
    pub factor: BandedFactor,
    /// The right side, for each wavelength and constant; 0 where the constant is fixed.
    pub right: Vec<f64>,
    /// Which constants rest on a bound and are pushed beyond it.
    pub fixed: Vec<bool>,
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

    /// The weights of the pull, and that of smoothness.
    fn weights(&self) -> ([f64; FREE], f64) {
        let leaves = self.examples.len() as f64;
        (PULL.map(|x| leaves * self.guard.pull * x), self.guard.smooth * SMOOTH)
    }

    fn target(&self, at: usize, j: usize) -> f64 {
        if j == 5 { usual_index(self.wavelengths[at]) } else { 1.0 }
    }

    /// Sum of squares of readings and penalties.
    pub fn cost(&self, points: &[PlatePoint]) -> f64 {
        let (pull, smooth) = self.weights();
        let readings: Vec<f64> = (0..points.len())
            .into_par_iter()
            .map(|at| {
                let light = PlateLight::new(points[at]);
                let of = |(example, leaf): (&&PlateExample, &[f64; FREE])| {
                    let values = light.values(leaf);
                    let miss = |k: usize| example.spectra[at][k] - values[k];
                    [0, 1].map(miss).iter().filter(|r| !r.is_nan()).map(|r| r * r).sum::<f64>()
                };
                let pulled = |j: usize| pull[j] * (points[at].all()[j] - self.target(at, j)).powi(2);
                self.examples.iter().zip(self.numbers).map(of).sum::<f64>() + (0..FREE).map(pulled).sum::<f64>()
            })
            .collect();
        let rough: f64 = (0..self.triples())
            .map(|k| {
                let weights = self.second(k);
                let all = [0, 1, 2].map(|i| points[k + i].all());
                let of = |j: usize| (0..3).map(|i| weights[i] * all[i][j]).sum::<f64>() / SIZE[j];
                (0..FREE).map(|j| smooth * of(j).powi(2)).sum::<f64>()
            })
            .sum();
        readings.iter().sum::<f64>() + rough
    }

    /// Normal equations of one wavelength, where `respond` says what a leaf shows there: the matrix and the right side.
    fn normal(
        &self,
        at: usize,
        respond: impl Fn(usize) -> [PlateSensitivity; 2],
    ) -> ([[f64; FREE]; FREE], [f64; FREE]) {
        let (mut matrix, mut right) = ([[0.0; FREE]; FREE], [0.0; FREE]);
        for (k, (example, leaf)) in self.examples.iter().zip(self.numbers).enumerate() {
            for (x, measured) in respond(k).iter().zip(example.spectra[at]) {
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

    /// Standard errors of the constants of each wavelength alone, from what is left of the leaves there. Also a
    /// constant that rests on its bound has one.
    pub fn errors(&self, points: &[PlatePoint]) -> Vec<[f64; FREE]> {
        let (pull, _) = self.weights();
        let at = |(at, point): (usize, &PlatePoint)| {
            let light = PlateLight::new(*point);
            let (mut sum, mut count) = (0.0, 0usize);
            for (example, leaf) in self.examples.iter().zip(self.numbers) {
                let values = light.values(leaf);
                for r in (0..2).map(|k| example.spectra[at][k] - values[k]).filter(|r| !r.is_nan()) {
                    sum += r * r;
                    count += 1;
                }
            }
            let (lower, _) = self.normal(at, |k| light.sensitivity(&self.numbers[k]));
            let full = SMatrix::<f64, FREE, FREE>::from_fn(|i, j| {
                let pulled = if i == j { pull[j] + 1e-14 } else { 0.0 };
                lower[i.max(j)][i.min(j)] + pulled
            });
            let square = sum / count.max(1) as f64;
            let allowed = |j: usize| self.most(at, j) > LOWEST[j];
            full.cholesky().map_or([0.0; FREE], |c| {
                let inverse = c.inverse();
                std::array::from_fn(|j| if allowed(j) { (square * inverse[(j, j)].max(0.0)).sqrt() } else { 0.0 })
            })
        };
        points.par_iter().enumerate().map(at).collect()
    }

    /// The linear system of a step from `points`; `None` where it has no solution.
    fn system(&self, points: &[PlatePoint], damping: f64) -> Option<SpectralSystem> {
        let lights: Vec<PlateLight> = points.iter().map(|p| PlateLight::new(*p)).collect();
        self.system_of(points, damping, &|leaf, at| lights[at].sensitivity(&self.numbers[leaf]))
    }

    /// The same, where `respond` says what a leaf shows at a wavelength.
    pub fn system_of(
        &self,
        points: &[PlatePoint],
        damping: f64,
        respond: &(dyn Fn(usize, usize) -> [PlateSensitivity; 2] + Sync),
    ) -> Option<SpectralSystem> {
        let count = points.len();
        let (pull, smooth) = self.weights();
        let normal = |at: usize| self.normal(at, |leaf| respond(leaf, at));
        let mut normals: Vec<_> = (0..count).into_par_iter().map(normal).collect();
        let now: Vec<[f64; FREE]> = points.iter().map(PlatePoint::all).collect();
        for (at, (matrix, right)) in normals.iter_mut().enumerate() {
            for j in 0..FREE {
                right[j] -= pull[j] * (now[at][j] - self.target(at, j));
                matrix[j][j] = (matrix[j][j] + pull[j]) * (1.0 + damping) + 1e-14;
            }
        }
        let mut rough: Vec<(usize, [f64; 3])> = Vec::new();
        for k in 0..self.triples() {
            let weights = self.second(k);
            for j in 0..FREE {
                let bend: f64 = (0..3).map(|i| weights[i] * now[k + i][j]).sum();
                for (i, w) in weights.iter().enumerate() {
                    normals[k + i].1[j] -= smooth * w * bend / (SIZE[j] * SIZE[j]);
                }
            }
            rough.push((k, weights));
        }
        // What rests on a bound and is pushed beyond it stays.
        let fixed: Vec<bool> = (0..count)
            .flat_map(|at| (0..FREE).map(move |j| (at, j)))
            .map(|(at, j)| {
                let push = normals[at].1[j];
                now[at][j] <= LOWEST[j] && push <= 0.0 || now[at][j] >= self.most(at, j) && push >= 0.0
            })
            .collect();
        let free = |at: usize, j: usize| !fixed[at * FREE + j];
        let mut system = BandedMatrix::zeros(count * FREE, 2 * FREE);
        for (at, (matrix, _)) in normals.iter().enumerate() {
            for i in 0..FREE {
                for j in 0..=i {
                    if i == j || free(at, i) && free(at, j) {
                        *system.at(at * FREE + i, at * FREE + j) += matrix[i][j];
                    }
                }
            }
        }
        for (k, weights) in rough {
            for a in 0..3 {
                for b in 0..=a {
                    for j in 0..FREE {
                        if a == b || free(k + a, j) && free(k + b, j) {
                            *system.at((k + a) * FREE + j, (k + b) * FREE + j) +=
                                smooth * weights[a] * weights[b] / (SIZE[j] * SIZE[j]);
                        }
                    }
                }
            }
        }
        let all = normals.iter().flat_map(|(_, right)| right);
        let right = all.zip(&fixed).map(|(x, fixed)| if *fixed { 0.0 } else { *x }).collect();
        Some(SpectralSystem { factor: system.factor()?, right, fixed })
    }

    /// The constants after a step, within their bounds.
    pub fn moved(&self, points: &[PlatePoint], step: &[f64]) -> Vec<PlatePoint> {
        let of = |(at, point): (usize, &PlatePoint)| {
            let now = point.all();
            let to = |j: usize| (now[j] + step[at * FREE + j]).clamp(LOWEST[j], self.most(at, j));
            PlatePoint::of(std::array::from_fn(to))
        };
        points.iter().enumerate().map(of).collect()
    }

    /// Takes one step where it lowers the cost. Returns the cost; `damping` is adapted.
    pub fn step(&self, points: &mut Vec<PlatePoint>, cost: f64, damping: &mut f64) -> f64 {
        if let Some(system) = self.system(points, *damping) {
            let moved = self.moved(points, &system.factor.solve(system.right));
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
