//! How much light a thickness lets through, and how far it travels.

use super::convolution::{ConvolutionSettings, TotalsSource};
use crate::dipole::{DipoleForm, Tissue};
use crate::slab;

/// Scattered share of the total.
pub(super) fn scattered(tissue: &Tissue, d: f64, form: DipoleForm) -> f64 {
    tissue.beyond(0.0, d, form)
}

/// Scattered and unscattered light of one unit that enters.
pub(super) fn total_parts(settings: &ConvolutionSettings, d: f64) -> [f64; 2] {
    let ConvolutionSettings { tissue, form, .. } = settings;
    let parts = [scattered(tissue, d, *form), tissue.ballistic(d, *form)];
    if settings.totals == TotalsSource::Form {
        return parts;
    }
    let whole = parts[0] + parts[1];
    let wanted = slab::response(tissue.sigma_a, tissue.reduced_scattering(), d).rho_t;
    if whole > 0.0 { parts.map(|p| p * wanted / whole) } else { [0.0, wanted] }
}

/// Radius (mm) beyond which less than `tail` of the scattered light leaves.
pub fn support(tissue: &Tissue, form: DipoleForm, d: f64, tail: f64) -> f64 {
    let whole = scattered(tissue, d, form);
    let outside = |r: f64| whole > 0.0 && tissue.beyond(r, d, form).abs() > tail * whole;
    let mut high = 0.1 * d;
    while outside(high) && high < 1e4 {
        high *= 2.0;
    }
    let mut low = 0.5 * high;
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        if outside(middle) { low = middle } else { high = middle }
    }
    high
}
