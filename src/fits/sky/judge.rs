//! The accuracy of a fit: its error at skies between the nodes and on every edge of the domain, compared with direct
//! integration.

use super::SkyFitForm;
use mesophyll_base::number::FloatingPoint;
use mesophyll_base::statistics::median;
use mesophyll_sky::projection::{ProjectionQuality, ProjectionRule};
use mesophyll_sky::{HarmonicCoefficients, SkyFamily};
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

/// Skies that were integrated directly, to compare fits with.
#[derive(Debug, Clone)]
pub struct SkyFitReference {
    /// Bands N of the harmonics that are compared.
    pub bands: usize,
    /// Least and greatest turbidity of the skies.
    pub turbidities: [f64; 2],
    /// Sun zenith angle, turbidity, coefficients.
    pub skies: Vec<(f64, f64, HarmonicCoefficients)>,
    /// Smallest c00 of all skies and channels.
    pub smallest: f64,
}

/// Errors over all skies of a [`SkyFitReference`], each divided by its smallest c00.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyFitErrors {
    /// Root of the sum of squared coefficient errors, for the worst channel of the worst sky. This is the measure used
    /// throughout (and Habel 2009 Eq. 5.4).
    pub worst: f64,
    /// Sun zenith angle, turbidity and channel of the worst error.
    pub worst_at: (f64, f64, usize),
    /// Median over skies of the worst channel.
    pub median: f64,
    /// Sum of absolute coefficient errors: worst channel, worst sky (Habel 2009 Eq. 5.3).
    pub worst_sum: f64,
    /// `worst` and `worst_sum` with only the first N bands, N = 1, 2, …
    pub by_bands: Vec<[f64; 2]>,
    /// Skies that the fit refused.
    pub refused: usize,
}

impl SkyFitReference {
    /// `suns` × `turbid` skies. Sun angles are evenly spaced but closer at the horizon, turbidities are evenly spaced,
    /// and all ends are included.
    ///
    /// # Errors
    /// What the model refuses.
    pub fn new(
        model: &dyn SkyFamily,
        bands: usize,
        turbidities: [f64; 2],
        suns: usize,
        turbid: usize,
    ) -> Result<SkyFitReference, String> {
        let mut angles: Vec<f64> =
            (0..suns).map(|k| (FRAC_PI_2 * k as f64 / (suns - 1) as f64).min(FRAC_PI_2)).collect();
        angles.extend([1e-3, 4e-3, 0.012, 0.03].map(|e| FRAC_PI_2 - e));
        let [low, high] = turbidities;
        let rows: Result<Vec<Vec<_>>, String> = angles
            .par_iter()
            .map(|s| {
                let rule = ProjectionRule::new(*s, bands, ProjectionQuality::Exact);
                let one = |k: usize| {
                    let t = (low + (high - low) * k as f64 / (turbid - 1) as f64).min(high);
                    let sky = model.sky(*s, t).map_err(|e| e.to_string())?;
                    Ok((*s, t, rule.project(sky.as_ref())))
                };
                (0..turbid).map(one).collect()
            })
            .collect();
        let skies: Vec<_> = rows?.into_iter().flatten().collect();
        let smallest = skies.iter().flat_map(|s| s.2.get(0, 0)).fold(f64::INFINITY, f64::min);
        Ok(SkyFitReference { bands, turbidities, skies, smallest })
    }
}

/// Judges a fit by its [`SkyFitForm::coefficients`].
pub fn judge<T: FloatingPoint>(form: &SkyFitForm<T>, reference: &SkyFitReference) -> SkyFitErrors {
    judge_with(|s, t| form.coefficients(s, t).ok(), reference)
}

/// Judges anything that gives coefficients.
pub fn judge_with(
    f: impl Fn(f64, f64) -> Option<HarmonicCoefficients> + Sync,
    reference: &SkyFitReference,
) -> SkyFitErrors {
    let bands = reference.bands;
    // For each sky: [root of squares, sum] of the worst channel for each number of bands, and the channel that is worst
    // with all bands.
    let errors: Vec<Option<(Vec<[f64; 2]>, usize)>> = reference
        .skies
        .par_iter()
        .map(|(s, t, want)| {
            let got = f(*s, *t)?;
            let mut rows = vec![[0.0f64; 2]; bands];
            let mut worst = (0.0, 0);
            for c in 0..3 {
                let (mut squares, mut sum) = (0.0, 0.0);
                for l in 0..bands {
                    for k in l * l..(l + 1) * (l + 1) {
                        let off: f64 = got.values().get(k).map_or(0.0, |v| v[c]) - want.values()[k][c];
                        squares += off * off;
                        sum += off.abs();
                    }
                    rows[l] = [rows[l][0].max(squares.sqrt()), rows[l][1].max(sum)];
                }
                if !(squares.sqrt() <= worst.0) {
                    worst = (squares.sqrt(), c);
                }
            }
            Some((rows, worst.1))
        })
        .collect();
    let scale = 1.0 / reference.smallest;
    let mut out = SkyFitErrors {
        worst: 0.0,
        worst_at: (f64::NAN, f64::NAN, 0),
        median: f64::NAN,
        worst_sum: 0.0,
        by_bands: vec![[0.0; 2]; bands],
        refused: errors.iter().filter(|e| e.is_none()).count(),
    };
    let mut all = Vec::new();
    for ((s, t, _), error) in reference.skies.iter().zip(&errors) {
        let Some((rows, channel)) = error else { continue };
        for (to, from) in out.by_bands.iter_mut().zip(rows) {
            (0..2).for_each(|k| to[k] = to[k].max(from[k] * scale));
        }
        let last = rows[bands - 1][0] * scale;
        all.push(last);
        if !(last <= out.worst) {
            out.worst = last;
            out.worst_at = (*s, *t, *channel);
        }
    }
    out.median = median(&mut all).unwrap_or(f64::NAN);
    out.worst_sum = out.by_bands.last().map_or(f64::NAN, |b| b[1]);
    if all.is_empty() {
        out.worst = f64::NAN;
    }
    out
}
