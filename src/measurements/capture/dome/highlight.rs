//! Subtracts the mirrored dome from a photograph under the dome. Values are shares of the dome's light, 0 … 1.
//!
//! Under an even dome a surface shows no bright spots. Its highlight is a veil, white and nearly the same everywhere,
//! of about the Fresnel reflectance along the normal, ((n − 1)/(n + 1))², whatever the roughness. One photograph cannot
//! tell it from a paler leaf, so it is computed from a stated refractive index n. Without one only a range is known:
//! effective indices of leaves are between 1.2 and 1.7 (Bousquet et al. 2005, quoted by Habel 2009, §3.3.3), and the
//! mirrored share is at most what the darkest texel shows in its darkest channel. Then the middle of the range is
//! subtracted, and its width is part of the errors.

use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::quantile;
use serde::Serialize;

/// Range of effective indices of leaves.
const INDICES: [f64; 2] = [1.2, 1.7];
/// Standard error that a stated index is assumed to have.
const INDEX_ERR: f64 = 0.05;
/// Share of the texels that may be darker than the bound because of noise.
const DARKEST: f64 = 0.01;

/// The veil of one side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Highlight {
    /// Share of the dome's light that is subtracted.
    pub share: f64,
    /// Standard error of `share`.
    pub stderr: f64,
    /// Upper bound: the darkest channel of the darkest texels.
    pub at_most: f64,
    /// Whether it comes from a stated index; otherwise it comes from the possible range.
    pub stated: bool,
}

/// Reflectance along the normal of a surface of refractive index `n`.
pub fn fresnel_normal(n: f64) -> f64 {
    ((n - 1.0) / (n + 1.0)).powi(2)
}

/// Estimates the veil from the reflectances of a side (NaN is skipped) where `mask` is set, and from the stated index
/// if there is one.
pub fn estimate(reflectance: &[Rgb], mask: &[bool], index: Option<f64>) -> Highlight {
    let mut darkest: Vec<f64> = reflectance
        .iter()
        .zip(mask)
        .filter(|(r, m)| **m && r.iter().all(|v| v.is_finite()))
        .map(|(r, _)| r.iter().copied().fold(f64::INFINITY, f64::min))
        .collect();
    let at_most = quantile(&mut darkest, DARKEST).unwrap_or(0.0).max(0.0);
    match index {
        Some(n) => {
            let slope = 4.0 * (n - 1.0) / (n + 1.0).powi(3);
            Highlight { share: fresnel_normal(n), stderr: slope * INDEX_ERR, at_most, stated: true }
        }
        None => {
            let high = fresnel_normal(INDICES[1]).min(at_most);
            let low = fresnel_normal(INDICES[0]).min(high);
            // Mean and standard deviation of a value that may lie anywhere in the range.
            Highlight { share: 0.5 * (low + high), stderr: (high - low) / 12f64.sqrt(), at_most, stated: false }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stated_index_wins_and_a_dark_leaf_bounds_the_rest() {
        let bright = vec![Rgb([0.2, 0.3, 0.25]); 50];
        let mask = vec![true; 50];
        let h = estimate(&bright, &mask, Some(1.5));
        assert!((h.share - 0.04).abs() < 1e-12 && h.stated && h.at_most == 0.2);
        // Indices of 1.2 … 1.7 give .0083 … .0672.
        let h = estimate(&bright, &mask, None);
        assert!((h.share - 0.5 * (0.2f64 / 2.2).powi(2) - 0.5 * (0.7f64 / 2.7).powi(2)).abs() < 1e-12);
        let mut dark = bright.clone();
        dark.iter_mut().for_each(|v| v[2] = 0.02);
        let h = estimate(&dark, &mask, None);
        assert!(h.share < 0.02 && h.share > 0.0083 && h.stderr < 0.004);
        dark.iter_mut().for_each(|v| v[0] = 0.001);
        let h = estimate(&dark, &mask, None);
        assert!((h.share - 0.001).abs() < 1e-12 && h.stderr == 0.0, "between 0.001 and 0.001");
    }
}
