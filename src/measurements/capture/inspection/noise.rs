//! Noise of frames from fourth differences along the tube's path. These cancel anything as smooth as the tube's
//! fall-off (to about 1e-4 of the value at 100 frames), so only noise is left: sd² = (relative · value)² + floor².

use mesophyll_base::statistics::{NORMAL_MEDIAN, median, upper_quantile};
use serde::Serialize;

/// Frames that a window of fourth differences needs.
pub(crate) const WINDOW: usize = 5;
/// 1, −4, 6, −4, 1: the sum of squares is 70.
const WEIGHTS: [f64; WINDOW] = [1.0, -4.0, 6.0, -4.0, 1.0];
const NORM: f64 = 8.366_600_265_340_756;
/// Logarithmic bins of the value, over 1e-4 … 1e2.
const BINS: usize = 24;
/// Smallest number of differences for which a bin counts.
const FEWEST: usize = 64;

/// The noise as the differences between frames show it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NoiseEstimate {
    /// The part that grows with the value: standard deviation = √((relative · value)² + floor²).
    pub relative: f64,
    /// The part that does not grow with the value.
    pub floor: f64,
    /// Median of the values that were looked at.
    pub typical_value: f64,
    /// The value that a tenth of the samples exceed.
    pub bright_value: f64,
    /// Differences that were looked at.
    pub differences: usize,
}

/// Differences sorted into bins of the value.
#[derive(Debug)]
pub struct NoiseMeter {
    bins: Vec<Vec<f32>>,
    values: Vec<Vec<f32>>,
}

impl Default for NoiseMeter {
    fn default() -> Self {
        NoiseMeter { bins: vec![Vec::new(); BINS], values: vec![Vec::new(); BINS] }
    }
}

impl NoiseMeter {
    /// Adds the texels of five consecutive frames of one channel.
    pub fn add(&mut self, frames: [&[f32]; WINDOW]) {
        for v in (0..frames[0].len()).map(|i| frames.map(|f| f64::from(f[i]))) {
            let mean = v.iter().sum::<f64>() / WINDOW as f64;
            let difference: f64 = v.iter().zip(WEIGHTS).map(|(x, w)| x * w).sum::<f64>() / NORM;
            if !difference.is_finite() {
                continue;
            }
            let bin = ((mean.max(1e-4).log10() + 4.0) / 6.0 * BINS as f64) as usize;
            let bin = bin.min(BINS - 1);
            self.bins[bin].push(difference.abs() as f32);
            self.values[bin].push(mean as f32);
        }
    }

    /// Robust standard deviation of every bin, then a weighted straight line of sd² over value².
    pub fn estimate(mut self) -> Option<NoiseEstimate> {
        let mut rows = Vec::new();
        for (bin, values) in self.bins.iter_mut().zip(&mut self.values) {
            if bin.len() >= FEWEST {
                let sd = f64::from(median(bin)?) / NORMAL_MEDIAN;
                rows.push((f64::from(median(values)?).powi(2), sd * sd, bin.len() as f64));
            }
        }
        let differences: usize = self.bins.iter().map(Vec::len).sum();
        let mut all: Vec<f32> = self.values.into_iter().flatten().collect();
        let typical_value = f64::from(median(&mut all)?);
        let bright_value = f64::from(upper_quantile(&mut all, 9, 10)?);
        let (a, b) = line(&rows)?;
        Some(NoiseEstimate { relative: a.sqrt(), floor: b.sqrt(), typical_value, bright_value, differences })
    }
}

/// The line y = a x + b with a, b ≥ 0. Each point has the weight of its count over y², because a variance is known to a
/// relative error.
fn line(rows: &[(f64, f64, f64)]) -> Option<(f64, f64)> {
    let rows: Vec<_> = rows.iter().filter(|r| r.1 > 0.0).collect();
    if rows.is_empty() {
        return None;
    }
    let sum = |f: &dyn Fn(f64, f64) -> f64| rows.iter().map(|(x, y, n)| n / (y * y) * f(*x, *y)).sum::<f64>();
    let (s, sx, sy) = (sum(&|_, _| 1.0), sum(&|x, _| x), sum(&|_, y| y));
    let (sxx, sxy) = (sum(&|x, _| x * x), sum(&|x, y| x * y));
    let determinant = s * sxx - sx * sx;
    if determinant > 1e-9 * s * sxx {
        let (a, b) = ((s * sxy - sx * sy) / determinant, (sxx * sy - sx * sxy) / determinant);
        if a >= 0.0 && b >= 0.0 {
            return Some((a, b));
        }
    }
    // One of the two parts cannot be seen: the better of the two one-parameter fits is taken.
    let (only_a, only_b) = (sxy / sxx.max(1e-300), sy / s);
    let misfit = |a: f64, b: f64| rows.iter().map(|(x, y, n)| n * ((a * x + b) / y - 1.0).powi(2)).sum::<f64>();
    Some(if misfit(only_a, 0.0) < misfit(0.0, only_b) { (only_a, 0.0) } else { (0.0, only_b) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn the_noise_that_was_added_is_found() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let mut normal = || {
            let (a, b): (f64, f64) = (rng.random::<f64>().max(1e-12), rng.random());
            (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        for (relative, floor) in [(0.01, 5e-4), (0.02, 0.0), (0.0, 1e-3)] {
            let texels = 20_000;
            let frames: Vec<Vec<f32>> = (0..WINDOW)
                .map(|k| {
                    (0..texels)
                        .map(|i| {
                            // a tube's fall-off over five frames of a hundred, at many levels
                            let u = -1.0 + 0.065 * k as f64;
                            let clean = 10f64.powf(-3.0 + 3.0 * i as f64 / texels as f64) / (1.0 + u * u);
                            (clean + (relative * clean).hypot(floor) * normal()) as f32
                        })
                        .collect()
                })
                .collect();
            let mut meter = NoiseMeter::default();
            meter.add(std::array::from_fn(|k| frames[k].as_slice()));
            let found = meter.estimate().unwrap();
            assert!((found.relative - relative).abs() < 0.1 * relative + 3e-4, "{found:?} against {relative}");
            assert!((found.floor - floor).abs() < 0.1 * floor + 5e-5, "{found:?} against {floor}");
        }
    }
}
