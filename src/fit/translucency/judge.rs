//! How far the stored directions are from the full convolution: light from three elevations (H9 Fig. 3.19: π/2, π/4, π/8), four azimuths each.

use super::{Colour, colour};
use crate::optics::translucency::basis::Basis;
use crate::optics::translucency::blade::LitSide;
use crate::optics::translucency::convolve::Convolver;
use crate::optics::translucency::horizon::Horizon;
use crate::optics::translucency::irradiance::{Visibility, irradiance};
use std::f64::consts::{FRAC_PI_2, PI};

/// Names of the elevations over the blade, and the angles (rad).
pub const ELEVATIONS: [(&str, f64); 3] = [("steep", PI / 2.0), ("half", PI / 4.0), ("grazing", PI / 8.0)];

/// Unit vector of an elevation over the blade and an azimuth from x (right) to y (up), rad.
pub fn direction(elevation: f64, azimuth: f64) -> [f64; 3] {
    [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()]
}

/// How M of a direction becomes what is stored.
pub struct Scale<'a> {
    pub colour: Colour,
    /// ∫ M dω a texel.
    pub total: &'a [f64],
    pub mask: &'a [bool],
}

/// Mean and 95th percentile of |rec/full − 1| and the RMS of rec − full over that of full, an elevation each.
pub fn against_full(
    lit: &LitSide,
    horizon: &Horizon,
    convolver: &Convolver,
    basis: Basis,
    stored: &[Vec<f64>],
    scale: &Scale,
) -> Vec<(String, f64)> {
    let mut out = Vec::new();
    for (name, elevation) in ELEVATIONS {
        let azimuths = if elevation > FRAC_PI_2 - 1e-9 { 1 } else { 4 };
        let directions: Vec<[f64; 3]> = (0..azimuths).map(|k| direction(elevation, FRAC_PI_2 * (f64::from(k) + 0.5))).collect();
        let sources: Vec<Vec<f64>> = directions.iter().map(|d| irradiance(lit, horizon, *d, Visibility::Hard)).collect();
        let mut full = convolver.run(&lit.thickness, &sources);
        match scale.colour {
            Colour::Substituted => {
                colour::substitute(&mut full, scale.total, &vec![elevation.sin(); directions.len()], scale.mask);
            }
            Colour::Product => {
                colour::level(&mut full, scale.total, scale.mask);
            }
            Colour::ThreeWavelengths => {}
        }
        let (mut relative, mut square, mut level) = (Vec::new(), 0.0, 0.0);
        for (d, full) in directions.iter().zip(&full) {
            let weights: Vec<f64> = (0..stored.len()).map(|i| basis.value(i, *d)).collect();
            for k in (0..full.len()).filter(|&k| scale.mask[k]) {
                let rec: f64 = weights.iter().zip(stored).map(|(w, s)| w * s[k]).sum();
                square += (rec - full[k]).powi(2);
                level += full[k].powi(2);
                if full[k] > 0.0 {
                    relative.push((rec / full[k] - 1.0).abs());
                }
            }
        }
        relative.sort_unstable_by(f64::total_cmp);
        let mean = relative.iter().sum::<f64>() / relative.len().max(1) as f64;
        out.push((format!("basis_mean_{name}"), mean));
        out.push((format!("basis_p95_{name}"), relative.get(relative.len() * 95 / 100).copied().unwrap_or(f64::NAN)));
        out.push((format!("basis_rms_{name}"), if level > 0.0 { (square / level).sqrt() } else { f64::NAN }));
    }
    out
}
