//! The study as rows: bases on every case, light directions, and the number of azimuths in a slice of the horizon.

use super::{BasisCandidate, BasisJudge, PAPER_TISSUE, TEXEL_MM, candidates, cases};
use crate::bench::{BenchRow, median_us};
use crate::{Error, Result};
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_fits::translucency::spread::TranslucencySpread;
use mesophyll_optics::side::Side;
use mesophyll_optics::translucency::basis::{HemisphereBasis, Projector, SampleWeights};
use mesophyll_optics::translucency::horizon::{self, Horizon};
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance, project};
use mesophyll_optics::translucency::lights::{DirectionRule, DirectionSet, PAPER};

/// Steps of the bar that [`rows`] takes: one a case.
pub const PIECES: u64 = 8;

fn row(knob: String, setting: String, error: f64, us: f64, note: String) -> BenchRow {
    BenchRow { model: "translucency".into(), knob, setting, error, us, note }
}

/// Bases by bytes and multiply-adds on every case, light directions, and numbers of azimuths in a slice of the horizon.
///
/// # Errors
/// As [`cases`]; [`Error::Interrupted`].
pub fn rows(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    let mut rows = Vec::new();
    for case in cases(TEXEL_MM)? {
        let judge = BasisJudge::new(&case)?;
        for candidate in candidates() {
            progress::go_on()?;
            let outcome = judge.judge(candidate)?;
            let each = |f: &dyn Fn(&TranslucencySpread) -> f64| {
                outcome.spreads.iter().map(|s| format!("{:.4}", f(s))).collect::<Vec<_>>().join(" ")
            };
            let [operations, roots] = candidate.basis.operations();
            let note = format!(
                "mean |rec/full - 1|, time of projecting all directions of light and convolving; {} bytes, \
                 {operations} multiply-adds, {roots} roots; at pi/2, pi/4, pi/8: mean {}; median {}; 95 % {}; RMS over \
                 mean {}; left out as faint {}",
                candidate.basis.bytes(),
                each(&|s| s.mean),
                each(&|s| s.median),
                each(&|s| s.p95),
                each(&|s| s.visible),
                each(&|s| s.faint),
            );
            let us = median_us(1.0, || judge.coefficients(candidate).map(|i| i.len()));
            rows.push(row(format!("basis: {}", case.name), candidate.name(), outcome.mean(), us, note));
        }
        if case.side == Side::Back && case.tissue == PAPER_TISSUE {
            rows.extend(light_rows(&judge)?);
            rows.extend(horizon_rows(&judge)?);
        }
        bar.step()?;
    }
    Ok(rows)
}

/// Root mean square difference of two sets of images over the mean of the second.
pub(super) fn apart(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    let n = b.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let square: f64 = a.iter().flatten().zip(b.iter().flatten()).map(|(x, y)| (x - y).powi(2)).sum();
    (square / n).sqrt() / (b.iter().flatten().sum::<f64>() / n)
}

fn light_rows(judge: &BasisJudge) -> Result<Vec<BenchRow>> {
    let with = |lights: DirectionRule, weights: SampleWeights| BasisCandidate {
        basis: HemisphereBasis::HalfLife2,
        weights,
        lights,
    };
    let truth = judge.coefficients(with(DirectionRule::Product { levels: 32, azimuths: 64 }, SampleWeights::Gram))?;
    let mut rows = Vec::new();
    let leaf = judge.case.leaf();
    let mut add = |placed: &str, setting: String, rules: &[DirectionRule], weights: SampleWeights| -> Result<()> {
        progress::go_on()?;
        let mut square = 0.0;
        for rule in rules {
            square += apart(&judge.coefficients(with(*rule, weights))?, &truth).powi(2) / rules.len() as f64;
        }
        let projector =
            Projector::new(HemisphereBasis::HalfLife2, &DirectionSet::new(rules[0]), weights).map_err(Error::Usage)?;
        let us = median_us(5.0, || project(&judge.lit, &judge.horizon, &projector, Visibility::Hard));
        let note = format!(
            "RMS of the coefficients over their mean, against 2048 directions; {}; time of the projection",
            judge.case.name
        );
        rows.push(row(format!("light directions: {placed}, {leaf}"), setting, square.sqrt(), us, note));
        Ok(())
    };
    let seeds = |count: usize| -> Vec<DirectionRule> {
        (1..=4).map(|seed| DirectionRule::Stratified { count, seed }).collect()
    };
    let counts = [32, 64, PAPER, 256, 512];
    for count in counts {
        add("stratified", count.to_string(), &seeds(count), SampleWeights::Gram)?;
    }
    add("stratified, plain sums", PAPER.to_string(), &seeds(PAPER), SampleWeights::Plain)?;
    for count in counts {
        add("spiral", count.to_string(), &[DirectionRule::Spiral { count }], SampleWeights::Gram)?;
    }
    for (levels, azimuths) in [(4, 8), (4, 16), (8, 16), (4, 32), (8, 32), (16, 32)] {
        add(
            "product",
            format!("{levels}x{azimuths}"),
            &[DirectionRule::Product { levels, azimuths }],
            SampleWeights::Gram,
        )?;
    }
    Ok(rows)
}

/// The error that slices and their interpolation cause, compared with the horizon in the light's own azimuth, at the
/// lowest elevation.
fn horizon_rows(judge: &BasisJudge) -> Result<Vec<BenchRow>> {
    let lit = &judge.lit;
    let directions: Vec<[f64; 3]> = judge.truth[2].iter().map(|(d, _)| *d).collect();
    let exact: Vec<Vec<f64>> = directions
        .iter()
        .map(|d| {
            let sines = horizon::towards(lit, d[1].atan2(d[0]));
            let open = irradiance(lit, &judge.horizon, *d, Visibility::Off);
            open.iter().zip(&sines).map(|(e, s)| if d[2] > f64::from(*s) { *e } else { 0.0 }).collect()
        })
        .collect();
    let truth = judge.through(&exact);
    let mut rows = Vec::new();
    for (name, visibility) in [("hard", Visibility::Hard), ("soft .05", Visibility::Soft { width: 0.05 })] {
        for lines in [1, 2, 4, 8] {
            progress::go_on()?;
            let horizon = Horizon::sampled(lit, lines);
            let us = median_us(5.0, || Horizon::sampled(lit, lines));
            let entered: Vec<Vec<f64>> = directions.iter().map(|d| irradiance(lit, &horizon, *d, visibility)).collect();
            let error = apart(&judge.through(&entered), &truth);
            let note = format!(
                "RMS of what comes through at pi/8 over its mean, against the horizon in the light's azimuth; {}; time \
                 of the horizon map",
                judge.case.name
            );
            rows.push(row(
                format!("horizon, azimuths a slice: {name}, {}", judge.case.leaf()),
                lines.to_string(),
                error,
                us,
                note,
            ));
        }
    }
    Ok(rows)
}
