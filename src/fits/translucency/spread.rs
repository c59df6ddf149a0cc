//! How the errors of a reconstruction are distributed over a leaf's texels (H7 Fig. 12): means, percentiles, a
//! histogram. Errors are relative: f_rec/f − 1, where f_rec is the reconstruction of f by the basis.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Elevations of H7 Fig. 12, from the tangent plane (rad).
pub const ELEVATIONS: [f64; 3] = [FRAC_PI_2, FRAC_PI_4, PI / 8.0];

/// Width of a histogram's step at each of these elevations: errors grow as the light gets lower.
pub const STEPS: [f64; 3] = [0.0025, 0.01, 0.02];

/// Number of steps of a histogram; the middle one contains the error 0.
pub const BINS: usize = 41;

/// Texels that get less than this share of the elevation's mean are left out, because a relative error is meaningless
/// there (in deep shadow over absorbing tissue, f goes to 0 and its error does not).
pub const FAINT: f64 = 0.01;

/// Errors at one elevation, of texels that get at least [`FAINT`] of the mean at that elevation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TranslucencySpread {
    /// Elevation of the light over the blade (rad).
    pub elevation: f64,
    /// Mean of |f_rec/f − 1|, f_rec being the reconstruction.
    pub mean: f64,
    /// Mean of f_rec/f − 1: above 0 where the basis is too bright.
    pub bias: f64,
    /// Root mean square of f_rec/f − 1.
    pub rms: f64,
    /// Median of |f_rec/f − 1|.
    pub median: f64,
    /// 95th percentile of |f_rec/f − 1|.
    pub p95: f64,
    /// Largest |f_rec/f − 1|.
    pub worst: f64,
    /// Root mean square of f_rec − f over the mean of f, for all texels: the error that a picture at this elevation
    /// shows.
    pub visible: f64,
    /// Share of the judged texels in each step of f_rec/f − 1, starting at −[`TranslucencySpread::reach`].
    pub histogram: [f64; BINS],
    /// Width of a step of the histogram, in f_rec/f − 1.
    pub step: f64,
    /// Shares of the judged texels below the histogram and above it.
    pub beyond: [f64; 2],
    /// Share of texels left out as too faint.
    pub faint: f64,
}

impl TranslucencySpread {
    /// From pairs of reconstruction and truth, which are read three times; NaN where there are none.
    pub fn of(elevation: f64, step: f64, pairs: impl Iterator<Item = [f64; 2]> + Clone) -> TranslucencySpread {
        let (all, sum) = pairs.clone().fold((0.0, 0.0), |(n, sum), [_, f]| (n + 1.0, sum + f));
        let level = sum / all;
        let visible = (pairs.clone().map(|[rec, f]| (rec - f).powi(2)).sum::<f64>() / all).sqrt() / level;
        let mut errors: Vec<f64> =
            pairs.filter(|p| p[1] > 0.0 && p[1] >= FAINT * level).map(|[rec, f]| rec / f - 1.0).collect();
        let n = errors.len() as f64;
        let mut counts = [0usize; BINS];
        let mut outside = [0usize; 2];
        for e in &errors {
            let at = e / step + 0.5 * BINS as f64;
            match at {
                a if a < 0.0 => outside[0] += 1,
                a if a < BINS as f64 => counts[a as usize] += 1,
                _ => outside[1] += 1,
            }
        }
        let share = |count: usize| count as f64 / n;
        let bias = errors.iter().sum::<f64>() / n;
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / n).sqrt();
        errors.iter_mut().for_each(|e| *e = e.abs());
        // The mean is summed from the smallest to the largest, so the list is sorted as a whole.
        errors.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            errors
                .get(((errors.len() as f64 * share) as usize).min(errors.len().saturating_sub(1)))
                .copied()
                .unwrap_or(f64::NAN)
        };
        TranslucencySpread {
            elevation,
            mean: errors.iter().sum::<f64>() / n,
            bias,
            rms,
            median: at(0.5),
            p95: at(0.95),
            worst: at(1.0),
            visible,
            histogram: counts.map(share),
            step,
            beyond: outside.map(share),
            faint: 1.0 - n / all,
        }
    }

    /// Largest error that the histogram resolves.
    pub fn reach(&self) -> f64 {
        0.5 * BINS as f64 * self.step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of −60, −1, 0, 0 and 35 %, and a texel in the dark, sorted by hand.
    #[test]
    fn every_texel_is_counted_once() {
        let pairs = [[0.4, 1.0], [0.99, 1.0], [1.0, 1.0], [2.0, 2.0], [1.35, 1.0], [3.0, 1e-3]];
        let s = TranslucencySpread::of(1.0, 0.01, pairs.into_iter());
        assert_eq!((s.beyond, s.histogram[BINS / 2], s.histogram[BINS / 2 - 1]), ([0.2, 0.2], 0.4, 0.2));
        assert!((s.histogram.iter().chain(&s.beyond).sum::<f64>() - 1.0).abs() < 1e-12);
        assert!((s.faint - 1.0 / 6.0).abs() < 1e-12 && (s.reach() - 0.205).abs() < 1e-12);
        assert!((s.mean - 0.192).abs() < 1e-12 && (s.bias + 0.052).abs() < 1e-12, "{} {}", s.mean, s.bias);
        assert!((s.median - 0.01).abs() < 1e-9 && (s.worst - 0.6).abs() < 1e-12);
        let none = TranslucencySpread::of(1.0, 0.01, std::iter::empty());
        assert!(none.mean.is_nan() && none.median.is_nan() && none.visible.is_nan());
    }
}
