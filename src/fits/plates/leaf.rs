//! One leaf: its seven numbers from its readings, where the coefficients are known.

use super::{FREE, GLOSS, LOWER, PLATES, PlatePoint, UPPER};
use mesophyll_base::solvers::{ClosureProblem, Fit, Options as Solver, Problem, ResidualNoise, lm};
use mesophyll_optics::plates::PlateIndex;
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

    /// R and T of a leaf with derivatives.
    pub fn response(&self, leaf: &[f64; FREE]) -> PlateResponse {
        let (depth, crossings) = self.state(leaf);
        self.index.response(depth, crossings, leaf[GLOSS]).map(|x| {
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
    /// Whether it is a transmittance.
    pub through: bool,
    /// The share of light that was measured.
    pub value: f64,
    /// Its own standard error; NaN where none is known.
    pub err: f64,
}

/// Something known of a leaf beside its readings: Σ weight · number = target ± sigma.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateClue {
    /// A weight for each number of the leaf.
    pub weights: [f64; FREE],
    /// What the sum is.
    pub target: f64,
    /// How sure that is.
    pub sigma: f64,
}

impl PlateClue {
    /// One number of the leaf is known.
    pub fn of(k: usize, target: f64, sigma: f64) -> PlateClue {
        let mut weights = [0.0; FREE];
        weights[k] = 1.0;
        PlateClue { weights, target, sigma }
    }

    /// How far a leaf is off, in units of `sigma`.
    pub fn residual(&self, leaf: &[f64]) -> f64 {
        (self.weights.iter().zip(leaf).map(|(w, x)| w * x).sum::<f64>() - self.target) / self.sigma
    }
}

/// What was computed last: the solver asks for residuals and derivatives at the same numbers.
type Computed = RefCell<(Vec<f64>, Vec<PlateResponse>)>;

/// Descends from `start`. `sigma` is the weight of a reading: the same for all.
pub fn descend(
    lights: &[PlateLight],
    readings: &[PlateReading],
    sigma: f64,
    clues: &[PlateClue],
    start: &[f64; FREE],
    iterations: usize,
) -> Fit {
    let m = readings.len() + clues.len();
    let last: Computed = RefCell::default();
    let update = |params: &[f64]| {
        let mut last = last.borrow_mut();
        if last.0 != params {
            let leaf: [f64; FREE] = std::array::from_fn(|k| params[k]);
            let mut values: Vec<PlateResponse> = Vec::with_capacity(readings.len());
            for (k, r) in readings.iter().enumerate() {
                let again = k > 0 && readings[k - 1].light == r.light;
                values.push(if again { values[k - 1] } else { lights[r.light].response(&leaf) });
            }
            *last = (params.to_vec(), values);
        }
    };
    let problem = ClosureProblem::new(FREE, m, |params: &[f64], out: &mut [f64]| {
        update(params);
        let values = &last.borrow().1;
        for (k, r) in readings.iter().enumerate() {
            out[k] = (values[k][usize::from(r.through)].0 - r.value) / sigma;
        }
        clues.iter().zip(&mut out[readings.len()..]).for_each(|(c, out)| *out = c.residual(params));
    })
    .with_jacobian(|params: &[f64], out: &mut [f64]| {
        update(params);
        let values = &last.borrow().1;
        for j in 0..FREE {
            for (k, r) in readings.iter().enumerate() {
                out[j * m + k] = values[k][usize::from(r.through)].1[j] / sigma;
            }
            for (k, c) in clues.iter().enumerate() {
                out[j * m + readings.len() + k] = c.weights[j] / c.sigma;
            }
        }
    });
    let options = Solver {
        lower: LOWER.to_vec(),
        upper: UPPER.to_vec(),
        max_iterations: iterations,
        gradient_tolerance: 1e-7,
        cost_tolerance: 1e-9,
        step_tolerance: 1e-8,
        noise: ResidualNoise::Known,
        ..Solver::default()
    };
    lm::minimize(&problem as &dyn Problem, start, &options)
}
