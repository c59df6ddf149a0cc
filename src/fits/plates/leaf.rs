//! One leaf: its seven numbers from its readings, where the coefficients are known.

use super::{FREE, GLOSS, GLOSS_BELOW, LEAN, PLATES, PlatePoint, SIDED};
use mesophyll_base::solvers::{ClosureProblem, Fit, Options as Solver, Problem, ResidualNoise, lm};
use mesophyll_optics::plates::{PlateIndex, PlateSensitivity};
use std::cell::RefCell;

/// A wavelength with its constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateLight {
    /// The constants.
    pub point: PlatePoint,
    /// What its index does at an interface.
    pub index: PlateIndex,
}

/// R and T, each with its derivatives by the seven numbers of a leaf.
pub type PlateResponse = [(f64, [f64; FREE]); 2];

impl PlateLight {
    /// Prepares a wavelength.
    pub fn new(point: PlatePoint) -> PlateLight {
        PlateLight { point, index: PlateIndex::new(point.index) }
    }

    /// What a leaf absorbs, and how many plates it counts here.
    pub fn state(&self, leaf: &[f64; FREE]) -> (f64, f64) {
        let depth: f64 = self.point.specific.iter().zip(leaf).map(|(k, c)| k * c).sum();
        (depth, 1.0 + leaf[PLATES] * self.point.growth)
    }

    /// R and T of a leaf.
    pub fn values(&self, leaf: &[f64; FREE]) -> [f64; 2] {
        let (depth, crossings) = self.state(leaf);
        self.index.values(depth, crossings, leaf[GLOSS])
    }

    /// R and T of a leaf, with derivatives by what the model takes.
    pub fn sensitivity(&self, leaf: &[f64; FREE]) -> [PlateSensitivity; 2] {
        let (depth, crossings) = self.state(leaf);
        self.index.response(depth, crossings, leaf[GLOSS])
    }

    /// R and T of both sides of a leaf with derivatives.
    pub fn both(&self, leaf: &[f64; SIDED]) -> [[(f64, [f64; SIDED]); 2]; 2] {
        let depth: f64 = self.point.specific.iter().zip(leaf).map(|(k, c)| k * c).sum();
        let crossings = 1.0 + leaf[PLATES] * self.point.growth;
        let of = |(value, [depth, plates, above, below, lean]): (f64, [f64; 5])| {
            let mut by = [0.0; SIDED];
            for (by, k) in by.iter_mut().zip(self.point.specific) {
                *by = k * depth;
            }
            by[PLATES] = self.point.growth * plates;
            [by[GLOSS], by[GLOSS_BELOW], by[LEAN]] = [above, below, lean];
            (value, by)
        };
        let gloss = [leaf[GLOSS], leaf[GLOSS_BELOW]];
        self.index.sides(depth, crossings, gloss, leaf[LEAN]).map(|side| side.map(of))
    }

    /// R and T of a leaf with derivatives.
    pub fn response(&self, leaf: &[f64; FREE]) -> PlateResponse {
        self.sensitivity(leaf).map(|x| {
            let mut by = [0.0; FREE];
            for (by, k) in by.iter_mut().zip(self.point.specific) {
                *by = k * x.by_depth;
            }
            by[PLATES] = self.point.growth * x.by_crossings;
            by[GLOSS] = x.by_gloss;
            (x.value, by)
        })
    }
}

/// One reading of a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateReading {
    /// Which of the lights; readings are in the order of their lights.
    pub light: usize,
    /// Whether the leaf was lit from below.
    pub below: bool,
    /// Whether it is a transmittance.
    pub through: bool,
    /// The share of light that was measured.
    pub value: f64,
    /// Its own standard error; NaN where none is known.
    pub err: f64,
}

/// Something known of a leaf beside its readings: Σ weight · number = target ± sigma.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateClue<const N: usize = FREE> {
    /// A weight for each number of the leaf.
    pub weights: [f64; N],
    /// What the sum is.
    pub target: f64,
    /// How sure that is.
    pub sigma: f64,
}

impl<const N: usize> PlateClue<N> {
    /// One number of the leaf is known.
    pub fn of(k: usize, target: f64, sigma: f64) -> PlateClue<N> {
        let mut weights = [0.0; N];
        weights[k] = 1.0;
        PlateClue { weights, target, sigma }
    }

    /// How far a leaf is off, in units of `sigma`.
    pub fn residual(&self, leaf: &[f64]) -> f64 {
        (self.weights.iter().zip(leaf).map(|(w, x)| w * x).sum::<f64>() - self.target) / self.sigma
    }
}

/// R and T of a leaf at one of the lights, lit from above and from below, with their derivatives by its `N` numbers.
pub type PlateSides<const N: usize> = [[(f64, [f64; N]); 2]; 2];

/// What was computed last: the solver asks for residuals and derivatives at the same numbers.
type Computed<const N: usize> = RefCell<(Vec<f64>, Vec<(f64, [f64; N])>)>;

/// What each reading would be of a leaf, with derivatives. Readings are in the order of their lights.
pub fn computed<const N: usize>(
    respond: &dyn Fn(usize, &[f64; N]) -> PlateSides<N>,
    readings: &[PlateReading],
    leaf: &[f64; N],
) -> Vec<(f64, [f64; N])> {
    let mut last: Option<(usize, PlateSides<N>)> = None;
    let of = |r: &PlateReading| {
        let sides = match last.filter(|l| l.0 == r.light) {
            Some((_, sides)) => sides,
            None => respond(r.light, leaf),
        };
        last = Some((r.light, sides));
        sides[usize::from(r.below)][usize::from(r.through)]
    };
    readings.iter().map(of).collect()
}

/// Descends from `start`. `sigma` is the weight of a reading: the same for all. `bounds` are the least and the most of
/// each number.
pub fn descend<const N: usize>(
    respond: &dyn Fn(usize, &[f64; N]) -> PlateSides<N>,
    readings: &[PlateReading],
    sigma: f64,
    clues: &[PlateClue<N>],
    bounds: [[f64; N]; 2],
    start: &[f64; N],
    iterations: usize,
) -> Fit {
    let m = readings.len() + clues.len();
    let last: Computed<N> = RefCell::default();
    let update = |params: &[f64]| {
        let mut last = last.borrow_mut();
        if last.0 != params {
            *last = (params.to_vec(), computed(respond, readings, &std::array::from_fn(|k| params[k])));
        }
    };
    let problem = ClosureProblem::new(N, m, |params: &[f64], out: &mut [f64]| {
        update(params);
        for ((r, value), out) in readings.iter().zip(&last.borrow().1).zip(out.iter_mut()) {
            *out = (value.0 - r.value) / sigma;
        }
        clues.iter().zip(&mut out[readings.len()..]).for_each(|(c, out)| *out = c.residual(params));
    })
    .with_jacobian(|params: &[f64], out: &mut [f64]| {
        update(params);
        for j in 0..N {
            for (value, out) in last.borrow().1.iter().zip(&mut out[j * m..]) {
                *out = value.1[j] / sigma;
            }
            for (k, c) in clues.iter().enumerate() {
                out[j * m + readings.len() + k] = c.weights[j] / c.sigma;
            }
        }
    });
    let options = Solver {
        lower: bounds[0].to_vec(),
        upper: bounds[1].to_vec(),
        max_iterations: iterations,
        gradient_tolerance: 1e-7,
        cost_tolerance: 1e-9,
        step_tolerance: 1e-8,
        noise: ResidualNoise::Known,
        ..Solver::default()
    };
    lm::minimize(&problem as &dyn Problem, start, &options)
}
