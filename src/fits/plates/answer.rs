//! The contents of a leaf, with errors that hold what the model is off by.

use super::leaf::{PlateClue, PlateLight, PlateReading, PlateSides, computed, descend};
use super::misfit::{LeafMisfit, PlateMisfit};
use super::training::companion;
use super::{CONTENTS, FREE, GLOSS, GLOSS_BELOW, LEAN, LOWER, MOST_LEAN, PlateCoefficients, PlatePopulation};
use super::{SIDED, UPPER, USUAL};
use mesophyll_files::table::{OutputRow, Status};
use nalgebra::DMatrix;

/// What a leaf is taken to be where its readings say nothing: like those of the table of training, within this many of
/// their standard deviations.
const WIDE: f64 = 3.0;
/// Steps of a descent.
const STEPS: usize = 80;
/// A descent that leaves more than this many times the usual is tried from other starts.
const POOR: f64 = 2.0;
/// How much of the contents the other starts have.
const OTHERS: [f64; 2] = [0.25, 2.0];
/// A leaf that leaves this many times what unseen leaves leave is none of their kind.
const NO_LEAF: f64 = 5.0;
/// Half the width of a 95 % interval, in standard errors.
const NINETY_FIVE: f64 = 1.96;
/// The model's error is a share of the content, or of this part of the usual one where there is little.
const LITTLE: f64 = 0.2;

/// A leaf's lean is taken to be within this of none (one standard deviation).
const LEANING: f64 = 0.5;

/// How leaves are fitted: everything that they share.
pub struct PlateFitModel {
    wavelengths: Vec<f64>,
    lights: Vec<PlateLight>,
    misfit: PlateMisfit,
    population: PlatePopulation,
    noise: f64,
}

/// What was found in a leaf.
pub(super) struct PlateAnswer {
    /// The free numbers.
    pub leaf: [f64; FREE],
    /// The [`CONTENTS`].
    pub contents: [f64; 4],
    /// Their standard errors, without what the model is off by in contents.
    pub errors: [f64; 4],
    /// Root mean square of measured less computed.
    pub rms: f64,
    /// What was computed for each reading.
    pub computed: Vec<f64>,
}

/// What is known of any leaf, where descents begin, and the least and the most of each number.
struct PlateSearch<const N: usize> {
    clues: Vec<PlateClue<N>>,
    start: [f64; N],
    bounds: [[f64; N]; 2],
}

/// The numbers of a leaf followed by those of its lower side.
fn sided(leaf: &[f64; FREE], below: [f64; 2]) -> [f64; SIDED] {
    std::array::from_fn(|k| if k < FREE { leaf[k] } else { below[k - FREE] })
}

/// What the model is off by in a content, for the share `off`.
pub(super) fn off_by(off: f64, k: usize, content: f64, population: &PlatePopulation) -> f64 {
    off * off_base(k, content, population)
}

/// What a share is of.
pub(super) fn off_base(k: usize, content: f64, population: &PlatePopulation) -> f64 {
    content.hypot(LITTLE * population.mean[k] * USUAL[k])
}

impl PlateFitModel {
    /// For readings at `wavelengths` (nm, ascending, within the range of the coefficients). `noise`: standard error of
    /// readings that have none of their own.
    pub fn new(coefficients: &PlateCoefficients, wavelengths: &[f64], noise: f64) -> PlateFitModel {
        let of = |values: &[[f64; 2]]| {
            let at = |w: &f64| {
                let (k, t) = coefficients.place(*w);
                let (a, b) = (values[k], values[(k + 1).min(values.len() - 1)]);
                [0, 1].map(|i| a[i] + t * (b[i] - a[i]))
            };
            wavelengths.iter().map(at).collect::<Vec<_>>()
        };
        PlateFitModel {
            wavelengths: wavelengths.to_vec(),
            lights: wavelengths.iter().map(|w| PlateLight::new(coefficients.at(*w))).collect(),
            misfit: PlateMisfit {
                modes: coefficients.misfit.modes.iter().map(|m| of(m)).collect(),
                short: of(&coefficients.misfit.short),
                reach: coefficients.misfit.reach,
            },
            population: coefficients.population,
            noise,
        }
    }

    /// Columns of [`PlateFitModel::fit`]'s answer.
    pub fn outputs() -> Vec<String> {
        let names = || CONTENTS.iter().map(|c| c.to_string());
        names().chain(names().map(|n| n + "_err")).chain(["rms".to_string()]).collect()
    }

    /// A leaf lit from above.
    fn search(&self) -> PlateSearch<FREE> {
        let wide = |k: usize| PlateClue::of(k, self.population.mean[k], WIDE * self.population.spread[k]);
        let clues = (0..FREE).map(wide).chain([companion(self.population.ratio)]).collect();
        PlateSearch { clues, start: self.population.mean, bounds: [LOWER, UPPER] }
    }

    /// A leaf lit from both sides.
    fn sided_search(&self) -> PlateSearch<SIDED> {
        let PlateSearch { clues, start, bounds: [lower, upper] } = self.search();
        let PlatePopulation { mean, spread, .. } = &self.population;
        let wider = |c: PlateClue| PlateClue { weights: sided(&c.weights, [0.0; 2]), target: c.target, sigma: c.sigma };
        let below = PlateClue::of(GLOSS_BELOW, mean[GLOSS], WIDE * spread[GLOSS]);
        let lean = PlateClue::of(LEAN, 0.0, LEANING);
        PlateSearch {
            clues: clues.into_iter().map(wider).chain([below, lean]).collect(),
            start: sided(&start, [mean[GLOSS], 0.0]),
            bounds: [sided(&lower, [lower[GLOSS], -MOST_LEAN]), sided(&upper, [upper[GLOSS], MOST_LEAN])],
        }
    }

    fn leaf_misfit<'a>(&'a self, readings: &'a [PlateReading]) -> LeafMisfit<'a> {
        LeafMisfit { wavelengths: &self.wavelengths, misfit: &self.misfit, readings, noise: self.noise }
    }

    /// Fits one leaf; `None` where nothing was found.
    pub(super) fn found(&self, readings: &[PlateReading]) -> Option<PlateAnswer> {
        if readings.iter().any(|r| r.below) {
            let respond = |light: usize, leaf: &[f64; SIDED]| self.lights[light].both(leaf);
            return self.best(readings, &respond, &self.sided_search());
        }
        let respond = |light: usize, leaf: &[f64; FREE]| [self.lights[light].response(leaf); 2];
        self.best(readings, &respond, &self.search())
    }

    fn best<const N: usize>(
        &self,
        readings: &[PlateReading],
        respond: &dyn Fn(usize, &[f64; N]) -> PlateSides<N>,
        search: &PlateSearch<N>,
    ) -> Option<PlateAnswer> {
        let local = self.leaf_misfit(readings);
        let weight = local.weight();
        let PlateSearch { clues, start, bounds } = search;
        let from = |start: &[f64; N]| {
            let fit = descend(respond, readings, weight, clues, *bounds, start, STEPS);
            let sound = fit.params.iter().all(|x| x.is_finite());
            sound.then(|| (fit.cost, std::array::from_fn::<f64, N, _>(|k| fit.params[k])))
        };
        let left = |leaf: &[f64; N]| {
            let values = computed(respond, readings, leaf);
            let square = |(v, r): (&(f64, [f64; N]), &PlateReading)| (v.0 - r.value).powi(2);
            (values.iter().zip(readings).map(square).sum::<f64>() / readings.len() as f64).sqrt()
        };
        let mut best = from(start);
        if best.is_none_or(|b| left(&b.1) > POOR * self.population.rms) {
            for share in OTHERS {
                let mut start = *start;
                start[..4].iter_mut().for_each(|c| *c *= share);
                let other = from(&start);
                if other.is_some_and(|o| best.is_none_or(|b| o.0 < b.0)) {
                    best = other;
                }
            }
        }
        let (_, leaf) = best?;
        let rms = left(&leaf);
        let (values, jacobian): (Vec<f64>, Vec<[f64; N]>) = computed(respond, readings, &leaf).into_iter().unzip();
        let mut known = DMatrix::zeros(N, N);
        for c in clues {
            for i in 0..N {
                for j in 0..N {
                    known[(i, j)] += c.weights[i] * c.weights[j] / (c.sigma * c.sigma);
                }
            }
        }
        let mut hessian = known.clone();
        for by in &jacobian {
            for i in 0..N {
                for j in 0..N {
                    hessian[(i, j)] += by[i] * by[j] / (weight * weight);
                }
            }
        }
        // A leaf that the model describes worse than usual is off by more in everything.
        let scale = (rms * rms / local.mean_square().max(f64::MIN_POSITIVE)).max(1.0);
        let between = known + local.between(&jacobian, scale) / weight.powi(4);
        let inverse = hessian.cholesky()?.inverse();
        let covariance = &inverse * between * &inverse;
        Some(PlateAnswer {
            leaf: std::array::from_fn(|k| leaf[k]),
            contents: std::array::from_fn(|k| leaf[k] * USUAL[k]),
            errors: std::array::from_fn(|k| covariance[(k, k)].max(0.0).sqrt() * USUAL[k]),
            rms,
            computed: values,
        })
    }

    /// What is left of each reading.
    pub(super) fn residuals(&self, leaf: &[f64; FREE], spectra: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let of = |(light, measured): (&PlateLight, &[f64; 2])| {
            let values = light.values(leaf);
            [0, 1].map(|k| measured[k] - values[k])
        };
        self.lights.iter().zip(spectra).map(of).collect()
    }

    /// Fits one leaf and says what was found as the row of a batch. Readings are in the order of their lights, and of
    /// a leaf lit from below also some from above.
    pub fn fit(&self, readings: &[PlateReading]) -> OutputRow {
        self.fit_with_spectra(readings).0
    }

    /// The same, with what was computed for each reading; nothing where there is no answer.
    pub fn fit_with_spectra(&self, readings: &[PlateReading]) -> (OutputRow, Vec<f64>) {
        if readings.is_empty() {
            return (OutputRow::refused("no reading"), Vec::new());
        }
        match self.found(readings) {
            Some(found) => (self.row(&found), found.computed),
            None => (OutputRow::refused("the fit did not converge"), Vec::new()),
        }
    }

    fn row(&self, found: &PlateAnswer) -> OutputRow {
        let errors: [f64; 4] = std::array::from_fn(|k| {
            let off = off_by(self.population.off[k], k, found.contents[k], &self.population);
            found.errors[k].hypot(off)
        });
        let values = found.contents.into_iter().chain(errors).chain([found.rms]).collect();
        if found.rms > NO_LEAF * self.population.rms {
            let why = format!(
                "the model does not describe this leaf: an rms of {:.3} is left, where leaves of species that the \
                 coefficients had not seen leave about {:.4}",
                found.rms, self.population.rms
            );
            return OutputRow { values, status: Status::undetermined(CONTENTS, &why) };
        }
        let open =
            |k: &usize| NINETY_FIVE * errors[*k] > found.contents[*k] || found.leaf[*k] >= UPPER[*k] * (1.0 - 1e-9);
        let status = Status::undetermined((0..4).filter(open).map(|k| CONTENTS[k]), "");
        OutputRow { values, status }
    }
}
