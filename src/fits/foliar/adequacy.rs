//! Whether the layered leaf describes what was measured, and whether its answer is that of a leaf.

use super::{FoliarFitModel, FoliarParameter, FoliarReading};
use crate::rivals::POSSIBLE;
use mesophyll_base::solvers::multi_start::MultiStart;
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

/// The value of the `k`-th parameter, in the solver's variables, in another minimum that the readings leave open and
/// that lies further away than the standard error `s`; and the odds of that minimum.
pub(super) fn rival(found: &MultiStart, k: usize, s: f64, stated: Stated) -> Option<(f64, f64)> {
    let (best, readings) = (&found.best, found.best.residuals.len() as f64);
    // Where no noise is stated, it is as large as what the best minimum leaves.
    let behind = |cost: f64| match stated {
        Stated::Errors => cost - best.cost,
        _ => 0.5 * readings * (cost / best.cost).ln(),
    };
    let others = found.minima.iter().map(|m| (m.params[k], (-behind(m.cost)).exp()));
    others.filter(|(_, odds)| *odds >= POSSIBLE).find(|(x, _)| (x - best.params[k]).abs() > s)
}

/// Says so where a parameter may lie at the edge of the searched range, within two standard errors. Where the parameter
/// may lie at both edges, nothing is said. `x` and its error `s` are in the solver's variables.
pub(super) fn bound(p: FoliarParameter, x: f64, s: f64) -> Option<String> {
    let (most, _) = p.range();
    let (low, high) = (x - 2.0 * s, x + 2.0 * s);
    match (low > 0.0, high < most) {
        (false, true) => Some(format!("{} <= {:.3}", p.column(), p.shown(high))),
        (true, false) => Some(format!("{} >= {:.3}", p.column(), p.shown(low))),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::solvers::multi_start::multi_start;
    use mesophyll_base::solvers::{ClosureProblem, Options};

    /// x² = 4 in two readings, of which a third says a little of the sign: minima near 2 and −2.
    fn two_minima(sign: f64) -> MultiStart {
        let problem = ClosureProblem::new(1, 3, move |p: &[f64], r: &mut [f64]| {
            r.copy_from_slice(&[20.0 * (p[0] * p[0] - 4.05), 20.0 * (p[0] * p[0] - 3.95), sign * (p[0] - 2.0)]);
        });
        multi_start(&problem, &[vec![3.0], vec![-3.0]], &Options::default()).unwrap()
    }

    #[test]
    fn a_minimum_that_is_twenty_times_less_likely_is_no_rival() {
        // The other minimum costs half of (4 sign)²; ln 20 is 3.0.
        for (sign, open) in [(0.0, true), (0.5, true), (0.7, false), (2.0, false)] {
            let found = two_minima(sign);
            let other = rival(&found, 0, 0.1, Stated::Errors);
            assert_eq!(other.is_some(), open, "{sign}: {:?}", found.minima);
            assert!(other.is_none_or(|(x, _)| (x + found.best.params[0]).abs() < 0.2), "{other:?}");
        }
        // One within the error of the best is the same answer.
        assert_eq!(rival(&two_minima(0.0), 0, 5.0, Stated::Errors), None);
        // Without a stated noise the residuals of the best minimum say how large it is.
        assert!(rival(&two_minima(0.0), 0, 0.1, Stated::Nothing).is_some());
        assert!(rival(&two_minima(20.0), 0, 0.1, Stated::Nothing).is_none());
    }
}
