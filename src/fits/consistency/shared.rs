//! The standard errors of the leaf's σa and σs, against those of its texels and against the other side.

use super::{CAUSE, FACTOR, Seen, Setup, figure, sample};
use crate::leaf::curve::Incidence;
use crate::leaf::indeterminacy;
use crate::leaf::leaf_wide::{self, LeafWideSettings, LeafWideTexel};
use crate::leaf::sides::{APART, APART_IN_ERRORS, SECTION};
use crate::record::fault::FaultGrade;
use crate::record::{FitRecord, RECORD, RecordSection};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::quantity::{Quantity, RGB};
use std::path::Path;

/// The leaf-wide problem is solved again on this many texels.
const TEXELS: usize = 4_000;
/// Of more stand-ins than this share of the texels, the fit's errors are noticeably larger.
const STAND_INS: f64 = 0.05;

/// Solves the leaf-wide problem again, from the maps, and compares σa, σs and their errors with those of `fit.toml`.
pub(super) fn look(seen: &Seen, out: &mut Vec<String>) {
    // Where a fault of the measurement spoils σ, it is undetermined, and texels' errors hold more than noise.
    if seen.record.faults.iter().any(|f| f.grade == FaultGrade::Wrong) {
        return;
    }
    let straight = matches!(seen.setup, Setup::Tube { straight: true });
    if !straight || !seen.settled() || !(0..3).all(|c| seen.as_told(c)) || seen.good.len() < 100 {
        return;
    }
    let one_pass = seen.record.missing_pass().is_some();
    let robust = seen.record.options.get("robust").is_none_or(|r| r != "false");
    if one_pass || seen.figure("stand_ins").unwrap_or(0.0) > STAND_INS * seen.good.len() as f64 {
        return;
    }
    let (Some(told), Some(relative), Some(h)) =
        (seen.three(Quantity::SigmaA).zip(seen.three(Quantity::SigmaS)), seen.relative_noise(), seen.thickness())
    else {
        return;
    };
    let Some(texels) = texels(seen, relative) else { return };
    let start = told.0.zip(told.1, |a, s| [a, s]);
    let common = indeterminacy::common(&texels, 0.0);
    let solve = |common| {
        let incidence = Incidence(1.0);
        leaf_wide::fit(&texels, &[], start, &LeafWideSettings { h, incidence, relative, robust, iterations: 8, common })
    };
    // The noise of single texels averages out over all of them; what they have in common does not.
    let (with, alone) = (solve(common), solve(leaf_wide::LeafSharedErrors::default()));
    if !with.termination.converged() || !alone.termination.converged() {
        return;
    }
    let share = texels.len() as f64 / seen.good.len() as f64;
    for (q, quantity) in [Quantity::SigmaA, Quantity::SigmaS].into_iter().enumerate() {
        let Some(param) = seen.param(quantity) else { continue };
        for (c, letter) in RGB.into_iter().enumerate() {
            let at = (2 * c + q, 2 * c + q);
            let noise = alone.covariance[at] * share + (with.covariance[at] - alone.covariance[at]).max(0.0);
            let caliper = param.stderr_caliper.get(c).map_or(0.0, |e| e / param.value[c]);
            let expected = (noise + caliper * caliper + gauge(seen.record, quantity, c)).sqrt() * param.value[c];
            let found = param.stderr[c];
            if !(found >= expected / FACTOR && found <= expected * FACTOR) && expected.is_finite() {
                out.push(format!(
                    "{}: the standard error of {}.{letter} is {} 1/mm in fit.toml, but the errors of the texels' rho_d \
                     and rho_t give {}; {CAUSE}",
                    seen.path.with_file_name(RECORD).display(),
                    quantity.name(),
                    figure(found),
                    figure(expected)
                ));
            }
        }
    }
}

/// The readings of the good texels, or of evenly spread ones.
fn texels(seen: &Seen, relative: f64) -> Option<Vec<LeafWideTexel>> {
    let errors = seen.errors.as_ref()?;
    let three = |maps: &mesophyll_files::image::ChannelMaps, q, k: usize| {
        maps.three(q).map(|p| Rgb(p).map(|c| f64::from(c[k])))
    };
    sample(&seen.good, TEXELS)
        .map(|k| {
            let (rho_t, e) = (three(seen.maps, Quantity::RhoT, k)?, three(errors, Quantity::RhoT, k)?);
            let floor = |c: usize| (e[c].powi(2) - (relative * rho_t[c]).powi(2)).max(1e-18).sqrt();
            Some(LeafWideTexel {
                rho_d: three(seen.maps, Quantity::RhoD, k)?,
                rho_d_err: three(errors, Quantity::RhoD, k)?,
                rho_t,
                rho_t_floor: Rgb::of(floor),
                covariance: Rgb::default(),
            })
        })
        .collect()
}

/// The variance of ln σ that the difference of both sides adds to each (`leaf::sides`).
fn gauge(record: &FitRecord, quantity: Quantity, c: usize) -> f64 {
    let Some(apart) = Apart::of(record.sections.get(SECTION), quantity, c) else { return 0.0 };
    (0.5 * (apart.log * apart.log - apart.variance)).max(0.0)
}

/// How far both sides are apart: ln(front/back), and the variance that noise gives it.
struct Apart {
    log: f64,
    variance: f64,
}

impl Apart {
    fn of(section: Option<&RecordSection>, quantity: Quantity, c: usize) -> Option<Apart> {
        let figure = |of: &str| section?.figures.get(&format!("{of}.{}", quantity.channel(c))).copied();
        let (log, errors) = (figure(APART)?, figure(APART_IN_ERRORS)?);
        Some(Apart { log, variance: (log / errors).powi(2) }).filter(|a| a.variance.is_finite() && errors > 0.0)
    }
}

/// Both sides show one interior. Their difference in `fit.toml` is that of their σ, and the noise of the difference is
/// that of both.
pub(super) fn sides(record: &FitRecord, place: &Path, out: &mut Vec<String>) {
    let side = |name: &str| record.sections.get(name);
    let (Some(front), Some(back), Some(section)) = (side("front"), side("back"), side(SECTION)) else { return };
    let edited = record.options.contains_key("edited_from");
    // Photographs add to the errors afterwards what both sides have in common.
    let photo = record.options.get("capture_kind").is_some_and(|k| k == "photo");
    for quantity in [Quantity::SigmaA, Quantity::SigmaS].into_iter().filter(|_| !edited) {
        for c in 0..3 {
            let of = |s: &RecordSection| {
                let p = s.params.get(quantity.name())?;
                let value = *p.value.get(c)?;
                let caliper = p.stderr_caliper.get(c).copied().unwrap_or(0.0);
                Some((value, *p.stderr.get(c)? / value, caliper / value))
            };
            let Some(apart) = Apart::of(Some(section), quantity, c) else { continue };
            let (Some(a), Some(b)) = (of(front), of(back)) else { continue };
            let log = (a.0 / b.0).ln();
            let name = quantity.channel(c);
            if (log - apart.log).abs() > 1e-9 {
                // σ of a channel that the traces do not determine is replaced after the sides were compared.
                if a.1.is_finite() && b.1.is_finite() {
                    out.push(format!(
                        "{}: {name} of the front over that of the back has the logarithm {}, but sides.{APART}.{name} \
                         says {}; {CAUSE}",
                        place.display(),
                        figure(log),
                        figure(apart.log)
                    ));
                }
                continue;
            }
            let gauge = (0.5 * (apart.log * apart.log - apart.variance)).max(0.0);
            let noise = |(_, error, caliper): (f64, f64, f64)| error * error - caliper * caliper;
            let found = noise(a) + noise(b);
            let expected = apart.variance + 2.0 * gauge;
            // The caliper's part is subtracted from a number that may be hardly larger.
            let allowed = 1e-6 * expected + 1e-9 * (a.1 * a.1 + b.1 * b.1);
            if found.is_finite() && (found < expected - allowed || (!photo && found > expected + allowed)) {
                out.push(format!(
                    "{}: the standard errors of {name} of front and back, {} and {} of its value, leave a variance of \
                     {} to noise, but sides.{APART_IN_ERRORS}.{name} gives {}; {CAUSE}",
                    place.display(),
                    figure(a.1),
                    figure(b.1),
                    figure(found),
                    figure(expected)
                ));
            }
        }
    }
}
