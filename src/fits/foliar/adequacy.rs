//! Whether the layered leaf describes what was measured, and whether its answer is that of a leaf.

use super::{FoliarFitModel, FoliarParameter, FoliarReading};
use mesophyll_base::solvers::{Adequacy, ReadingOrder, ResidualNoise, SolutionResiduals, judge};
use mesophyll_optics::side::Side;

/// What is said of the readings' noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stated {
    /// Readings have standard errors.
    Errors,
    /// Readings are exact.
    Exact,
    /// Nothing.
    Nothing,
}

/// Root mean square of residuals below which they are not judged where no noise is stated: the precision of the
/// surfaces (2e-5) and of cells with four digits.
const PRECISION: f64 = 1e-4;
/// What exact readings may be off by: cells often have three digits.
const ROUNDED: f64 = 1e-3;
/// Six readings a leaf in three bands leave .013 over the leaves of LOPEX93 and ANGERS (docs/evidence/foliar.md). A
/// leaf that leaves five times as much is none of this kind.
const NO_LEAF: f64 = 0.066;

/// Judges the residuals of a fit. They are divided by `sigma`; `jacobian` is that of the solver.
pub(super) fn of_fit(
    model: &FoliarFitModel,
    readings: &[FoliarReading],
    sigma: &[f64],
    residuals: &[f64],
    jacobian: &[f64],
    stated: Stated,
) -> Adequacy {
    // Reflectance and transmittance of each side are a spectrum of their own.
    let kinds = [(Side::Front, false), (Side::Front, true), (Side::Back, false), (Side::Back, true)];
    let run = |(side, through): (Side, bool)| {
        let of_kind = |k: &usize| model.lights[readings[*k].light].1 == side && readings[*k].through == through;
        let mut run: Vec<usize> = (0..readings.len()).filter(of_kind).collect();
        run.sort_by(|a, b| model.lights[readings[*a].light].0.total_cmp(&model.lights[readings[*b].light].0));
        run
    };
    let along = [ReadingOrder { name: "wavelength", runs: kinds.into_iter().map(run).collect() }];
    let scale = if stated == Stated::Exact { 1.0 / ROUNDED } else { 1.0 };
    let residuals: Vec<f64> = residuals.iter().map(|r| scale * r).collect();
    let smallest = sigma.iter().copied().fold(f64::INFINITY, f64::min);
    judge(&SolutionResiduals {
        residuals: &residuals,
        jacobian,
        noise: if stated == Stated::Nothing { ResidualNoise::Estimated } else { ResidualNoise::Known },
        floor: if stated == Stated::Nothing { PRECISION } else { PRECISION * scale / smallest },
        along: &along,
    })
}

/// Why the model does not describe the leaf, if so. `rms` is that of the residuals.
pub(super) fn why(judged: &Adequacy, readings: &[FoliarReading], model: &FoliarFitModel, rms: f64) -> Option<String> {
    let mut said = judged.why("leaf");
    if rms > NO_LEAF {
        let large = format!("an rms of {rms:.3} is left, where real leaves leave about .013");
        said = Some(said.map_or_else(
            || format!("the model does not describe this leaf: {large}"),
            |said| format!("{said}, and {large}"),
        ));
    }
    said.map(|said| match too_bright(readings, model) {
        Some((at, sum)) => format!("{said}; R and T at {at} nm add up to {sum:.3}, and no leaf gives back more than 1"),
        None => said,
    })
}

/// The wavelength at which reflectance and transmittance exceed 1 most, and their sum.
fn too_bright(readings: &[FoliarReading], model: &FoliarFitModel) -> Option<(f64, f64)> {
    let sums = readings.iter().filter(|r| !r.through).filter_map(|r| {
        let other = readings.iter().find(|t| t.through && t.light == r.light)?;
        // Four standard errors of the sum above 1 are no chance.
        let error = if r.err.is_finite() && other.err.is_finite() { r.err.hypot(other.err) } else { 0.0 };
        let least = 1.0 + 4.0 * error;
        Some((model.lights[r.light].0, r.value + other.value)).filter(|(_, sum)| *sum > least)
    });
    sums.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Why no leaf has this much of a parameter, if so.
pub(super) fn no_leaf_has(p: FoliarParameter, value: f64) -> Option<String> {
    let most = most(p);
    let beyond = value > most;
    beyond.then(|| format!("{} above {most}, which no leaf has: are R and T shares of 1, of one leaf?", p.column()))
}

/// The largest content that leaves have, with a margin: dark leaves have some 120 µg/cm² of chlorophyll and 30 of
/// carotenoids, thick and succulent ones .2 g/cm² of water, leathery ones .04 g/cm² of dry matter.
fn most(p: FoliarParameter) -> f64 {
    match p {
        FoliarParameter::Chlorophyll => 200.0,
        FoliarParameter::Carotenoid => 60.0,
        FoliarParameter::Protein => 8000.0,
        FoliarParameter::CelluloseLignin => 40_000.0,
        FoliarParameter::Water => 0.4,
        FoliarParameter::Oblateness | FoliarParameter::Thickness => f64::INFINITY,
    }
}

/// Says so where a parameter may lie at the edge of the searched range, within two standard errors. Where the parameter
/// may lie at both edges, nothing is said. `x` and its error `s` are in the solver's variables.
pub(super) fn bound(p: FoliarParameter, x: f64, s: f64) -> Option<String> {
    let (most, _) = p.range();
    let (low, high) = (x - 2.0 * s, x + 2.0 * s);
    let shown = |x: f64| if p == FoliarParameter::Oblateness { x.exp_m1() } else { x };
    match (low > 0.0, high < most) {
        (false, true) => Some(format!("{} <= {:.3}", p.column(), shown(high))),
        (true, false) => Some(format!("{} >= {:.3}", p.column(), shown(low))),
        _ => None,
    }
}
