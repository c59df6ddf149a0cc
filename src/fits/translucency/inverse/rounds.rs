//! Rounds of L-BFGS. Each begins with the Gauss–Newton matrix at the point where the last one ended, which gives the
//! coordinates, and with the sds that the model has there.

use super::certainty::{self, TissueCertainty};
use super::model::{TissueFitModel, logarithms};
use super::{Options, TissueCoefficients, TissueFit, TissueMeasurement, thickness};
use crate::record::ResidualStatistics;
use crate::translucency::{Error, Result};
use mesophyll_base::solvers::lbfgs::{self, DescentLimits, NormalEquations};
use mesophyll_base::solvers::{Termination, decomposition};
use mesophyll_files::progress;

/// A fit is done when the distance to the minimum, in standard errors, is below this; a round goes on to the second
/// number.
const DONE: f64 = 1e-2;
const ROUND: f64 = 1e-4;
/// Longest first step of a round in each logarithm.
const STEP: f64 = 1.0;

/// Fits σa and σs′ of every channel and the thickness scale (unless fixed) from `start`.
///
/// # Errors
/// [`Error::Missed`] where no reading counts, the photographs do not depend on the tissue, the model has no value at
/// the start, or the search does not converge. Then the reason is named and no numbers are given.
pub fn fit(measured: &TissueMeasurement, start: &TissueCoefficients, options: &Options) -> Result<TissueFit> {
    let channels = measured.channels.len();
    if channels == 0 || start.sigma_a.len() != channels || start.reduced.len() != channels {
        return Err(Error::Usage(format!(
            "a start for {} channels; expected {channels}, one or more",
            start.sigma_a.len()
        )));
    }
    let mut p = logarithms(start, options);
    if !p.iter().all(|v| v.is_finite()) {
        return Err(Error::Usage(format!("start {start:?}; expected coefficients and a scale above 0")));
    }
    let mut model = TissueFitModel::new(measured, options, start)?;
    if model.count <= p.len() {
        return Err(Error::Missed(format!("{} readings for {} unknowns: nothing was fitted", model.count, p.len())));
    }
    let mut out = TissueFit {
        tissues: start.clone(),
        certainty: TissueCertainty::default(),
        termination: Termination::IterationLimit,
        trace: Vec::new(),
        points: Vec::new(),
        evaluations: 0,
        residuals: Vec::new(),
        reduced_chi2: f64::NAN,
        expected_chi2: f64::NAN,
    };
    let (mut damping, mut elapsed, mut last) = (0.0, 0.0, None);
    let bar = progress::TaskProgress::of("rounds of the search");
    for round in 0..=options.rounds {
        progress::go_on()?;
        bar.advance(1);
        if round > 0 {
            // In the first round the sds are those of the readings, because the model may be far off.
            if !model.reaches(&model.tissues(&p)) {
                model = TissueFitModel::new(measured, options, &model.tissues(&p))?;
            }
            model.reweigh(&p)?;
        }
        let normal = model
            .normal(&p)
            .map_err(|e| Error::Missed(format!("no model of the photographs where the search is: {e}")))?;
        out.evaluations += 1;
        let size = normal.matrix.diagonal().max();
        if !(normal.cost.is_finite() && size.is_finite()) {
            return Err(Error::Missed(
                "the model has no value where the search is (not_finite); nothing was fitted".into(),
            ));
        }
        if size == 0.0 {
            return Err(Error::Missed("the photographs do not depend on the tissue (flat); nothing was fitted".into()));
        }
        let Some(eigen) = decomposition::symmetric_eigen(normal.matrix.clone()) else {
            return Err(Error::Missed(
                "the model's slopes are not finite where the search is (not_finite); nothing was fitted".into(),
            ));
        };
        let away = lbfgs::distance(&eigen, &normal.gradient);
        // A misfit beyond the noise makes the standard errors wider by the same factor.
        let misfit = (2.0 * normal.cost / (model.count - p.len()) as f64).sqrt();
        // For exact readings the weights stand for 1 % noise, and a thousandth of its errors is enough.
        let unit = misfit.max(if measured.noise.known { 1.0 } else { 1e-3 });
        if options.told {
            let left = 2.0 * normal.cost / (model.count - p.len()) as f64;
            progress::say(format!(
                "round {} of at most {}: {} evaluations, reduced chi2 {left:.3}",
                round + 1,
                options.rounds + 1,
                out.evaluations
            ));
        }
        if round > 1 && away < DONE * unit {
            out.termination = Termination::GradientSmall;
            last = Some(normal);
            break;
        }
        if round == options.rounds {
            last = Some(normal);
            break;
        }
        let limits = DescentLimits { gradient: ROUND * unit, iterations: 40 };
        let found = lbfgs::round(&model, &mut p, &normal, &eigen, &mut damping, STEP, limits);
        for (row, point) in found.trace.iter().zip(&found.points) {
            let mut row = *row;
            (row.iteration, row.evaluations) = (out.trace.len() + 1, row.evaluations + out.evaluations);
            row.elapsed_s += elapsed;
            out.trace.push(row);
            out.points.push(model.tissues(point));
        }
        elapsed = out.trace.last().map_or(elapsed, |r| r.elapsed_s);
        out.evaluations += found.evaluations;
        out.termination = found.termination;
    }
    if out.termination != Termination::GradientSmall {
        let names: Vec<&str> = measured.channels.iter().map(|c| c.name.as_str()).collect();
        let names = certainty::names(&names, options.fix_scale);
        let stuck: Vec<String> =
            names.into_iter().zip(model.at_limit(&p)).filter(|(_, at)| *at).map(|(n, _)| n).collect();
        let limits =
            if stuck.is_empty() { String::new() } else { format!(", at the limits of {}", stuck.join(" and ")) };
        let (name, count) = (out.termination.name(), out.evaluations);
        return Err(Error::Missed(format!(
            "the search ended as {name} after {count} evaluations{limits}; nothing was fitted"
        )));
    }
    let Some(normal) = last else { return Err(Error::Missed("no round was allowed; nothing was fitted".into())) };
    finish(&mut out, &model, &p, &normal, options)?;
    Ok(out)
}

fn finish(
    out: &mut TissueFit,
    model: &TissueFitModel,
    p: &[f64],
    normal: &NormalEquations,
    options: &Options,
) -> Result<()> {
    let measured = model.measured;
    let residuals = model.residuals(p)?;
    let freedom = (model.count - p.len()) as f64;
    out.reduced_chi2 = 2.0 * normal.cost / freedom;
    let spread = thickness::spread(model, p)?;
    let by_thickness = spread.chi2 / freedom;
    // The noise's part of a reading's variance. Where its level is not known, it is what the thickness does not
    // explain.
    let noise = if measured.noise.known { 1.0 } else { (out.reduced_chi2 - by_thickness).max(0.0) };
    out.expected_chi2 = noise + by_thickness;
    // Where χ² is larger than chance makes it, the model or the stated errors are wrong. All errors are then taken to
    // be too small by one factor.
    let chance = 1.0 + 4.0 * (2.0 / freedom).sqrt();
    let beyond = out.reduced_chi2 / out.expected_chi2;
    let factor = if measured.noise.known && beyond > chance { beyond } else { 1.0 };
    let misfit = (factor * noise).sqrt();
    let scatter = factor * &spread.scatter + &spread.shift * spread.shift.transpose();
    out.tissues = model.tissues(p);
    for (c, channel) in residuals.iter().enumerate() {
        let mut r = ResidualStatistics::default();
        let (mut squares, mut worst) = (0.0, vec![(0.0, 0usize); measured.thickness[0].len()]);
        for (i, image) in channel.iter().enumerate() {
            let inverse = &model.inverse_sd()[c][i];
            for (t, value) in image.iter().enumerate().filter(|(t, _)| inverse[*t] > 0.0) {
                r.samples += 1;
                r.chi2 += value * value;
                squares += (value / inverse[t]).powi(2);
                worst[t] = (worst[t].0 + value * value, worst[t].1 + 1);
            }
        }
        r.rms = (squares / r.samples.max(1) as f64).sqrt();
        r.reduced_chi2 = r.chi2 / (r.samples as f64 - 2.0).max(1.0);
        for (t, (sum, count)) in worst.iter().enumerate().filter(|(_, w)| w.1 > 0) {
            if sum / *count as f64 > r.worst {
                r.worst = sum / *count as f64;
                r.worst_at = [t % measured.width, t / measured.width];
            }
        }
        out.residuals.push(r);
    }
    let names: Vec<&str> = measured.channels.iter().map(|c| c.name.as_str()).collect();
    out.certainty = certainty::judge(
        &normal.matrix,
        misfit,
        &scatter,
        &certainty::names(&names, options.fix_scale),
        &model.at_limit(p),
    );
    Ok(())
}
