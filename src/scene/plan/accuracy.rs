//! Settings of accuracy knobs: rows of error against cost, measured here and now, and the cheapest row that the scene's
//! tolerance allows.

use crate::ledger::Ledger;
use mesophyll_optics::slab;
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
    pub bytes: u64,
}

/// ρd and ρt of the slab against thickness, on a uniform grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// mm.
    pub min: f64,
    pub max: f64,
    pub rho_d: Vec<[f64; 3]>,
    pub rho_t: Vec<[f64; 3]>,
    /// Error of linear interpolation against the slab, by number of points.
    pub rows: Vec<Row>,
}

/// Most intervals of a curve.
const FINEST: usize = 1024;

/// Samples the slab between `min` and `max` mm until linear interpolation is within `allowed` (relative) of it.
///
/// The error is measured at the midpoints of every interval, where a smooth curve is farthest from its chords; the
/// midpoints become the next refinement's points, so nothing is solved twice.
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
                        // Below a millionth nothing shows: no relative digits are asked there.
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
    /// Linear interpolation, held at the ends.
    pub fn at(&self, h: f64) -> ([f64; 3], [f64; 3]) {
        let last = self.rho_d.len() - 1;
        let x = ((h - self.min) / (self.max - self.min)).clamp(0.0, 1.0) * last as f64;
        let k = (x as usize).min(last - 1);
        let t = x - k as f64;
        let mix = |list: &[[f64; 3]]| [0, 1, 2].map(|c| list[k][c] * (1.0 - t) + list[k + 1][c] * t);
        (mix(&self.rho_d), mix(&self.rho_t))
    }
}

/// Displayed error of a map that is uploaded averaged over blocks of 1, 2, 4 … texels: sampled once a pixel through its
/// mips (trilinear, as the renderer does) against its mean over the pixel. `value` holds the displayed map; a pixel
/// covers `footprint` texels a side. The error is the 99th percentile over pixels. Rows run from the finest (dearest)
/// to the coarsest.
pub fn map_levels(
    value: &[f32],
    width: usize,
    height: usize,
    good: impl Fn(usize) -> bool,
    footprint: f64,
    texel_bytes: u64,
) -> Vec<Row> {
    let mut levels = vec![Level { width, height, value: value.to_vec() }];
    while let Some(last) = levels.last()
        && last.width >= 8
        && last.height >= 8
        && f64::from(1 << (levels.len() - 1)) <= footprint
    {
        let next = last.halved();
        levels.push(next);
    }
    let (nx, ny) = ((width as f64 / footprint) as usize, (height as f64 / footprint) as usize);
    // A few thousand pixels tell the percentile.
    let stride = ((nx * ny) as f64 / 4096.0).sqrt().ceil().max(1.0) as usize;
    let wanted = footprint.log2().max(0.0);
    let mut rows = Vec::new();
    for base in 0..levels.len() {
        let start = Instant::now();
        let lod = wanted.clamp(base as f64, (levels.len() - 1) as f64);
        let (fine, coarse, t) = (lod.floor() as usize, lod.ceil() as usize, lod.fract());
        let look = |k: usize, x: f64, y: f64| {
            let block = f64::from(1 << k);
            levels[k].bilinear(x / block, y / block)
        };
        let mut errors = Vec::new();
        for py in (0..ny).step_by(stride) {
            for px in (0..nx).step_by(stride) {
                let (x0, y0) = (px as f64 * footprint, py as f64 * footprint);
                if let Some(mean) = box_mean(value, width, &good, x0, y0, footprint) {
                    let (cx, cy) = (x0 + footprint / 2.0, y0 + footprint / 2.0);
                    errors.push(((1.0 - t) * look(fine, cx, cy) + t * look(coarse, cx, cy) - mean).abs());
                }
            }
        }
        // A third more for the mips.
        let bytes = (levels[base].width * levels[base].height) as u64 * texel_bytes * 4 / 3;
        rows.push(Row {
            setting: 1 << base,
            error: percentile(&mut errors, 0.99),
            ms: start.elapsed().as_secs_f64() * 1e3,
            bytes,
        });
    }
    rows
}

struct Level {
    width: usize,
    height: usize,
    value: Vec<f32>,
}

impl Level {
    fn halved(&self) -> Level {
        let (width, height, value) = halve(&self.value, self.width, self.height, |a, b, c, d| (a + b + c + d) / 4.0);
        Level { width, height, value }
    }

    /// `x`, `y` in texels of this level, texel centres at ½.
    fn bilinear(&self, x: f64, y: f64) -> f64 {
        let pick = |i: isize, j: isize| {
            let (i, j) = (i.clamp(0, self.width as isize - 1) as usize, j.clamp(0, self.height as isize - 1) as usize);
            f64::from(self.value[j * self.width + i])
        };
        let (x, y) = (x - 0.5, y - 0.5);
        let (i, j) = (x.floor() as isize, y.floor() as isize);
        let (fx, fy) = (x - x.floor(), y - y.floor());
        (pick(i, j) * (1.0 - fx) + pick(i + 1, j) * fx) * (1.0 - fy)
            + (pick(i, j + 1) * (1.0 - fx) + pick(i + 1, j + 1) * fx) * fy
    }
}

/// Blocks of two by two joined; an odd last row or column pairs with itself.
pub fn halve<T: Copy>(
    value: &[T],
    width: usize,
    height: usize,
    join: impl Fn(T, T, T, T) -> T,
) -> (usize, usize, Vec<T>) {
    let (w, h) = (width.div_ceil(2), height.div_ceil(2));
    let pick = |i: usize, j: usize| value[j.min(height - 1) * width + i.min(width - 1)];
    let out = (0..w * h)
        .map(|k| {
            let (i, j) = (k % w * 2, k / w * 2);
            join(pick(i, j), pick(i + 1, j), pick(i, j + 1), pick(i + 1, j + 1))
        })
        .collect();
    (w, h, out)
}

/// Mean over a square with fractional edges; `None` where any of it is not good.
fn box_mean(value: &[f32], width: usize, good: &impl Fn(usize) -> bool, x0: f64, y0: f64, size: f64) -> Option<f64> {
    let height = value.len() / width;
    let (mut sum, mut area) = (0.0, 0.0);
    for j in y0 as usize..((y0 + size).ceil() as usize).min(height) {
        for i in x0 as usize..((x0 + size).ceil() as usize).min(width) {
            let w = ((x0 + size).min(i as f64 + 1.0) - x0.max(i as f64)).max(0.0)
                * ((y0 + size).min(j as f64 + 1.0) - y0.max(j as f64)).max(0.0);
            if !good(j * width + i) {
                return None;
            }
            sum += w * f64::from(value[j * width + i]);
            area += w;
        }
    }
    (area > 0.0).then(|| sum / area)
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
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
    fn a_curve_is_as_fine_as_was_asked_and_no_finer() {
        let (sa, ss) = ([0.6, 0.4, 1.5], [12.0, 10.0, 9.0]);
        let ledger = Ledger::new();
        let mut last = 0;
        for allowed in [1e-2, 1e-3, 1e-4] {
            let c = curve(sa, ss, 0.1, 0.3, allowed, "t", &ledger);
            assert!(c.rho_d.len() > last);
            last = c.rho_d.len();
            // An independent look: points that are neither nodes nor midpoints.
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

    #[test]
    fn distant_leaves_take_coarser_maps_and_near_ones_do_not() {
        let (w, h) = (256, 128);
        let value: Vec<f32> = (0..w * h).map(|k| if (k % w / 3 + k / w / 5) % 2 == 0 { 0.3 } else { 0.5 }).collect();
        let near = map_levels(&value, w, h, |_| true, 0.7, 16);
        assert_eq!(near.len(), 1);
        let far = map_levels(&value, w, h, |_| true, 8.0, 16);
        assert_eq!(far.iter().map(|r| r.setting).collect::<Vec<_>>(), [1, 2, 4, 8, 16]);
        // Mips coarser than the pixel lose detail, finer ones are never looked at.
        assert!(
            far[..4].iter().all(|r| (r.error - far[0].error).abs() < 1e-6) && far[4].error > 1.5 * far[0].error,
            "{far:?}"
        );
        let uniform = map_levels(&vec![0.4; w * h], w, h, |_| true, 8.0, 16);
        assert!(uniform.iter().all(|r| r.error < 1e-6));
    }

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
