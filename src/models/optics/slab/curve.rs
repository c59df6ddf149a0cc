//! ρd and ρt of a slab over its thickness, as points between which a renderer interpolates.

use super::response;

/// ρd and ρt of the slab over its thickness, on a uniform grid.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseCurve {
    /// Thickness at the first point (mm).
    pub min: f64,
    /// Thickness at the last point (mm).
    pub max: f64,
    /// Reflectance at each point of the grid, for each channel.
    pub rho_d: Vec<[f64; 3]>,
    /// Transmittance at each point of the grid, for each channel.
    pub rho_t: Vec<[f64; 3]>,
}

/// The largest number of intervals of a curve.
const FINEST: usize = 1024;

impl ResponseCurve {
    /// Samples the slab between `min` and `max` mm until linear interpolation agrees with it within the relative error
    /// `allowed`. σ (1/mm) has a value for each channel. `tried` is told each number of points and its error.
    ///
    /// The error is measured at the middle of every interval, where a smooth curve is farthest from its chords. The
    /// middles become points of the next refinement, so nothing is solved twice.
    pub fn sampled(
        sigma_a: [f64; 3],
        sigma_s: [f64; 3],
        [min, max]: [f64; 2],
        allowed: f64,
        mut tried: impl FnMut(usize, f64),
    ) -> ResponseCurve {
        let (min, max) = if max > min { (min, max) } else { (min * (1.0 - 1e-3), min * (1.0 + 1e-3)) };
        let at = |h: f64| -> [[f64; 3]; 2] {
            let all = [0, 1, 2].map(|c| response(sigma_a[c], sigma_s[c], h));
            [all.map(|r| r.rho_d), all.map(|r| r.rho_t)]
        };
        let mut points: Vec<[[f64; 3]; 2]> = vec![at(min), at(max)];
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
            tried(points.len(), error);
            if error <= allowed || intervals >= FINEST {
                let (rho_d, rho_t) = points.iter().map(|p| (p[0], p[1])).unzip();
                return ResponseCurve { min, max, rho_d, rho_t };
            }
            let mut finer = Vec::with_capacity(2 * intervals + 1);
            for (k, middle) in middles.into_iter().enumerate() {
                finer.push(points[k]);
                finer.push(middle);
            }
            finer.push(points[intervals]);
            points = finer;
        }
    }

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
        let mut last = 0;
        for allowed in [1e-2, 1e-3, 1e-4] {
            let c = ResponseCurve::sampled(sa, ss, [0.1, 0.3], allowed, |_, _| ());
            assert!(c.rho_d.len() > last);
            last = c.rho_d.len();
            // An independent test at points that are neither nodes nor middles.
            for k in 0..50 {
                let h = 0.1 + 0.2 * (f64::from(k) + 0.313) / 50.0;
                let (rd, rt) = c.at(h);
                for ch in 0..3 {
                    let r = response(sa[ch], ss[ch], h);
                    assert!(
                        (rd[ch] / r.rho_d - 1.0).abs() <= 1.05 * allowed
                            && (rt[ch] / r.rho_t - 1.0).abs() <= 1.05 * allowed
                    );
                }
            }
        }
    }
}
