//! Settings of accuracy knobs: rows of error against cost, and the cheapest row that the scene's tolerance allows.

use std::time::Instant;

/// One setting of an accuracy knob: what it costs and how wrong it is.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Row {
    /// Curve points, texels across a block, or shadow maps.
    pub setting: usize,
    /// Relative for the curve, displayed (0 to 1) for maps and shadows.
    pub error: f64,
    /// Measured time (ms); zero where the renderer has not been asked.
    pub ms: f64,
    /// Memory that the setting takes.
    pub bytes: u64,
}

/// Error of `n` hard shadows spread over the sun's disk against the disk itself, root mean square over a straight
/// edge's penumbra, times the displayed `contrast` of sun and shade and the root of the picture's `share` in penumbra.
pub fn shadow_samples(contrast: f64, share: f64, map_bytes: u64) -> Vec<Row> {
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
            Row {
                setting: n,
                error: rms * contrast * share.sqrt(),
                ms: start.elapsed().as_secs_f64() * 1e3,
                bytes: n as u64 * map_bytes,
            }
        })
        .collect()
}

/// The row with the fewest bytes within `allowed`, else the most accurate.
pub fn cheapest(rows: &[Row], allowed: f64) -> Option<Row> {
    let good = rows.iter().filter(|r| r.error <= allowed).min_by_key(|r| r.bytes);
    good.or_else(|| rows.iter().min_by(|a, b| a.error.total_cmp(&b.error))).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_shadow_samples_are_nearer_to_the_disk() {
        let rows = shadow_samples(1.0, 1.0, 1);
        // One hard shadow through the centre: the mean of the disk's squared hidden share over half the penumbra, .068
        // by Simpson's rule.
        assert!((rows[0].error - 0.068f64.sqrt()).abs() < 0.01, "{rows:?}");
        assert!(rows.windows(2).all(|w| w[1].error < w[0].error));
        assert_eq!(cheapest(&rows, 1.0).map(|r| r.setting), Some(1));
        assert_eq!(cheapest(&rows, 0.0).map(|r| r.setting), Some(64));
    }
}
