//! Settings that trade accuracy for cost: rows of error and cost, and the cheapest row that the scene's tolerance
//! allows.

use std::time::Instant;

/// One setting, with its cost and its error.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct AccuracyRow {
    /// The setting: number of curve points, texels along a block, or number of shadow maps.
    pub setting: usize,
    /// The error: relative for a curve, of a displayed value (0 to 1) for maps and shadows.
    pub error: f64,
    /// Measured time (ms); 0 where the renderer has not been asked.
    pub ms: f64,
    /// Memory that the setting takes.
    pub bytes: u64,
}

/// Error of `n` hard shadows that are spread over the sun's disk, compared with the disk itself. It is the root mean
/// square over the penumbra of a straight edge, times the displayed `contrast` between sun and shade, and times the
/// root of the `share` of the picture that is in penumbra.
pub fn shadow_samples(contrast: f64, share: f64, map_bytes: u64) -> Vec<AccuracyRow> {
    [1usize, 4, 8, 16, 32, 64]
        .into_iter()
        .map(|n| {
            let start = Instant::now();
            let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
            let points: Vec<(f64, f64)> = (0..n)
                .map(|k| {
                    let (r, a) = (if n == 1 { 0.0 } else { ((k as f64 + 0.5) / n as f64).sqrt() }, k as f64 * golden);
                    (r * a.cos(), r * a.sin())
                })
                .collect();
            let (mut sum, mut count) = (0.0, 0);
            for turn in 0..16 {
                let (s, c) = (std::f64::consts::TAU * f64::from(turn) / 16.0).sin_cos();
                for step in 0..64 {
                    let edge = (f64::from(step) + 0.5) / 32.0 - 1.0;
                    let seen = points.iter().filter(|(x, y)| x * c + y * s > edge).count() as f64 / n as f64;
                    let exact = (edge.acos() - edge * (1.0 - edge * edge).sqrt()) / std::f64::consts::PI;
                    sum += (seen - exact) * (seen - exact);
                    count += 1;
                }
            }
            let rms = (sum / f64::from(count)).sqrt();
            AccuracyRow {
                setting: n,
                error: rms * contrast * share.sqrt(),
                ms: start.elapsed().as_secs_f64() * 1e3,
                bytes: n as u64 * map_bytes,
            }
        })
        .collect()
}

/// The row with the fewest bytes among those within `allowed`; if there is none, the most accurate row.
pub fn cheapest(rows: &[AccuracyRow], allowed: f64) -> Option<AccuracyRow> {
    let good = rows.iter().filter(|r| r.error <= allowed).min_by_key(|r| r.bytes);
    good.or_else(|| rows.iter().min_by(|a, b| a.error.total_cmp(&b.error))).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_shadow_samples_are_nearer_to_the_disk() {
        let rows = shadow_samples(1.0, 1.0, 1);
        // For one hard shadow from the centre, the mean square of the hidden share of the disk over half the penumbra
        // is .068, by Simpson's rule.
        assert!((rows[0].error - 0.068f64.sqrt()).abs() < 0.01, "{rows:?}");
        assert!(rows.windows(2).all(|w| w[1].error < w[0].error));
        assert_eq!(cheapest(&rows, 1.0).map(|r| r.setting), Some(1));
        assert_eq!(cheapest(&rows, 0.0).map(|r| r.setting), Some(64));
    }
}
