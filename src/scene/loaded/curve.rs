//! ρd and ρt of a slab over its thickness, with the requested accuracy.

use crate::plan::accuracy::Row;
use mesophyll_optics::slab;
use mesophyll_placed::ledger::Ledger;
use std::time::Instant;

/// ρd and ρt of the slab over its thickness, on a uniform grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Thickness at the first point (mm).
    pub min: f64,
    /// Thickness at the last point (mm).
    pub max: f64,
    /// Reflectance at each point of the grid, for each channel.
    pub rho_d: Vec<[f64; 3]>,
    /// Transmittance at each point of the grid, for each channel.
    pub rho_t: Vec<[f64; 3]>,
    /// Error of linear interpolation, for several numbers of points.
    pub rows: Vec<Row>,
}

/// The largest number of intervals of a curve.
const FINEST: usize = 1024;

/// Samples the slab between `min` and `max` mm until linear interpolation agrees with it within the relative error
/// `allowed`.
///
/// The error is measured at the middle of every interval, where a smooth curve is farthest from its chords. The middles
/// become points of the next refinement, so nothing is solved twice.
pub fn curve(
    sigma_a: [f64; 3],
    sigma_s: [f64; 3],
    min: f64,
    max: f64,
    allowed: f64,
    what: &str,
    ledger: &Ledger,
) -> Curve {
    ledger.note("curve", what, 0, || {
        let start = Instant::now();
        let (min, max) = if max > min { (min, max) } else { (min * (1.0 - 1e-3), min * (1.0 + 1e-3)) };
        let at = |h: f64| -> [[f64; 3]; 2] {
            let all = [0, 1, 2].map(|c| slab::response(sigma_a[c], sigma_s[c], h));
            [all.map(|r| r.rho_d), all.map(|r| r.rho_t)]
        };
        let mut points: Vec<[[f64; 3]; 2]> = vec![at(min), at(max)];
        let mut rows = Vec::new();
        loop {
            let intervals = points.len() - 1;
            let step = (max - min) / intervals as f64;
            let middles: Vec<[[f64; 3]; 2]> = (0..intervals).map(|k| at(min + (k as f64 + 0.5) * step)).collect();
            let mut error: f64 = 0.0;
            for (k, middle) in middles.iter().enumerate() {
                for q in 0..2 {
                    for c in 0..3 {
                        let chord = 0.5 * (points[k][q][c] + points[k + 1][q][c]);
                        // Values below a millionth are invisible, so they need no relative accuracy.
                        error = error.max((chord - middle[q][c]).abs() / middle[q][c].abs().max(1e-6));
                    }
                }
            }
            rows.push(Row {
                setting: points.len(),
                error,
                ms: start.elapsed().as_secs_f64() * 1e3,
                bytes: points.len() as u64 * 32,
            });
            if error <= allowed || intervals >= FINEST {
                let (rho_d, rho_t) = points.iter().map(|p| (p[0], p[1])).unzip();
                return Curve { min, max, rho_d, rho_t, rows };
            }
            let mut finer = Vec::with_capacity(2 * intervals + 1);
            for (k, middle) in middles.into_iter().enumerate() {
                finer.push(points[k]);
                finer.push(middle);
            }
            finer.push(points[intervals]);
            points = finer;
        }
    })
}

impl Curve {
    /// Linear interpolation, constant beyond the ends.
    pub fn at(&self, h: f64) -> ([f64; 3], [f64; 3]) {
        let last = self.rho_d.len() - 1;
        let x = ((h - self.min) / (self.max - self.min)).clamp(0.0, 1.0) * last as f64;
        let k = (x as usize).min(last - 1);
        let t = x - k as f64;
        let mix = |list: &[[f64; 3]]| [0, 1, 2].map(|c| list[k][c] * (1.0 - t) + list[k + 1][c] * t);
        (mix(&self.rho_d), mix(&self.rho_t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_as_fine_as_was_asked_and_no_finer() {
        let (sa, ss) = ([0.6, 0.4, 1.5], [12.0, 10.0, 9.0]);
        let ledger = Ledger::new();
        let mut last = 0;
        for allowed in [1e-2, 1e-3, 1e-4] {
            let c = curve(sa, ss, 0.1, 0.3, allowed, "t", &ledger);
            assert!(c.rho_d.len() > last);
            last = c.rho_d.len();
            // An independent test at points that are neither nodes nor middles.
            for k in 0..50 {
                let h = 0.1 + 0.2 * (f64::from(k) + 0.313) / 50.0;
                let (rd, rt) = c.at(h);
                for ch in 0..3 {
                    let r = slab::response(sa[ch], ss[ch], h);
                    assert!(
                        (rd[ch] / r.rho_d - 1.0).abs() <= 1.05 * allowed
                            && (rt[ch] / r.rho_t - 1.0).abs() <= 1.05 * allowed
                    );
                }
            }
        }
        assert_eq!(ledger.count("curve", "t"), 3);
    }
}
