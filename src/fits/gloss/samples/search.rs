//! The least sum of squares of a leaf's readings: a grid over slope and normal, descents from its best points, and the
//! linear parameters at each of them.

use super::{GlossSample, INDICES, TILT};
use crate::gloss::{M_RANGE, normal_of};
use argmin::core::{CostFunction, Executor, State as _};
use argmin::solver::neldermead::NelderMead;
use mesophyll_base::solvers::Termination;
use mesophyll_base::solvers::damping::{self, DampedProblem, DampingControl};
use mesophyll_optics::gloss::{Lobe, LobeKind};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// How many local searches start from the grid.
const STARTS: usize = 6;
/// The grid looks at about so many directions and at the mean of the columns; the descents use all.
const GRID_DIRECTIONS: usize = 120;
/// Step of differences in every parameter.
const STEP: f64 = 1e-5;

/// ln m, tilt along and across (rad) in the frame of [`Problem::turn`], index of refraction.
pub(super) type Point = [f64; 4];

/// A leaf's readings and what is fitted to them.
#[derive(Clone)]
pub(super) struct Problem<'a> {
    pub samples: &'a [GlossSample],
    pub kind: LobeKind,
    pub bands: usize,
    /// Weight of each reading, by sample, then by value column; 0 where there is no reading.
    pub weights: Vec<f64>,
    /// Azimuth of the frame in which the tilts along and across are counted (rad).
    pub turn: f64,
    /// Which components of a [`Point`] are fitted.
    pub free: [bool; 4],
    /// The index of refraction where it is not fitted.
    pub index: f64,
}

/// Linear parameters at a point, and the weighted sum of squares.
#[derive(Debug, Clone)]
pub(super) struct Solved {
    pub rho_d: Vec<f64>,
    pub rho_s: f64,
    pub sum: f64,
}

/// Weight 1 for every reading that there is.
pub(super) fn even(samples: &[GlossSample]) -> Vec<f64> {
    samples.iter().flat_map(|s| &s.values).map(|v| f64::from(u8::from(v.is_finite()))).collect()
}

impl Problem<'_> {
    /// Ends of the descents, best first, with their sums of squares.
    pub fn search(&self) -> Vec<(f64, Point)> {
        let few = self.grey();
        let sparse = Problem { samples: &few, weights: even(&few), bands: 1, ..self.clone() };
        let mut grid: Vec<(f64, Point)> = Vec::new();
        for i in 0..16 {
            let m = 0.03f64.ln() + (M_RANGE[1].ln() - 0.03f64.ln()) * f64::from(i) / 15.0;
            let pitch = (0.7 * m.exp()).clamp(0.03, 0.1);
            let count = (TILT / pitch).ceil() as i32;
            let tilts = |free: bool| if free { -count..=count } else { 0..=0 };
            for a in tilts(self.free[1]) {
                for b in tilts(self.free[2]) {
                    let tilt = |k: i32| TILT * f64::from(k) / f64::from(count);
                    let p = [m, tilt(a), tilt(b), self.index];
                    grid.push((sparse.sum(&p), p));
                }
            }
        }
        grid.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut starts: Vec<Point> = Vec::new();
        for (_, p) in &grid {
            let near = |q: &Point| (p[0] - q[0]).abs() < 0.5 && (1..3).all(|k| (p[k] - q[k]).abs() < 0.12);
            if !starts.iter().any(near) {
                starts.push(*p);
            }
            if starts.len() == STARTS {
                break;
            }
        }
        self.descend(starts.into_iter().map(|start| self.simplex(start)))
    }

    /// Some of the directions with the mean of their columns. The gloss is grey, so it shows there as well as in all
    /// columns, as long as none lacks a reading.
    fn grey(&self) -> Vec<GlossSample> {
        let every = self.samples.len().div_ceil(GRID_DIRECTIONS);
        let mean = |k: usize| {
            let read = self.samples.iter().map(|s| s.values[k]).filter(|v| v.is_finite());
            read.clone().sum::<f64>() / read.count() as f64
        };
        let means: Vec<f64> = (0..self.bands).map(mean).collect();
        let grey = |s: &GlossSample| {
            // A column without a reading here would shift the mean by its own level.
            let read = s.values.iter().zip(&means).filter(|(v, _)| v.is_finite()).map(|(v, mean)| v - mean);
            let level = means.iter().sum::<f64>() / self.bands as f64;
            let count = read.clone().count();
            GlossSample { values: vec![level + read.sum::<f64>() / count as f64], ..s.clone() }
        };
        self.samples.iter().step_by(every).map(grey).collect()
    }

    /// Levenberg–Marquardt from each start; best first.
    pub fn descend(&self, starts: impl Iterator<Item = Point>) -> Vec<(f64, Point)> {
        let mut ends: Vec<(f64, Point)> = starts.map(|start| self.polish(start)).collect();
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        ends
    }

    /// tilt and tilt_y at a point.
    pub fn tilts(&self, p: &Point) -> [f64; 2] {
        let (sin, cos) = self.turn.sin_cos();
        [p[1] * cos - p[2] * sin, p[1] * sin + p[2] * cos]
    }

    pub fn lobe(&self, p: &Point) -> Lobe {
        Lobe::of(self.kind, p[3])
    }

    /// Components of a point that are fitted.
    pub fn live(&self) -> Vec<usize> {
        (0..4).filter(|k| self.free[*k]).collect()
    }

    /// π f_s of every sample.
    pub fn column(&self, p: &Point) -> Vec<f64> {
        let (n, m, lobe) = (normal_of(self.tilts(p)), p[0].exp(), self.lobe(p));
        self.samples.iter().map(|s| PI * lobe.value(n, s.light, s.view, m)).collect()
    }

    /// Change of [`Problem::column`] with component `k` of the point.
    pub fn change(&self, p: &Point, k: usize) -> Vec<f64> {
        let moved = |by: f64| {
            let mut q = *p;
            q[k] += by;
            self.column(&q)
        };
        moved(STEP).iter().zip(moved(-STEP)).map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
    }

    pub fn at(&self, p: &Point) -> Solved {
        self.solve(&self.column(p))
    }

    fn solve(&self, column: &[f64]) -> Solved {
        // Each band is centred, then one common slope is fitted.
        let each = |k: usize| {
            let weights = self.weights.iter().skip(k).step_by(self.bands);
            let rows = self.samples.iter().zip(column).zip(weights).filter(|(_, w)| **w > 0.0);
            rows.map(move |((s, c), w)| (s.values[k], *c, *w))
        };
        // Of each band: weight, mean reading, mean of the column, and the centred sums of their product and square.
        let mut sums = Vec::with_capacity(self.bands);
        for k in 0..self.bands {
            let whole: f64 = each(k).map(|(_, _, w)| w).sum();
            let (y, c) = each(k).fold((0.0, 0.0), |(a, b), (y, c, w)| (a + w * y / whole, b + w * c / whole));
            let (mut top, mut bottom) = (0.0, 0.0);
            for (v, x, w) in each(k) {
                top += w * (v - y) * (x - c);
                bottom += w * (x - c) * (x - c);
            }
            sums.push([whole, y, c, top, bottom]);
        }
        // A ρd below zero is held at zero, and its band is then no longer centred. Which bands are held follows from
        // ρs; the sum of squares is convex in ρs, so this ends after a few turns.
        let mut held = vec![false; self.bands];
        let mut rho_s = 0.0;
        for _ in 0..2 * self.bands + 2 {
            let (mut top, mut bottom) = (0.0, 0.0);
            for ([whole, y, c, xy, xx], held) in sums.iter().zip(&held) {
                let raw = if *held { *whole } else { 0.0 };
                top += xy + raw * y * c;
                bottom += xx + raw * c * c;
            }
            rho_s = if bottom > 0.0 { (top / bottom).max(0.0) } else { 0.0 };
            let now: Vec<bool> = sums.iter().map(|[_, y, c, ..]| y - rho_s * c < 0.0).collect();
            if now == held {
                break;
            }
            held = now;
        }
        let rho_d: Vec<f64> = sums.iter().map(|[_, y, c, ..]| (y - rho_s * c).max(0.0)).collect();
        let square = |(k, r): (usize, &f64)| each(k).map(|(v, x, w)| w * (v - r - rho_s * x).powi(2)).sum::<f64>();
        let sum = rho_d.iter().enumerate().map(square).sum();
        Solved { rho_d, rho_s, sum }
    }

    /// Sum of squares at a point. Outside the allowed range it rises steeply.
    fn sum(&self, p: &Point) -> f64 {
        let q = self.clamp(p);
        let outside: f64 = p.iter().zip(&q).map(|(a, b)| (a - b).powi(2)).sum();
        self.at(&q).sum * (1.0 + 10.0 * outside) + outside
    }

    /// The nearest point within what is searched.
    fn clamp(&self, p: &Point) -> Point {
        let slope = p[0].clamp(M_RANGE[0].ln(), M_RANGE[1].ln());
        let index = if self.free[3] { p[3].clamp(INDICES[0], INDICES[1]) } else { p[3] };
        [slope, p[1].clamp(-TILT, TILT), p[2].clamp(-TILT, TILT), index]
    }

    fn simplex(&self, start: Point) -> Point {
        let live = self.live();
        let mut corners = vec![live.iter().map(|&k| start[k]).collect::<Vec<f64>>()];
        for (place, &k) in live.iter().enumerate() {
            let mut corner = corners[0].clone();
            corner[place] += [0.15, 0.04, 0.04, 0.05][k];
            corners.push(corner);
        }
        let Ok(solver) = NelderMead::new(corners).with_sd_tolerance(1e-14) else { return start };
        let run = Executor::new(Simplex(self, start), solver).configure(|s| s.max_iters(300)).run();
        match run.ok().and_then(|r| r.state().get_best_param().cloned()) {
            Some(found) if found.len() == live.len() => self.clamp(&self.filled(start, &found)),
            _ => start,
        }
    }

    /// `base` with these values of the fitted components.
    fn filled(&self, mut base: Point, values: &[f64]) -> Point {
        for (k, v) in self.live().into_iter().zip(values) {
            base[k] = *v;
        }
        base
    }

    /// Residuals of all readings at `p` times the root of their weight, with the linear parameters at their best.
    fn residuals(&self, p: &Point) -> Vec<f64> {
        let column = self.column(p);
        let s = self.solve(&column);
        let mut out = Vec::with_capacity(self.weights.len());
        for ((sample, x), weights) in self.samples.iter().zip(&column).zip(self.weights.chunks(self.bands)) {
            for ((v, r), w) in sample.values.iter().zip(&s.rho_d).zip(weights).filter(|(_, w)| **w > 0.0) {
                out.push(w.sqrt() * (v - r - s.rho_s * x));
            }
        }
        out
    }

    /// Levenberg–Marquardt on the projected residuals, derivatives by central differences (a leaf has few samples).
    fn polish(&self, start: Point) -> (f64, Point) {
        let control =
            DampingControl { damping: 1e-3, tries: usize::MAX, most: 1e7, least: 0.0, ..DampingControl::MARQUARDT };
        let live = self.live();
        let mut descent =
            Polish { problem: self, matrix: DMatrix::zeros(0, 0), right: DVector::zeros(live.len()), live };
        damping::minimize(&mut descent, (self.at(&start).sum, start), &control).0
    }
}

/// The last refinement from a start close by. A point is the sum of squares together with its parameters.
struct Polish<'a, 'b> {
    problem: &'a Problem<'b>,
    live: Vec<usize>,
    /// JᵀJ and Jᵀr of the residuals.
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

impl DampedProblem for Polish<'_, '_> {
    type Point = (f64, Point);
    type Step = Vec<f64>;

    fn linearise(&mut self, (_, p): &mut Self::Point) {
        let slopes: Vec<Vec<f64>> = self
            .live
            .iter()
            .map(|&k| {
                let moved = |by: f64| {
                    let mut q = *p;
                    q[k] += by;
                    self.problem.residuals(&q)
                };
                // −∂residual/∂p.
                moved(-STEP).iter().zip(moved(STEP)).map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
            })
            .collect();
        let r = self.problem.residuals(p);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let n = slopes.len();
        self.matrix = DMatrix::from_fn(n, n, |i, j| dot(&slopes[i], &slopes[j]));
        self.right = DVector::from_fn(n, |i, _| dot(&slopes[i], &r));
    }

    fn step(&mut self, _: &Self::Point, damping: f64) -> Option<Vec<f64>> {
        let mut damped = self.matrix.clone();
        for i in 0..damped.nrows() {
            damped[(i, i)] = damped[(i, i)] * (1.0 + damping) + 1e-300;
        }
        damped.cholesky().map(|c| c.solve(&self.right).iter().copied().collect())
    }

    fn end(&mut self, _: &mut Self::Point, _: &Vec<f64>) -> Option<Termination> {
        None
    }

    fn take(&mut self, (_, p): &Self::Point, step: &Vec<f64>, _: f64) -> Self::Point {
        let moved: Vec<f64> = self.live.iter().zip(step).map(|(&k, s)| p[k] + s).collect();
        let next = self.problem.clamp(&self.problem.filled(*p, &moved));
        (self.problem.at(&next).sum, next)
    }

    fn better(&self, at: &Self::Point, trial: &Self::Point) -> bool {
        trial.0 < at.0
    }

    fn settled(&self, before: &Self::Point, now: &Self::Point) -> Option<Termination> {
        (before.0 - now.0 < 1e-14 * before.0).then_some(Termination::CostConverged)
    }
}

struct Simplex<'a, 'b>(&'a Problem<'b>, Point);

impl CostFunction for Simplex<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, p: &Vec<f64>) -> std::result::Result<f64, argmin::core::Error> {
        Ok(self.0.sum(&self.0.filled(self.1, p)))
    }
}

/// Whether a fitted index lies at an end of the range that is searched.
pub(super) fn at_end(index: f64) -> bool {
    index <= INDICES[0] + 1e-6 || index >= INDICES[1] - 1e-6
}
