//! Coefficients from leaves with measured contents: the numbers of the leaves and the constants of the wavelengths in
//! turn, each by least squares, until both fit.

use super::calibration;
use super::joint_step::JointStep;
use super::leaf::{PlateClue, PlateLight, PlateReading, descend};
use super::spectral_step::{SpectralGuard, SpectralStep, usual_index};
use super::{CONTENTS, FREE, LOWER, PLATES, PlateCoefficients, PlatePoint, PlatePopulation, REACH, UPPER, USUAL};
use mesophyll_base::solvers::Fit;
use mesophyll_files::progress;
use rayon::prelude::*;

/// Leaves and species that a table needs at least, and leaves in which each content was measured.
pub const FEWEST_LEAVES: usize = 10;
/// See [`FEWEST_LEAVES`].
pub const FEWEST_SPECIES: usize = 5;
/// Wavelengths that a table needs at least.
pub const FEWEST_WAVELENGTHS: usize = super::table::ROWS;
/// How many parts the species are dealt to, each left out once.
pub const PARTS: usize = 5;

/// Weight of a reading beside the measured contents: what the model leaves of a spectrum is correlated over hundreds of
/// readings, so each alone says little.
const WEIGHT: f64 = 0.03;
/// Standard errors of measured contents, as shares: those of a laboratory.
const MEASURED: [f64; 4] = [0.1, 0.1, 0.03, 0.15];
/// The same for a content that is small beside the usual one.
const SMALL: f64 = 0.3;
/// Turns of leaves and wavelengths, and steps within each.
const TURNS: usize = 8;
const STEPS: usize = 3;
/// Steps of both together after the turns, until one lowers the cost by less than this share.
const JOINT: usize = 30;
const SETTLED: f64 = 1e-4;
/// In the first turns the leaves keep their measured contents.
const HELD: usize = 4;

/// A leaf with what was measured of it.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateExample {
    /// Its name.
    pub name: String,
    /// Which of the species it belongs to.
    pub species: usize,
    /// R and T at each wavelength; NaN where missing.
    pub spectra: Vec<[f64; 2]>,
    /// The [`CONTENTS`]; NaN where not measured.
    pub measured: [f64; 4],
}

/// A table of leaves.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlateTraining {
    /// Wavelengths (nm), ascending.
    pub wavelengths: Vec<f64>,
    /// The leaves.
    pub examples: Vec<PlateExample>,
    /// Names of the species; of the leaves where the table states none.
    pub species: Vec<String>,
    /// Whether the table states no species, so that each leaf counts as one.
    pub without_species: bool,
}

impl PlateTraining {
    /// The part in which a species is left out. Where none are stated, neighbours are left out together: the leaves of
    /// a plant usually stand together in a table, and must not vouch for one another.
    fn part(&self, species: usize) -> usize {
        if self.without_species { species * PARTS / self.species.len().max(1) } else { species % PARTS }
    }
}

/// What training came to.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateTrained {
    /// The coefficients.
    pub coefficients: PlateCoefficients,
    /// Leaves that stand out although their species was left out: names and why.
    pub suspects: Vec<String>,
    /// Where the data do not carry a constant, in sentences.
    pub uncarried: Vec<String>,
}

/// What is assumed of constants counts this much less, to see what it makes of them.
const LOOSE: SpectralGuard = SpectralGuard { smooth: 0.01, pull: 0.01 };

/// Points and the numbers of the leaves that they came with.
#[derive(Clone)]
pub(super) struct PlateRound {
    pub points: Vec<PlatePoint>,
    pub numbers: Vec<[f64; FREE]>,
}

/// A first guess: bands where the substances are known to have them.
fn guess(wavelength: f64) -> PlatePoint {
    let band = |at: f64, width: f64| (-0.5 * ((wavelength - at) / width).powi(2)).exp();
    let specific = [
        2.75 * (band(435.0, 30.0) + 0.8 * band(675.0, 14.0) + 0.35 * band(640.0, 30.0) + 0.2 * band(600.0, 45.0)),
        0.96 * (band(465.0, 28.0) + 0.6 * band(420.0, 30.0)),
        0.3 * band(1450.0, 45.0)
            + 1.2 * band(1940.0, 40.0)
            + 0.2 * band(2030.0, 80.0)
            + 0.012 * band(1200.0, 40.0)
            + 0.06 * band(1780.0, 100.0)
            + 0.8 * band(2550.0, 130.0)
            + if wavelength > 1400.0 { 0.08 } else { 0.0 },
        0.015
            + 0.15 * band(2100.0, 80.0)
            + 0.2 * band(2320.0, 80.0)
            + 0.1 * band(1700.0, 100.0)
            + 0.2 * band(2500.0, 80.0),
        0.5 * (-(wavelength - 400.0) / 150.0).exp(),
    ];
    let allowed = |j: usize| (REACH[j][0]..=REACH[j][1]).contains(&wavelength);
    let specific = std::array::from_fn(|j| if allowed(j) { specific[j] } else { 0.0 });
    PlatePoint { specific, index: usual_index(wavelength), growth: 1.0 }
}

/// The leaf from which descents begin where nothing is known.
pub(super) const START: [f64; FREE] = [1.0, 1.0, 1.0, 1.0, 0.1, 0.6, 1.0];

/// The readings of a leaf, without those that are missing.
pub fn readings(example: &PlateExample) -> Vec<PlateReading> {
    let of = |(light, pair): (usize, &[f64; 2])| {
        let of = |k: usize| PlateReading { light, below: false, through: k == 1, value: pair[k], err: f64::NAN };
        [of(0), of(1)]
    };
    example.spectra.iter().enumerate().flat_map(of).filter(|r| !r.value.is_nan()).collect()
}

/// Carotenoid per chlorophyll among leaves in which both were measured, and the standard deviation from that.
fn ratio(examples: &[&PlateExample]) -> [f64; 2] {
    let pairs: Vec<[f64; 2]> =
        examples.iter().map(|e| [e.measured[0], e.measured[1]]).filter(|p| p.iter().all(|x| !x.is_nan())).collect();
    let squares: f64 = pairs.iter().map(|p| p[0] * p[0]).sum();
    let ratio = pairs.iter().map(|p| p[0] * p[1]).sum::<f64>() / squares.max(f64::MIN_POSITIVE);
    let spread = pairs.iter().map(|p| (p[1] - ratio * p[0]).powi(2)).sum::<f64>() / (pairs.len().max(1) as f64);
    [ratio, spread.sqrt().max(0.02 * USUAL[1])]
}

/// That carotenoid follows chlorophyll, as a clue.
pub(super) fn companion([ratio, spread]: [f64; 2]) -> PlateClue {
    let mut weights = [0.0; FREE];
    weights[0] = -ratio * USUAL[0];
    weights[1] = USUAL[1];
    PlateClue { weights, target: 0.0, sigma: spread }
}

/// What was measured of a leaf, as clues; `held` where the leaf is to keep it.
fn clues(example: &PlateExample, typical: &[f64; 4], ratio: [f64; 2], held: bool) -> Vec<PlateClue> {
    let known = |k: &usize| !example.measured[*k].is_nan();
    let of = |k: usize| {
        let (value, usual) = (example.measured[k], USUAL[k]);
        let sigma = MEASURED[k] * value.max(SMALL * typical[k]) / usual;
        PlateClue::of(k, value / usual, if held { 0.2 * sigma } else { sigma })
    };
    (0..4).filter(known).map(of).chain([companion(ratio)]).collect()
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(s, n), x| (s + x, n + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Leaves that are fitted together with the constants.
struct PlateTable<'a> {
    wavelengths: &'a [f64],
    examples: &'a [&'a PlateExample],
    readings: Vec<Vec<PlateReading>>,
    ratio: [f64; 2],
    typical: [f64; 4],
}

impl<'a> PlateTable<'a> {
    fn new(wavelengths: &'a [f64], examples: &'a [&'a PlateExample]) -> PlateTable<'a> {
        let typical = std::array::from_fn(|k| {
            mean(examples.iter().map(|e| e.measured[k]).filter(|x| !x.is_nan())).unwrap_or(USUAL[k])
        });
        let readings = examples.iter().map(|e| readings(e)).collect();
        PlateTable { wavelengths, examples, readings, ratio: ratio(examples), typical }
    }

    /// Where fits begin.
    fn first(&self) -> PlateRound {
        let first = |e: &&PlateExample| {
            let mut leaf = START;
            for k in 0..4 {
                leaf[k] = if e.measured[k].is_nan() { self.typical[k] } else { e.measured[k] } / USUAL[k];
            }
            leaf
        };
        PlateRound {
            points: self.wavelengths.iter().map(|w| guess(*w)).collect(),
            numbers: self.examples.iter().map(first).collect(),
        }
    }

    fn spectral<'b>(&'b self, numbers: &'b [[f64; FREE]], guard: SpectralGuard) -> SpectralStep<'b> {
        SpectralStep { wavelengths: self.wavelengths, examples: self.examples, numbers, guard }
    }

    /// Each leaf, and then all wavelengths.
    fn turn(&self, round: &mut PlateRound, held: bool, damping: &mut f64) {
        let lights: Vec<PlateLight> = round.points.iter().map(|p| PlateLight::new(*p)).collect();
        round.numbers = (0..self.examples.len())
            .into_par_iter()
            .map(|k| {
                let clues = clues(self.examples[k], &self.typical, self.ratio, held);
                let respond = |light: usize, leaf: &[f64; FREE]| [lights[light].response(leaf); 2];
                let (readings, start) = (&self.readings[k], &round.numbers[k]);
                let fit: Fit = descend(&respond, readings, WEIGHT, &clues, [LOWER, UPPER], start, STEPS);
                let sound = fit.params.iter().all(|x| x.is_finite());
                if sound { std::array::from_fn(|j| fit.params[j]) } else { round.numbers[k] }
            })
            .collect();
        settle(self.wavelengths, round);
        let step = self.spectral(&round.numbers, SpectralGuard::FULL);
        let mut cost = step.cost(&round.points);
        for _ in 0..STEPS {
            cost = step.step(&mut round.points, cost, damping);
        }
        *damping = damping.min(1.0);
    }

    /// Leaves and wavelengths together, until nothing moves.
    fn together(&self, round: &mut PlateRound, guard: SpectralGuard) -> crate::Result<()> {
        let clues: Vec<Vec<PlateClue>> =
            self.examples.iter().map(|e| clues(e, &self.typical, self.ratio, false)).collect();
        let mut damping = 1e-3;
        for _ in 0..JOINT {
            may_go_on()?;
            let spectral = self.spectral(&round.numbers, guard);
            let joint = JointStep { spectral, clues: &clues, weight: WEIGHT };
            let before = joint.cost(&round.points);
            let Some((numbers, points, after)) = joint.step(&round.points, before, &mut damping) else {
                if damping >= 1e4 {
                    break;
                }
                continue;
            };
            *round = PlateRound { points, numbers };
            settle(self.wavelengths, round);
            if after > (1.0 - SETTLED) * before {
                break;
            }
        }
        Ok(())
    }
}

fn may_go_on() -> crate::Result<()> {
    if progress::stop_requested() {
        return Err(crate::Error::Interrupted("interrupted; no coefficients were written".into()));
    }
    Ok(())
}

/// Fits leaves and wavelengths: in turn, which finds the way from afar, and then together.
///
/// # Errors
/// Where the program was asked to stop.
fn both(table: &PlateTable) -> crate::Result<PlateRound> {
    let mut round = table.first();
    let mut damping = 1e-2;
    for turn in 0..TURNS {
        may_go_on()?;
        table.turn(&mut round, turn < HELD, &mut damping);
    }
    table.together(&mut round, SpectralGuard::FULL)?;
    Ok(round)
}

/// Brown pigments and plates have no unit of their own: the mean leaf has 1 of the former, and plates count 1 on
/// average where nothing absorbs.
fn settle(wavelengths: &[f64], round: &mut PlateRound) {
    let PlateRound { points, numbers } = round;
    let brown = mean(numbers.iter().map(|leaf| leaf[4])).unwrap_or(1.0);
    if brown > 1e-6 {
        numbers.iter_mut().for_each(|leaf| leaf[4] /= brown);
        points.iter_mut().for_each(|p| p.specific[4] *= brown);
    }
    let clear = |(w, _): &(&f64, &PlatePoint)| (780.0..1300.0).contains(*w);
    let growth = mean(wavelengths.iter().zip(points.iter()).filter(clear).map(|(_, p)| p.growth)).unwrap_or(1.0);
    numbers.iter_mut().for_each(|leaf| leaf[PLATES] *= growth);
    points.iter_mut().for_each(|p| p.growth /= growth);
}

/// What the leaves are like.
fn population(round: &PlateRound, examples: &[&PlateExample], species: usize) -> PlatePopulation {
    let of = |k: usize| mean(round.numbers.iter().map(|leaf| leaf[k])).unwrap_or(START[k]);
    let middle: [f64; FREE] = std::array::from_fn(of);
    let spread = std::array::from_fn(|k| {
        let variance = mean(round.numbers.iter().map(|leaf| (leaf[k] - middle[k]).powi(2))).unwrap_or(0.0);
        variance.sqrt().max(0.05 * middle[k]).max(1e-3)
    });
    PlatePopulation {
        mean: middle,
        spread,
        ratio: ratio(examples),
        off: [0.0; 4],
        rms: 0.0,
        counts: [examples.len(), species],
    }
}

/// Makes coefficients of a table of leaves. Each species is left out once, to learn what the model is off by in leaves
/// that it has not seen.
///
/// # Errors
/// A sentence for a table with too few leaves, species, wavelengths or measured contents; a stop.
pub fn train(table: &PlateTraining) -> crate::Result<PlateTrained> {
    let examples: Vec<&PlateExample> = table.examples.iter().collect();
    let leave = |part: usize| {
        let (kept, left): (Vec<&PlateExample>, Vec<&PlateExample>) =
            examples.iter().partition(|e| table.part(e.species) != part);
        let round = both(&PlateTable::new(&table.wavelengths, &kept))?;
        let population = population(&round, &kept, table.species.len());
        Ok((round.points, population, left))
    };
    let parts = (0..PARTS).map(leave).collect::<crate::Result<Vec<_>>>()?;
    let leaves = PlateTable::new(&table.wavelengths, &examples);
    let whole = both(&leaves)?;
    let mut loose = whole.clone();
    leaves.together(&mut loose, LOOSE)?;
    let population = population(&whole, &examples, table.species.len());
    Ok(calibration::judged(table, whole, loose, population, parts))
}

/// Why a table cannot be trained on, if so.
pub fn refusal(table: &PlateTraining) -> Option<String> {
    let (leaves, species) = (table.examples.len(), table.species.len());
    if leaves < FEWEST_LEAVES {
        return Some(format!("it has {leaves} leaves that can be used, expected at least {FEWEST_LEAVES}"));
    }
    if species < FEWEST_SPECIES && !table.without_species {
        return Some(format!(
            "it has leaves of {species} species, expected at least {FEWEST_SPECIES}, because each is left out once to \
             learn how far the model is off"
        ));
    }
    if table.wavelengths.len() < FEWEST_WAVELENGTHS {
        let found = table.wavelengths.len();
        return Some(format!("it has {found} wavelengths, expected at least {FEWEST_WAVELENGTHS}"));
    }
    CONTENTS.iter().enumerate().find_map(|(k, name)| {
        let known = table.examples.iter().filter(|e| !e.measured[k].is_nan()).count();
        (known < FEWEST_LEAVES)
            .then(|| format!("measured_{name} is stated for {known} leaves, expected at least {FEWEST_LEAVES} of them"))
    })
}
