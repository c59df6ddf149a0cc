//! What faults of the measurement do to standard errors.

use crate::leaf::faults::{ScanFindings, TrialBias};
use crate::leaf::interior::{FittedTexel, LeafSideFit};
use crate::leaf::noise::CameraNoise;
use crate::leaf::texels;
use crate::record::FitRecord;
use mesophyll_base::rgb::Rgb;
use mesophyll_files::image::ChannelMaps;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::slab::response_with_partials;

/// Records the faults that were found, and takes them into account: the errors of the texels hold what a wrong cause
/// did to them, and residuals that nothing explains.
pub fn found(record: &mut FitRecord, done: &mut [LeafSideFit], found: ScanFindings, level: &mut CameraNoise) {
    for (fitted, (bias, scale)) in done.iter_mut().zip(found.bias.into_iter().zip(found.scale)) {
        widen(fitted, bias, scale);
    }
    // Few frames make a lobe as rough as noise, and a frame that flickers does, too. Neighbouring texels tell noise
    // from both.
    let beside = found.noise.iter().flatten().copied().reduce(f64::max);
    level.seen = match (level.seen, beside) {
        (Some(seen), Some(beside)) if seen > 1.0 => Some(seen.min(beside.max(1.0))),
        (seen, _) => seen,
    };
    record.faults = found.faults;
}

/// Widens the standard errors of a side's texels. `scale`: residuals over the noise.
fn widen(fitted: &mut LeafSideFit, bias: TrialBias, scale: f64) {
    let before = Rgb::of(|c| texels::error(&fitted.maps, Quantity::RhoD, c).to_vec());
    widen_parts(&mut fitted.maps, bias, scale);
    // γ and σ follow from ρd, and so do their errors.
    for (c, before) in before.iter().enumerate() {
        let after = texels::error(&fitted.maps, Quantity::RhoD, c);
        let rho_d = fitted.maps.plane(Quantity::RhoD, c).unwrap_or_default();
        for FittedTexel { at, interior, sigma, .. } in &mut fitted.texels {
            let at = *at;
            let more = (f64::from(after[at]).powi(2) - f64::from(before[at]).powi(2)).max(0.0).sqrt();
            if !(more > 0.0 && more.is_finite()) {
                continue;
            }
            let gamma = interior.gamma[c] * more / f64::from(rho_d[at]);
            interior.gamma_err[c] = interior.gamma_err[c].hypot(gamma);
            let sigma = &mut sigma[c];
            let (_, p) = response_with_partials(sigma.value[0], sigma.value[1], interior.thickness);
            let det = p.sigma_a.rho_d * p.sigma_s.rho_t - p.sigma_s.rho_d * p.sigma_a.rho_t;
            for (error, by) in sigma.error.iter_mut().zip([p.sigma_s.rho_t / det, -p.sigma_a.rho_t / det]) {
                if (by * more).is_finite() {
                    *error = error.hypot(by * more);
                }
            }
        }
    }
}

/// The same for the merged parts.
fn widen_parts(parts: &mut ChannelMaps, bias: TrialBias, scale: f64) {
    let (chi2, freedom) = texels::chi2(parts);
    // A texel whose own χ² is that large has wide errors already.
    let own: Vec<bool> = chi2.iter().zip(freedom).map(|(c, f)| *c > f + 5.0 * (2.0 * f).sqrt()).collect();
    let TrialBias { rho_d, rho_s, m, normal } = bias;
    for (quantity, relative, absolute) in [
        (Quantity::RhoD, rho_d, 0.0),
        (Quantity::RhoS, rho_s, 0.0),
        (Quantity::M, m, 0.0),
        (Quantity::Normal, 0.0, normal),
    ] {
        for c in 0..quantity.letters().len() {
            let value = parts.plane(quantity, c).unwrap_or_default().to_vec();
            let Some(error) = texels::error_mut(parts, quantity, c) else { continue };
            for (k, error) in error.iter_mut().enumerate() {
                if scale > 1.0 && !own[k] {
                    *error *= scale as f32;
                }
                if relative + absolute > 0.0 && value[k].is_finite() {
                    *error = error.hypot(relative as f32 * value[k] + absolute as f32);
                }
            }
        }
    }
}
