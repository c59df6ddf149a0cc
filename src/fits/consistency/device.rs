//! The errors of ρd, ρs, m and the normal of a scan under a tube, against what the device's geometry and noise give,
//! and the reduced χ² of the texels against that of the side.

use super::{CAUSE, CLOSE, FACTOR, Seen, Setup, figure, sample};
use crate::leaf::held_out::{FramePredictor, PredictionScratch, known_errors, texel_of};
use crate::record::scan::{HeldOutResiduals, ScanRecord};
use mesophyll_base::statistics::median_of;
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::tube::Travel;

/// How many texels are computed afresh.
const SAMPLE: usize = 120;
/// The mean of the reduced χ² of texels counts all alike, and the side's counts readings. The two differ by the
/// covariance of χ² and the number of readings, which is at most the product of their scatter: that of χ² times this,
/// the largest relative scatter of the readings of a texel, where many are lost at a part of the leaf.
const UNEVEN: f64 = 0.5;

pub(super) fn look(seen: &Seen, out: &mut Vec<String>) {
    if !matches!(seen.setup, Setup::Tube { .. } | Setup::Paper) {
        return;
    }
    chi2(seen, out);
    least(seen, out);
    afresh(seen, out);
}

/// The map of reduced χ² against the residuals of `fit.toml`.
fn chi2(seen: &Seen, out: &mut Vec<String>) {
    let (Some(plane), Some(told)) = (seen.maps.scalar(Quantity::ReducedChi2), seen.section.residuals.get("gloss"))
    else {
        return;
    };
    let list = || seen.good.iter().map(|&k| (k, f64::from(plane[k]))).filter(|(_, v)| v.is_finite());
    let count = list().count();
    let Some((at, most)) = list().max_by(|a, b| a.1.total_cmp(&b.1)) else { return };
    let place = told.worst_at[1].saturating_mul(seen.maps.width).saturating_add(told.worst_at[0]);
    if (most - told.worst).abs() > 1e-6 * told.worst || plane.get(place).is_none_or(|v| f64::from(*v) != most) {
        out.push(format!(
            "{}: the largest reduced_chi2.Y is {} at texel {}, but residuals.gloss in fit.toml says {} at ({}, {}); \
             {CAUSE}",
            seen.path.display(),
            figure(most),
            seen.at(at),
            figure(told.worst),
            told.worst_at[0],
            told.worst_at[1]
        ));
    }
    let mean = list().map(|(_, v)| v).sum::<f64>() / count as f64;
    let scatter = (list().map(|(_, v)| (v - mean).powi(2)).sum::<f64>() / count as f64).sqrt();
    if !((mean - told.reduced_chi2).abs() <= UNEVEN * scatter + CLOSE * mean) {
        out.push(format!(
            "{}: the mean of reduced_chi2.Y over the good texels is {}, but residuals.gloss.reduced_chi2 in fit.toml \
             is {}; {CAUSE}",
            seen.path.display(),
            figure(mean),
            figure(told.reduced_chi2)
        ));
    }
}

/// No fit knows a reflectance better than as many readings of it, each with the relative noise r and without any other
/// unknown: the error of ρ is at least r·ρ/√readings, because no reading is larger than its own light.
fn least(seen: &Seen, out: &mut Vec<String>) {
    let (Some(scan), Some(errors)) = (&seen.record.scan, &seen.errors) else { return };
    let Some(readings) = seen.section.residuals.get("gloss").map(|r| r.samples as f64) else { return };
    // Readings of a channel; each texel has at most nine parameters more than degrees of freedom.
    let each = readings / seen.good.len() as f64 / 3.0 + 3.0;
    for quantity in [Quantity::RhoD, Quantity::RhoS] {
        for (c, letter) in RGB.into_iter().enumerate() {
            let (Some(value), Some(error)) = (seen.maps.plane(quantity, c), errors.plane(quantity, c)) else {
                continue;
            };
            let ratio = middle(seen.good.iter().map(|&k| f64::from(error[k]) / f64::from(value[k])));
            let bound = scan.noise_relative / each.sqrt();
            if ratio < bound * 0.9 {
                out.push(format!(
                    "{}: the error of {}.{letter} is {} of its value in the median, but {each:.0} readings with a \
                     relative noise of {} know it to {} at best; {CAUSE}",
                    seen.errors_path.display(),
                    quantity.name(),
                    figure(ratio),
                    figure(scan.noise_relative),
                    figure(bound)
                ));
            }
        }
    }
}

/// The errors that the device's geometry and noise give for some texels.
fn afresh(seen: &Seen, out: &mut Vec<String>) {
    let (Some(scan), Some(errors), Some(texel)) = (&seen.record.scan, &seen.errors, texel_of(seen.maps)) else {
        return;
    };
    let told = seen.record.options.get("held_out").map_or("", String::as_str);
    let passes = seen.record.options.get("passes").map_or(0, |p| p.split_whitespace().count());
    let kept = |travel: Travel| {
        let held = seen.section.held_out.get(travel.name())?;
        Some(FramePredictor::new(scan, travel, &positions(held, frames(told, travel)?)?))
    };
    let found: Vec<FramePredictor> = [Travel::X, Travel::Y].into_iter().filter_map(kept).collect();
    // A pass that kept all of its frames does not say where they were.
    if found.len() != passes || found.is_empty() {
        return;
    }
    let mut scratch = PredictionScratch::default();
    // Of each quantity, the stated error over the computed one.
    let quantities = [(Quantity::RhoD, 0), (Quantity::RhoS, 3), (Quantity::M, 6), (Quantity::Normal, 7)];
    let mut ratios = [const { Vec::new() }; 4];
    for k in sample(&seen.good, SAMPLE) {
        let Some(texel) = texel(k) else { continue };
        let Some(known) = known_errors(scan, &found, &mut scratch, &texel, place(seen, scan, k)) else { continue };
        for (ratios, (quantity, first)) in ratios.iter_mut().zip(quantities) {
            for c in 0..quantity.letters().len() {
                let Some(error) = errors.plane(quantity, c) else { continue };
                let expected = match quantity {
                    Quantity::Normal => known.normal[c],
                    _ => known.parameters[first + c],
                };
                let ratio = f64::from(error[k]) / expected;
                if expected > 0.0 && ratio.is_finite() {
                    ratios.push(ratio);
                }
            }
        }
    }
    for (ratios, (quantity, _)) in ratios.into_iter().zip(quantities) {
        if ratios.len() < SAMPLE / 4 {
            continue;
        }
        let ratio = middle(ratios.into_iter());
        // The fit widens errors where gloss is faint, where two minima rival, and by the tilt that one pass does not
        // show; it never makes them smaller.
        if ratio < 1.0 / FACTOR {
            out.push(format!(
                "{}: the errors of {} are {} times those that the tube, the frames' positions and the noise in \
                 fit.toml give, in the median over {SAMPLE} texels; {CAUSE}",
                seen.errors_path.display(),
                quantity.name(),
                figure(ratio)
            ));
        }
    }
}

/// Where a texel is (mm).
fn place(seen: &Seen, scan: &ScanRecord, k: usize) -> [f64; 2] {
    let (w, h) = (seen.maps.width, seen.maps.height);
    [(k % w) as f64 - (0.5 * w as f64 - 0.5), (0.5 * h as f64 - 0.5) - (k / w) as f64].map(|v| v * scan.texel_mm)
}

/// How many frames a pass had: `pass x: 3 of 60 (11 20 50)`.
fn frames(told: &str, travel: Travel) -> Option<usize> {
    let (_, rest) = told.split_once(&format!("pass {}: ", travel.name()))?;
    let mut words = rest.split_whitespace();
    (words.nth(1)? == "of").then(|| words.next()?.trim_end_matches(';').parse().ok()).flatten()
}

/// Positions of the frames that the fit saw, where those of three others show that all are evenly spaced.
fn positions(held: &HeldOutResiduals, frames: usize) -> Option<Vec<f64>> {
    let all: Vec<(f64, f64)> = held.frames.iter().map(|f| *f as f64).zip(held.positions_mm.iter().copied()).collect();
    let (&[first, _, ..], &[.., last]) = (all.as_slice(), all.as_slice()) else { return None };
    let step = (last.1 - first.1) / (last.0 - first.0);
    let at = |k: f64| first.1 + (k - first.0) * step;
    let even = all.len() >= 3 && all.iter().all(|(k, mm)| (at(*k) - mm).abs() <= 1e-6 * step.abs());
    (even && step != 0.0).then(|| (0..frames).filter(|k| !held.frames.contains(k)).map(|k| at(k as f64)).collect())
}

/// The median without NaN; NaN of nothing.
fn middle(of: impl Iterator<Item = f64>) -> f64 {
    median_of(of.filter(|v| !v.is_nan())).unwrap_or(f64::NAN)
}
