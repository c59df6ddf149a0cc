//! What the record says of a fit: numbers with errors, and how well they explain the pictures.

use crate::covariance::names;
use crate::photographs::{PixelUse, ScenePhotograph};
use crate::quantity::UNKNOWN;
use crate::steps::{ReadingComparison, SceneFit, WILD};
use crate::unknowns::SceneUnknowns;
use mesophyll_base::solvers::adequacy::chi2_score;
use mesophyll_fits::record::fault::{FaultGrade, MeasurementFault};
use mesophyll_fits::record::{FitParameter, FitRecord, RecordSection, ResidualStatistics};
use std::collections::BTreeMap;

/// Pixels along the side of a block. A wrong model leaves residuals that neighbours share; noise does not.
const BLOCK: usize = 8;
/// χ² that lies this many standard deviations too high accuses the model.
const SCORE: f64 = 3.3;
/// A reduced χ² below this is no reason, however many readings there are: of what was fitted, and of what was held
/// back, which the errors of the numbers spread too.
const EXCESS: f64 = 1.05;
const EXCESS_UNSEEN: f64 = 2.0;

/// χ² of readings and of the means of blocks, and how many degrees of freedom each has.
#[derive(Debug, Clone, Copy, Default)]
struct Judged {
    chi2: f64,
    readings: usize,
    blocks_chi2: f64,
    blocks: usize,
}

impl Judged {
    fn of<'a>(shots: &[ScenePhotograph], compared: impl Iterator<Item = &'a ReadingComparison>) -> Judged {
        let mut out = Judged::default();
        let mut blocks: BTreeMap<[usize; 4], (f64, f64)> = BTreeMap::new();
        for c in compared {
            let [shot, k, channel] = c.at;
            let width = shots[shot].size[0];
            let block = blocks.entry([shot, k % width / BLOCK, k / width / BLOCK, channel]).or_default();
            // A single path's light can be far from normal; it does not accuse the model alone.
            let residual = c.residual.clamp(-WILD, WILD);
            *block = (block.0 + residual, block.1 + 1.0);
            out.chi2 += residual * residual;
            out.readings += 1;
        }
        // The sum of n residuals of noise has the variance n.
        for (sum, n) in blocks.values() {
            out.blocks_chi2 += sum * sum / n;
            out.blocks += 1;
        }
        out
    }

    /// The same where a share of all variances is of a kind that readings have in common: the sum of n residuals has
    /// the variance n + n (n − 1) times the share.
    fn shared(self, share: f64) -> Judged {
        let each = self.readings as f64 / self.blocks.max(1) as f64;
        Judged { blocks_chi2: self.blocks_chi2 / (1.0 + (each - 1.0).max(0.0) * share), ..self }
    }

    /// By what standard errors are to be widened, where that is above 1, and whether the model is to be doubted. Only
    /// the share `alone` of the readings counts as independent.
    fn excess(&self, numbers: usize, least: f64, alone: f64) -> (f64, bool) {
        let of = |chi2: f64, count: usize| {
            let freedom = count.saturating_sub(numbers).max(1) as f64;
            (chi2 / freedom, chi2_score(alone * chi2, alone * freedom))
        };
        let all = [of(self.chi2, self.readings), of(self.blocks_chi2, self.blocks)];
        let worst = all.iter().map(|a| a.0).fold(1.0, f64::max);
        (worst, all.iter().any(|(reduced, score)| *score > SCORE && *reduced > least))
    }
}

/// The section of a record: all numbers, and the verdicts.
pub fn section(
    numbers: &SceneUnknowns,
    shots: &[ScenePhotograph],
    found: &SceneFit,
    record: &mut FitRecord,
) -> RecordSection {
    let names = names(numbers);
    let values = numbers.values();
    let quantities = numbers.list.iter().flat_map(|q| q.at.iter().map(move |_| q));
    let fitted = Judged::of(shots, found.compared.iter().filter(|c| c.of == PixelUse::Fitted)).shared(found.scatter);
    let determined = found.undetermined.iter().filter(|why| why.is_none()).count();
    // A whole picture is not predicted where anything is undetermined that it might show.
    let predicted =
        |c: &&ReadingComparison| determined == names.len() || shots[c.at[0]].uses.contains(&PixelUse::Fitted);
    let held = Judged::of(shots, found.compared.iter().filter(|c| c.of == PixelUse::Held).filter(predicted))
        .shared(found.scatter);
    // All channels of a place share their paths. Where the share f of each residual's variance is of that kind, the
    // variance of χ² is 1 + (n − 1) f² times that of n independent channels. Which discs stand is the same for all
    // readings.
    let share = found.own_noise.powi(2) / (1.0 + found.own_noise.powi(2));
    let alone = |of: &Judged| {
        let common = of.readings.saturating_sub(1) as f64 * found.scatter.powi(2);
        1.0 / (1.0 + (numbers.channels.len() - 1) as f64 * share * share + common)
    };
    let (excess, doubted) = fitted.excess(determined, EXCESS, alone(&fitted));
    let (unseen, missed) = held.excess(0, EXCESS_UNSEEN, alone(&held));
    // Where no number is determined, nothing is claimed that could be wrong.
    let (doubted, missed) = (doubted && determined > 0, missed && determined > 0);
    let wide = if doubted { excess.sqrt() } else { 1.0 };
    if doubted || missed {
        let worst = if doubted { excess } else { unseen };
        record.faults.push(MeasurementFault {
            name: "scene-model".into(),
            grade: FaultGrade::Wrong,
            says: format!(
                "the scene does not explain the pictures: what is left of them is {:.1} times what noise leaves (means \
                 of {BLOCK} x {BLOCK} pixels, or of {BLOCK} directions); geometry, a camera, a light or something that \
                 no unknown covers is not as stated, and the residual pictures show where",
                worst.sqrt()
            ),
            ..MeasurementFault::default()
        });
    }
    for (name, (quantity, at)) in names.iter().zip(quantities.clone().zip(&values)) {
        if let Some(ended) = quantity.ended(*at) {
            record.faults.push(MeasurementFault {
                name: "scene-model".into(),
                grade: FaultGrade::Wrong,
                says: format!("{name}: {ended}, without which the other numbers are not those of the pictures"),
                ..MeasurementFault::default()
            });
        }
    }
    // Without more, an error is beyond its limit only by what the draws of discs add.
    let due = match wide > 1.0 {
        true => "what the scene does not explain could be due to it",
        false => "which discs stand changes the pictures as much as it does",
    };
    let mut section = RecordSection::default();
    for (k, (name, quantity)) in names.iter().zip(quantities).enumerate() {
        let error = found.covariance[(k, k)].sqrt() * wide;
        let why = found.undetermined[k].clone().or_else(|| quantity.open(values[k], error, due));
        let why = why.map(|why| format!("{name}: {why}"));
        // What is only known as small has an error.
        let bounded = error <= UNKNOWN * quantity.unit(values[k]);
        let error = if bounded { error } else { f64::INFINITY };
        section.params.insert(
            name.clone(),
            FitParameter {
                value: vec![values[k]],
                stderr: vec![error],
                undetermined: why.into_iter().collect(),
                ..FitParameter::default()
            },
        );
    }
    let known: Vec<usize> = (0..names.len()).filter(|k| found.undetermined[*k].is_none()).collect();
    section.correlation_names = known.iter().map(|k| names[*k].clone()).collect();
    let c = &found.covariance;
    section.correlation = known
        .iter()
        .map(|i| known.iter().map(|j| (c[(*i, *j)] / (c[(*i, *i)] * c[(*j, *j)]).sqrt()).clamp(-1.0, 1.0)).collect())
        .collect();
    section.rank = Some(known.len());
    let residuals = |judged: Judged, numbers: usize, of: PixelUse| {
        let freedom = judged.readings.saturating_sub(numbers).max(1) as f64;
        let mine: Vec<&ReadingComparison> = found.compared.iter().filter(|c| c.of == of).filter(predicted).collect();
        let square: f64 = mine.iter().map(|c| (c.residual * c.error).powi(2)).sum();
        let worst = mine.iter().max_by(|a, b| a.residual.abs().total_cmp(&b.residual.abs()));
        let at = worst.map_or([0, 0], |c| [c.at[1] % shots[c.at[0]].size[0], c.at[1] / shots[c.at[0]].size[0]]);
        ResidualStatistics {
            samples: judged.readings,
            chi2: judged.chi2,
            reduced_chi2: judged.chi2 / freedom,
            rms: (square / mine.len().max(1) as f64).sqrt(),
            worst: worst.map_or(0.0, |c| c.residual * c.residual),
            worst_at: at,
        }
    };
    section.residuals.insert("pictures".into(), residuals(fitted, determined, PixelUse::Fitted));
    if held.readings > 0 {
        section.residuals.insert("held_out_pixels".into(), residuals(held, 0, PixelUse::Held));
    }
    for (name, value) in [
        ("own_noise_over_measured", found.own_noise),
        ("blocks_reduced_chi2", fitted.blocks_chi2 / fitted.blocks.max(1) as f64),
        ("held_out_blocks_reduced_chi2", held.blocks_chi2 / held.blocks.max(1) as f64),
        ("errors_widened_by", wide),
    ] {
        section.figures.insert(name.into(), value);
    }
    section.figures.extend(found.areas.iter().cloned());
    section.counts.insert("wild_pixels".into(), found.wild);
    section.counts.insert("saturated_pixels".into(), shots.iter().map(|s| s.saturated).sum());
    section
}
