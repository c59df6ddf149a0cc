//! The measurement's noise: as the capture states it, else estimated from how rough the traces are.

use crate::Result;
use crate::capture::manifest::{SideName, Travel};
use crate::capture::reader::Capture;

/// sd = √((relative·value)² + floor²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    pub relative: f64,
    pub floor: f64,
    /// Estimated, not stated.
    pub estimated: bool,
}

/// The texel model is integrated to about 1e-5 (`optics/tube`): claiming less noise would weigh its own error as signal.
const LEAST_RELATIVE: f64 = 2e-5;
const LEAST_FLOOR: f64 = 1e-7;

/// Stated or estimated noise.
pub fn level(capture: &Capture) -> Result<Level> {
    let m = &capture.manifest;
    if let (Some(relative), Some(floor)) = (m.noise_relative, m.noise_floor) {
        return Ok(Level { relative: relative.max(LEAST_RELATIVE), floor: floor.max(LEAST_FLOOR), estimated: false });
    }
    let (relative, floor) = estimate(&sample(capture)?);
    Ok(Level {
        relative: m.noise_relative.unwrap_or(relative).max(LEAST_RELATIVE),
        floor: m.noise_floor.unwrap_or(floor).max(LEAST_FLOOR),
        estimated: true,
    })
}

/// Traces of texels across the middle rows.
fn sample(capture: &Capture) -> Result<Vec<Vec<f64>>> {
    let m = &capture.manifest;
    let rows = m.height / 2..(m.height / 2 + 2).min(m.height);
    let step = (m.width / 200).max(1);
    let texels: Vec<[u32; 2]> = (0..m.width).step_by(step).map(|i| [i as u32, rows.start as u32]).collect();
    let band = capture.band(SideName::Front, Travel::X, rows, &texels)?;
    Ok((0..texels.len()).flat_map(|n| [0, 1, 2].map(|c: usize| band.iter().map(|f| f64::from(f[n][c])).collect::<Vec<f64>>())).collect())
}

/// Fits variance = (r·value)² + f² to third differences, whose expectation over a smooth trace is only noise: a third difference of
/// independent samples has 20 times their variance. Medians keep the glossy peak, where third differences are signal, from counting.
fn estimate(traces: &[Vec<f64>]) -> (f64, f64) {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for trace in traces {
        for w in trace.windows(4) {
            let d = (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs() / 20f64.sqrt();
            let mean = (w[0] + w[1] + w[2] + w[3]) / 4.0;
            if d.is_finite() && mean > 0.0 {
                points.push((mean, d));
            }
        }
    }
    if points.len() < 64 {
        return (0.01, 5e-4);
    }
    points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    // Median |d| = 0.6745 sd in bins of equal counts over the value.
    let bins: Vec<(f64, f64)> = points
        .chunks(points.len().div_ceil(16))
        .map(|chunk| {
            let mut d: Vec<f64> = chunk.iter().map(|p| p.1).collect();
            d.sort_unstable_by(f64::total_cmp);
            (chunk[chunk.len() / 2].0, d[d.len() / 2] / 0.6745)
        })
        .collect();
    // Weighted straight line of sd² over value², weights 1/sd⁴ so that bright bins do not drown the floor.
    let (mut s, mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (value, sd) in bins {
        let (x, y) = (value * value, sd * sd);
        let w = 1.0 / (y * y).max(1e-30);
        s += w;
        sx += w * x;
        sy += w * y;
        sxx += w * x * x;
        sxy += w * x * y;
    }
    let det = (s * sxx - sx * sx).max(f64::MIN_POSITIVE);
    let (slope, intercept) = ((s * sxy - sx * sy) / det, (sxx * sy - sx * sxy) / det);
    (slope.max(0.0).sqrt(), intercept.max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_read_off_smooth_traces() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        let traces: Vec<Vec<f64>> = (0..300)
            .map(|_| {
                let scale: f64 = 0.05 + 0.3 * rng.random::<f64>();
                (0..100)
                    .map(|k| {
                        let u = -4.0 + 0.065 * f64::from(k);
                        let v = scale / (1.0 + u * u);
                        let (a, b): (f64, f64) = (rng.random(), rng.random());
                        let z = (-2.0 * a.max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * b).cos();
                        v + z * ((0.01 * v).powi(2) + 5e-4f64.powi(2)).sqrt()
                    })
                    .collect()
            })
            .collect();
        let (relative, floor) = estimate(&traces);
        assert!((relative / 0.01 - 1.0).abs() < 0.15, "{relative}");
        assert!((floor / 5e-4 - 1.0).abs() < 0.15, "{floor}");
    }
}
