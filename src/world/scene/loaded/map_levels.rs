//! The error of uploading a map with a coarser resolution.

use crate::plan::accuracy::AccuracyRow;
use mesophyll_base::statistics::quantile;
use std::time::Instant;

/// Displayed error of a map that is uploaded as averages over blocks of 1, 2, 4 … texels. The map is sampled once for
/// each pixel through its mips (trilinear, as in the renderer), and compared with its mean over the pixel. `value`
/// holds the displayed map, and a pixel covers `footprint` texels along a side. The error is the 99th percentile over
/// pixels. Rows run from the finest (most expensive) to the coarsest.
pub fn map_levels(
    value: &[f32],
    width: usize,
    height: usize,
    good: impl Fn(usize) -> bool,
    footprint: f64,
    texel_bytes: u64,
) -> Vec<AccuracyRow> {
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
    // A few thousand pixels are enough for the percentile.
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
        // Mips need a third more.
        let bytes = (levels[base].width * levels[base].height) as u64 * texel_bytes * 4 / 3;
        rows.push(AccuracyRow {
            setting: 1 << base,
            error: quantile(&mut errors, 0.99).unwrap_or(0.0),
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

    /// `x` and `y` are in texels of this level, with texel centres at ½.
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

/// Joins blocks of two by two texels. An odd last row or column is paired with itself.
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

/// The mean over a square with fractional edges; `None` where any part of it is not good.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distant_leaves_take_coarser_maps_and_near_ones_do_not() {
        let (w, h) = (256, 128);
        let value: Vec<f32> = (0..w * h).map(|k| if (k % w / 3 + k / w / 5) % 2 == 0 { 0.3 } else { 0.5 }).collect();
        let near = map_levels(&value, w, h, |_| true, 0.7, 16);
        assert_eq!(near.len(), 1);
        let far = map_levels(&value, w, h, |_| true, 8.0, 16);
        assert_eq!(far.iter().map(|r| r.setting).collect::<Vec<_>>(), [1, 2, 4, 8, 16]);
        // With mips coarser than the pixel, detail is lost. Finer mips are never read.
        assert!(
            far[..4].iter().all(|r| (r.error - far[0].error).abs() < 1e-6) && far[4].error > 1.5 * far[0].error,
            "{far:?}"
        );
        let uniform = map_levels(&vec![0.4; w * h], w, h, |_| true, 8.0, 16);
        assert!(uniform.iter().all(|r| r.error < 1e-6));
    }
}
