//! Compares front with back. Both sides show one interior, so their σa and σs must agree.
//!
//! Each side's σ depends on that side's gauge, mean γ = 1. This gauge takes the interior's reflectance to be the side's
//! mean reflectance. Nothing on one side can tell how far that is from the truth, and the standard errors from noise do
//! not include it: leaves are brighter from below, and a part of a leaf is not the mean of the whole. Where both sides
//! were measured, their difference can tell. The part of it that noise does not explain is added to both sides as an
//! error of the gauge (two measurements of one number: DerSimonian & Laird 1986).

use super::interior::LeafSideFit;
use crate::record::{FitRecord, RecordSection};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::quantity::RGB;

/// Section of `fit.toml` that holds the comparison.
pub const SECTION: &str = "sides";
/// Figures: ln(front/back), and the same in combined standard errors of the noise, as `apart.sigma_a.R` and
/// `apart_in_errors.sigma_a.R`.
pub const APART: &str = "apart";
/// ln(front/back) divided by the combined standard error.
pub const APART_IN_ERRORS: &str = "apart_in_errors";

/// What one side says about the interior: σa and σs with relative standard errors, a channel each.
pub struct InteriorEstimates<'a> {
    /// Absorption coefficient (1/mm).
    pub sigma_a: Rgb,
    /// Scattering coefficient (1/mm).
    pub sigma_s: Rgb,
    /// Relative standard errors of σa.
    pub sigma_a_rel: &'a mut Rgb,
    /// Relative standard errors of σs.
    pub sigma_s_rel: &'a mut Rgb,
}

fn of(side: &mut LeafSideFit) -> InteriorEstimates<'_> {
    InteriorEstimates {
        sigma_a: side.sigma_a,
        sigma_s: side.sigma_s,
        sigma_a_rel: &mut side.sigma_a_rel,
        sigma_s_rel: &mut side.sigma_s_rel,
    }
}

/// [`widen`] for the sides of a scan.
pub fn compare(done: &mut [LeafSideFit], caliper: f64, record: &mut FitRecord) {
    let [front, back] = done else { return };
    widen(of(front), of(back), caliper, record);
}

/// Widens both sides' relative errors by the part of their difference that noise does not explain, and records the
/// difference. `caliper` is the relative standard error of h. Both sides share it, so it says nothing about their
/// difference.
pub fn widen(front: InteriorEstimates, back: InteriorEstimates, caliper: f64, record: &mut FitRecord) {
    let mut section = RecordSection::default();
    let quantities = [
        ("sigma_a", front.sigma_a, back.sigma_a, front.sigma_a_rel, back.sigma_a_rel),
        ("sigma_s", front.sigma_s, back.sigma_s, front.sigma_s_rel, back.sigma_s_rel),
    ];
    for (name, a, b, a_rel, b_rel) in quantities {
        for (c, letter) in RGB.into_iter().enumerate() {
            let noise = |relative: f64| (relative * relative - caliper * caliper).max(0.0);
            let (apart, variance) = ((a[c] / b[c]).ln(), noise(a_rel[c]) + noise(b_rel[c]));
            if !(apart.is_finite() && variance.is_finite() && variance > 0.0) {
                continue;
            }
            section.figures.insert(format!("{APART}.{name}.{letter}"), apart);
            section.figures.insert(format!("{APART_IN_ERRORS}.{name}.{letter}"), apart.abs() / variance.sqrt());
            let gauge = (0.5 * (apart * apart - variance)).max(0.0).sqrt();
            (a_rel[c], b_rel[c]) = (a_rel[c].hypot(gauge), b_rel[c].hypot(gauge));
        }
    }
    record.sections.insert(SECTION.into(), section);
}
