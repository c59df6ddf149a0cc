//! Summaries of maps: robust ranges, quantiles, histograms. Nothing is fitted here.

use serde::Serialize;

/// Quantile `q` ∈ [0, 1] of sorted values, linear between neighbours; NaN when empty. The quantiles of
/// [`mesophyll_base::statistics`] are values of the list; a report's are read beside a histogram, whose axis is
/// continuous.
pub fn quantile(sorted: &[f32], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = q.clamp(0.0, 1.0) * last as f64;
    let (lo, hi) = (at.floor() as usize, at.ceil() as usize);
    let (a, b) = (f64::from(sorted[lo]), f64::from(sorted[hi]));
    a + (b - a) * (at - lo as f64)
}

/// The finite values, sorted.
pub fn sorted(values: impl Iterator<Item = f32>) -> Vec<f32> {
    let mut out: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    out.sort_unstable_by(f32::total_cmp);
    out
}

/// Five numbers of a map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MapSummary {
    pub samples: usize,
    pub p01: f64,
    pub median: f64,
    pub p99: f64,
    pub min: f64,
    pub max: f64,
}

impl MapSummary {
    /// The summary of sorted values; `None` when nothing is finite.
    pub fn of(sorted: &[f32]) -> Option<MapSummary> {
        let (first, last) = (sorted.first()?, sorted.last()?);
        Some(MapSummary {
            samples: sorted.len(),
            p01: quantile(sorted, 0.01),
            median: quantile(sorted, 0.5),
            p99: quantile(sorted, 0.99),
            min: f64::from(*first),
            max: f64::from(*last),
        })
    }
}

/// Counts in equal bins over [min, max].
#[derive(Debug, Clone, PartialEq)]
pub struct MapHistogram {
    pub min: f64,
    pub max: f64,
    pub counts: Vec<usize>,
    /// Finite values below `min` or above `max`.
    pub outside: usize,
}

impl MapHistogram {
    pub fn of(values: impl Iterator<Item = f32>, min: f64, max: f64, bins: usize) -> MapHistogram {
        let mut counts = vec![0; bins.max(1)];
        let scale = counts.len() as f64 / (max - min);
        let last = counts.len() - 1;
        let mut outside = 0;
        for v in values.filter(|v| v.is_finite()) {
            let at = (f64::from(v) - min) * scale;
            if at < 0.0 || at > counts.len() as f64 {
                outside += 1;
            } else {
                counts[(at as usize).min(last)] += 1;
            }
        }
        MapHistogram { min, max, counts, outside }
    }

    pub fn total(&self) -> usize {
        self.counts.iter().sum::<usize>() + self.outside
    }

    /// The share per unit of the axis, bin by bin.
    pub fn density(&self) -> Vec<f64> {
        let norm = self.total().max(1) as f64 * (self.max - self.min) / self.counts.len() as f64;
        self.counts.iter().map(|&c| c as f64 / norm).collect()
    }
}

/// A range that is never empty: it is widened a little where all values are equal.
pub fn widen(min: f64, max: f64) -> (f64, f64) {
    if !(min.is_finite() && max.is_finite()) {
        return (0.0, 1.0);
    }
    let least = 1e-6 * min.abs().max(max.abs()).max(1e-12);
    if max - min > least { (min, max) } else { (min - 50.0 * least, max + 50.0 * least) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_ramp_are_the_ramp() {
        let ramp = sorted((0..=100).rev().map(|k| k as f32).chain([f32::NAN, f32::INFINITY]));
        let s = MapSummary::of(&ramp).unwrap();
        assert_eq!((s.samples, s.p01, s.median, s.p99, s.max), (101, 1.0, 50.0, 99.0, 100.0));
        assert!((quantile(&ramp, 0.255) - 25.5).abs() < 1e-12);
        assert!(MapSummary::of(&[]).is_none());
    }

    #[test]
    fn a_density_integrates_to_the_share_inside() {
        let h = MapHistogram::of([-5.0, 0.1, 0.2, 0.9, 2.0, f32::NAN].into_iter(), 0.0, 2.0, 4);
        assert_eq!((h.counts.as_slice(), h.outside), ([2, 1, 0, 1].as_slice(), 1));
        // four of the five finite values lie inside
        assert!((h.density().iter().sum::<f64>() * 0.5 - 0.8).abs() < 1e-12);
    }

    #[test]
    fn ranges_are_never_empty() {
        for v in [0.0, 1.0, -3e8, 1e-20] {
            let (a, b) = widen(v, v);
            assert!(a < b, "{v}");
        }
    }
}
