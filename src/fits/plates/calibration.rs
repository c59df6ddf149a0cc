//! How far coefficients are off: what they leave of leaves of species that were left out, in spectra and in contents.

use super::answer::{PlateAnswer, PlateFitModel, off_base, off_by};
use super::misfit::{self, PlateMisfit};
use super::spectral_step::{SpectralGuard, SpectralStep};
use super::training::{PlateExample, PlateRound, PlateTrained, PlateTraining, readings};
use super::{CONTENTS, FREE, PlateCoefficients, PlatePoint, PlatePopulation, REACH, SUBSTANCES, USUAL};
use mesophyll_base::statistics::median_of;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The coefficients of a part, the leaves that they were made from, and the leaves that were left out.
pub(super) type PlatePart<'a> = (Vec<PlatePoint>, PlatePopulation, Vec<&'a PlateExample>);

/// Standard errors of measured contents that count beside the model's, as shares: pigments are extracted.
const LABORATORY: [f64; 4] = [0.1, 0.1, 0.0, 0.0];
/// The share of leaves from which the model's error is taken. Of the records of a database a few are wrong, and the
/// worst tenth is left to them.
const HELD: f64 = 0.9;
/// Half the width of the interval that is to hold what was measured of that share, in standard errors: errors of a
/// model have longer tails than a normal distribution, and where they fall exponentially, an interval that holds 95 %
/// at 1.96 holds 90 % at this.
const WIDTH: f64 = 1.507;
/// A mean over species is more than chance where it is this many standard errors off.
const CHANCE: f64 = 2.0;
/// A leaf that leaves this many times the usual, or whose content is this many standard errors off, is suspect.
const SUSPECT: [f64; 2] = [4.0, 4.0];
/// A spread that only five parts tell is itself uncertain: Student's distribution of four degrees of freedom has 95 %
/// within 2.776 and not 1.96 standard errors.
const FEW_PARTS: f64 = 2.776 / 1.96;
/// A constant is not carried where its standard error is more than half of it.
const CARRIED: f64 = 0.5;
/// Constants below this share of the largest are not judged: there is nothing to carry.
const JUDGED: f64 = 0.05;
/// Noise of readings in a table of training; it says nothing of it, and the misfit holds it.
const NOISE: f64 = 1e-3;
/// Before anything is known of the misfit, it is taken to be this large and this far correlated (nm).
const FIRST: [f64; 2] = [0.01, 150.0];

fn coefficients(
    table: &PlateTraining,
    points: &[PlatePoint],
    population: PlatePopulation,
    misfit: &PlateMisfit,
) -> PlateCoefficients {
    PlateCoefficients {
        wavelengths: table.wavelengths.clone(),
        points: points.to_vec(),
        errors: vec![[0.0; FREE]; points.len()],
        population,
        misfit: misfit.clone(),
    }
}

type PlateJudged<'a> = (&'a PlateExample, PlateAnswer, Vec<[f64; 2]>);

/// Fits the leaves that each part left out.
fn unseen<'a>(table: &PlateTraining, parts: &[PlatePart<'a>], misfit: &PlateMisfit, rms: f64) -> Vec<PlateJudged<'a>> {
    let of = |(points, population, left): &PlatePart<'a>| {
        let population = PlatePopulation { rms, ..*population };
        let all = coefficients(table, points, population, misfit);
        let model = PlateFitModel::new(&all, &table.wavelengths, NOISE);
        let fit = |example: &&'a PlateExample| {
            let answer = model.found(&readings(example))?;
            let residuals = model.residuals(&answer.leaf, &example.spectra);
            Some((*example, answer, residuals))
        };
        left.par_iter().filter_map(fit).collect::<Vec<_>>()
    };
    parts.iter().flat_map(of).collect()
}

/// The share of a content that the model is off by beside the errors of its fits, so that intervals hold what was
/// measured in [`HELD`] of the leaves.
fn off(k: usize, judged: &[PlateJudged], population: &PlatePopulation) -> f64 {
    let needed = |(example, answer, _): &PlateJudged| {
        let (measured, found) = (example.measured[k], answer.contents[k]);
        let known = answer.errors[k].powi(2) + (LABORATORY[k] * measured).powi(2);
        let missing = ((found - measured) / WIDTH).powi(2) - known;
        missing.max(0.0) / off_base(k, found, population).powi(2)
    };
    let mut needed: Vec<f64> = judged.iter().filter(|j| !j.0.measured[k].is_nan()).map(needed).collect();
    needed.sort_by(f64::total_cmp);
    // One leaf more than are there: the next one.
    let place = ((HELD * (needed.len() + 1) as f64).ceil() as usize).clamp(1, needed.len().max(1));
    needed.get(place - 1).copied().unwrap_or(0.0).sqrt()
}

/// Standard errors of the constants: how they change where species are left out (the jackknife), but at least those of
/// each wavelength alone; and how they change where next to nothing is assumed of them, because what smoothness and the
/// pull towards a usual index make of a constant shows nowhere else.
fn scatter(whole: &[PlatePoint], loose: &[PlatePoint], alone: &[[f64; FREE]], parts: &[PlatePart]) -> Vec<[f64; FREE]> {
    let n = parts.len() as f64;
    let at = |w: usize| {
        let of = |j: usize| {
            let mean = parts.iter().map(|p| p.0[w].all()[j]).sum::<f64>() / n;
            let squares: f64 = parts.iter().map(|p| (p.0[w].all()[j] - mean).powi(2)).sum();
            let left_out = FEW_PARTS * (squares * (n - 1.0) / n).sqrt();
            left_out.max(alone[w][j]).hypot(whole[w].all()[j] - loose[w].all()[j])
        };
        std::array::from_fn(of)
    };
    (0..whole.len()).map(at).collect()
}

/// Where the data do not carry a specific absorption, in sentences.
fn uncarried(table: &PlateTraining, points: &[PlatePoint], errors: &[[f64; FREE]]) -> Vec<String> {
    let mut said = Vec::new();
    for (j, name) in SUBSTANCES.iter().enumerate() {
        let within = |w: &usize| (REACH[j][0]..=REACH[j][1]).contains(&table.wavelengths[*w]);
        let places: Vec<usize> = (0..points.len()).filter(within).collect();
        if places.is_empty() {
            said.push(format!("{name}: no wavelength of the table is one at which it absorbs"));
            continue;
        }
        let most = places.iter().map(|w| points[*w].specific[j]).fold(0.0, f64::max);
        let lost = |w: &usize| {
            let value = points[*w].specific[j];
            value > JUDGED * most && errors[*w][j] > CARRIED * value
        };
        let mut spans: Vec<[f64; 2]> = Vec::new();
        for (k, w) in places.iter().enumerate().filter(|(_, w)| lost(w)) {
            let nm = table.wavelengths[*w];
            let before = k.checked_sub(1).map(|b| table.wavelengths[places[b]]);
            match spans.last_mut().filter(|s| Some(s[1]) == before) {
                Some(span) => span[1] = nm,
                None => spans.push([nm, nm]),
            }
        }
        if !spans.is_empty() {
            let words = |[a, b]: &[f64; 2]| if a == b { format!("{a}") } else { format!("{a} to {b}") };
            let spans: Vec<String> = spans.iter().map(words).collect();
            said.push(format!("{name}: the leaves do not carry its absorption at {} nm", spans.join(", ")));
        }
    }
    said
}

/// Leaves that stand out although their species was left out.
fn suspects(judged: &[PlateJudged], population: &PlatePopulation) -> Vec<String> {
    let why = |(example, answer, _): &PlateJudged| {
        if answer.rms > SUSPECT[0] * population.rms {
            let (rms, usual) = (answer.rms, population.rms);
            return Some(format!(
                "{}: an rms of {rms:.4} is left, where half of the leaves leave {usual:.4}",
                example.name
            ));
        }
        let far = (0..4).find(|&k| {
            let (measured, found) = (example.measured[k], answer.contents[k]);
            let error = off_by(population.off[k], k, found, population).hypot(answer.errors[k]);
            (found - measured).abs() > SUSPECT[1] * error.hypot(LABORATORY[k] * measured)
        })?;
        let (measured, found) = (example.measured[far], answer.contents[far]);
        Some(format!("{}: measured_{} is {measured}, its spectra say {found:.4}", example.name, CONTENTS[far]))
    };
    judged.iter().filter_map(why).collect()
}

/// A content may be off in the same direction in all species, because readings and contents pull at the coefficients
/// together. Returns what it is to be multiplied by: the mean over species of measured by found, in unseen leaves,
/// where that differs from 1 by more than chance.
fn unit(k: usize, judged: &[PlateJudged], population: &PlatePopulation) -> f64 {
    let mut species: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for (example, answer, _) in judged {
        let (measured, found) = (example.measured[k], answer.contents[k]);
        if measured > 0.0 && found > 0.1 * population.mean[k] * USUAL[k] {
            species.entry(example.species).or_default().push((measured / found).ln());
        }
    }
    let count = species.len() as f64;
    let means: Vec<f64> = species.values().map(|v| v.iter().sum::<f64>() / v.len() as f64).collect();
    let mean = means.iter().sum::<f64>() / count;
    let error = (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (count * (count - 1.0))).sqrt();
    if mean.abs() > CHANCE * error { mean.exp() } else { 1.0 }
}

/// Counts a content in another unit: leaves have `factor` times as much of it, and it absorbs less by that.
fn count_in(k: usize, factor: f64, points: &mut [PlatePoint], population: &mut PlatePopulation) {
    points.iter_mut().for_each(|p| p.specific[k] /= factor);
    population.mean[k] *= factor;
    population.spread[k] *= factor;
}

/// Puts together what training came to.
pub(super) fn judged(
    table: &PlateTraining,
    mut whole: PlateRound,
    mut loose: PlateRound,
    mut population: PlatePopulation,
    mut parts: Vec<PlatePart>,
) -> PlateTrained {
    let count = table.wavelengths.len();
    let first = PlateMisfit { modes: Vec::new(), short: vec![[FIRST[0]; 2]; count], reach: FIRST[1] };
    let before = unseen(table, &parts, &first, FIRST[0]);
    let examples: Vec<&PlateExample> = table.examples.iter().collect();
    let step = SpectralStep {
        wavelengths: &table.wavelengths,
        examples: &examples,
        numbers: &whole.numbers,
        guard: SpectralGuard::FULL,
    };
    let mut alone = step.errors(&whole.points);
    for k in 0..4 {
        let factor = unit(k, &before, &population);
        count_in(k, factor, &mut whole.points, &mut population);
        loose.points.iter_mut().for_each(|p| p.specific[k] /= factor);
        alone.iter_mut().for_each(|e| e[k] /= factor);
        parts.iter_mut().for_each(|(points, population, _)| count_in(k, factor, points, population));
    }
    let left: Vec<Vec<[f64; 2]>> = before.into_iter().map(|(_, _, left)| left).collect();
    let misfit = misfit::estimate(&table.wavelengths, &left);
    population.rms = median_of(left.iter().map(|l| misfit::rms(l))).unwrap_or(FIRST[0]);
    let judged = unseen(table, &parts, &misfit, population.rms);
    population.rms = median_of(judged.iter().map(|j| j.1.rms)).unwrap_or(population.rms);
    population.off = std::array::from_fn(|k| off(k, &judged, &population));
    let suspects = suspects(&judged, &population);
    let mut all = coefficients(table, &whole.points, population, &misfit);
    all.errors = scatter(&whole.points, &loose.points, &alone, &parts);
    let uncarried = uncarried(table, &all.points, &all.errors);
    PlateTrained { coefficients: all, suspects, uncarried }
}

/// How well unseen leaves were described and their contents found, for the one who trains. Where the table had no
/// species, `without_species` says so.
pub fn words(coefficients: &PlateCoefficients, without_species: bool) -> String {
    let PlatePopulation { rms, off, counts: [leaves, species], .. } = coefficients.population;
    let off: Vec<String> = SUBSTANCES[..4].iter().zip(off).map(|(n, x)| format!("{n} {:.0} %", 100.0 * x)).collect();
    let of =
        if without_species { ", each taken for a species of its own".into() } else { format!(" of {species} species") };
    format!(
        "{leaves} leaves{of}; of a leaf whose species was left out an rms of {rms:.4} is left \
         (median), and contents are off by {} beside the errors of each fit",
        off.join(", ")
    )
}
