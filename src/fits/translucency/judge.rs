//! How far the stored directions are from the full convolution, for light from three elevations (H9 Fig. 3.19: π/2,
//! π/4, π/8) at four azimuths each.

use super::spread::{ELEVATIONS, STEPS, TranslucencySpread};
use super::{TranslucencyColour, colour};
use mesophyll_optics::translucency::basis::HemisphereBasis;
use mesophyll_optics::translucency::blade::LitSide;
use mesophyll_optics::translucency::convolution::Convolver;
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance};
use std::f64::consts::FRAC_PI_2;

/// Names of [`ELEVATIONS`] in `fit.toml`.
pub const NAMES: [&str; 3] = ["steep", "half", "grazing"];

/// Unit vector of an elevation over the blade and an azimuth from x (right) to y (up), rad.
pub fn direction(elevation: f64, azimuth: f64) -> [f64; 3] {
    [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()]
}

/// How M of a direction is turned into what is stored.
pub struct TranslucencyScale<'a> {
    /// What the colour is taken from, which decides how M is scaled.
    pub colour: TranslucencyColour,
    /// ∫ M dω of each texel.
    pub total: &'a [f64],
    /// Texels on the leaf.
    pub mask: &'a [bool],
}

/// For each elevation: the mean, median and 95th percentile of |rec/full − 1| (rec is the reconstruction) over texels
/// that are not too faint, the share of texels that are too faint ([`super::spread::FAINT`]), and the RMS of rec − full
/// over that of full for all texels.
pub fn against_full(
    lit: &LitSide,
    horizon: &Horizon,
    convolver: &Convolver,
    basis: HemisphereBasis,
    stored: &[Vec<f64>],
    scale: &TranslucencyScale,
) -> Vec<(String, f64)> {
    let mut out = Vec::new();
    for ((name, elevation), step) in NAMES.into_iter().zip(ELEVATIONS).zip(STEPS) {
        let azimuths = if elevation > FRAC_PI_2 - 1e-9 { 1 } else { 4 };
        let directions: Vec<[f64; 3]> =
            (0..azimuths).map(|k| direction(elevation, FRAC_PI_2 * (f64::from(k) + 0.5))).collect();
        let sources: Vec<Vec<f64>> =
            directions.iter().map(|d| irradiance(lit, horizon, *d, Visibility::Hard)).collect();
        let mut full = convolver.run(&lit.thickness, &sources);
        match scale.colour {
            TranslucencyColour::Substituted => {
                colour::substitute(&mut full, scale.total, &vec![elevation.sin(); directions.len()], scale.mask);
            }
            TranslucencyColour::Product => {
                colour::level(&mut full, scale.total, scale.mask);
            }
            TranslucencyColour::ThreeWavelengths => {}
        }
        let weights: Vec<Vec<f64>> =
            directions.iter().map(|d| (0..stored.len()).map(|i| basis.value(i, *d)).collect()).collect();
        let (weights, mask) = (&weights, scale.mask);
        let rec = move |m: usize, k: usize| weights[m].iter().zip(stored).map(|(w, s)| w * s[k]).sum::<f64>();
        let pairs = full.iter().enumerate().flat_map(move |(m, full)| {
            full.iter().enumerate().filter(|(k, _)| mask[*k]).map(move |(k, f)| [rec(m, k), *f])
        });
        let (square, level) = pairs.clone().fold((0.0, 0.0), |(s, l), [rec, f]| (s + (rec - f).powi(2), l + f * f));
        let spread = TranslucencySpread::of(elevation, step, pairs);
        let mut say = |what: &str, value: f64| out.push((format!("basis_{what}_{name}"), value));
        say("mean", spread.mean);
        say("median", spread.median);
        say("p95", spread.p95);
        say("faint", spread.faint);
        say("rms", if level > 0.0 { (square / level).sqrt() } else { f64::NAN });
    }
    out
}
