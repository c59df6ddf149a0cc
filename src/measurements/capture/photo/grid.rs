//! The grid of the maps: square texels of whole pixels of the front's picture.

use super::manifest::PhotoManifest;
use super::picture::LinearPhotograph;
use super::ruler::PictureScale;
use crate::photo::Result;
use mesophyll_base::image::ImageSize;
use mesophyll_base::rgb::Rgb;
use rayon::prelude::*;
use std::path::Path;

/// Texels along the longer side of the leaf where `texel_mm` is not stated. A texel has two pixels at least each way,
/// because a pixel of a photograph also shows its neighbours.
const TEXELS: usize = 720;
/// Texels around the leaf.
const MARGIN: usize = 3;
/// What smoothing took from a map, over the second differences of what it left. A camera's lens and sampling between
/// pixels smooth by 1/6 pixel² each along either axis (a straight line between two pixels at u of the way smooths by
/// u(1 − u), 1/6 on average). Half of both, 1/6, is the first term of a series; the finest detail that a camera still
/// shows makes the rest of the series about as large.
const BLUR: f64 = 1.0 / 3.0;

/// The maps' grid over the front's picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    /// Pixel of the front's picture at the upper left.
    pub origin: [usize; 2],
    /// Pixels a texel, each way.
    pub step: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Grid {
    /// Columns and rows.
    pub fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    /// The middle of texel `k`, in the front's picture.
    pub fn middle(&self, k: usize) -> [f64; 2] {
        let at = self.size().position(k);
        [0, 1].map(|a| (self.origin[a] + at[a] * self.step) as f64 + 0.5 * self.step as f64)
    }

    /// Places each way at which a texel is read in a picture of which a pixel of the front covers `scale` pixels each
    /// way: no fewer than it has pixels there.
    fn places(&self, scale: f64) -> usize {
        self.step.max((self.step as f64 * scale - 1e-9).ceil() as usize)
    }

    /// How many pixels a side a square has whose mean is as noisy as a texel's, in a picture of which a pixel of the
    /// front covers `scale` pixels each way and which is weighted linearly between pixels. Two places at the distance d
    /// then share B(d) of a pixel's variance in each direction, B being the cubic B-spline, which is the triangle's
    /// correlation with itself.
    pub fn read(&self, scale: f64) -> f64 {
        let n = self.places(scale);
        let apart = self.step as f64 * scale / n as f64;
        let spline = |d: f64| {
            if d < 1.0 { 2.0 / 3.0 - d * d + 0.5 * d.powi(3) } else { (2.0 - d).max(0.0).powi(3) / 6.0 }
        };
        let pairs = (1..n).map(|k| 2.0 * (n - k) as f64 * spline(k as f64 * apart)).sum::<f64>();
        (n * n) as f64 / (n as f64 * spline(0.0) + pairs)
    }

    /// The mean of `value` over every texel that is asked for. `value` takes a place in the front's picture and reads
    /// another one, of which a pixel of the front covers `scale` pixels each way; every pixel is read.
    pub fn mean(&self, wanted: &[bool], scale: f64, value: impl Fn([f64; 2]) -> Rgb + Sync) -> Vec<Rgb> {
        let side = self.places(scale);
        let (n, each) = ((side * side) as f64, self.step as f64 / side as f64);
        let texel = |k: usize| {
            let mut sum = Rgb::splat(0.0);
            let [x, y] = self.middle(k).map(|v| v - 0.5 * self.step as f64);
            for s in 0..side * side {
                sum += value([x + ((s % side) as f64 + 0.5) * each, y + ((s / side) as f64 + 0.5) * each]) / n;
            }
            sum
        };
        (0..wanted.len()).into_par_iter().map(|k| if wanted[k] { texel(k) } else { Rgb::splat(f64::NAN) }).collect()
    }

    /// How much a camera's lens and sampling between pixels smooth a map away: [`BLUR`] times the map's second
    /// differences. `scale` is the size of a pixel of the front in pixels of the picture.
    pub fn blur(&self, map: &[Rgb], k: usize, c: usize, scale: f64) -> f64 {
        let (w, at) = (self.width, |k: usize| map.get(k).map_or(f64::NAN, |v| v[c]));
        let bend = at(k + 1) + at(k.wrapping_sub(1)) + at(k + w) + at(k.wrapping_sub(w)) - 4.0 * at(k);
        if bend.is_finite() { BLUR * bend.abs() / (self.step as f64 * scale).powi(2) } else { 0.0 }
    }

    /// How much a map changes from a texel to its neighbours: the larger step along either axis, both axes together. A
    /// map that lies askew by a share of a texel shows that share of it. (The difference of the neighbours on both
    /// sides would not do: it is nothing on a vein.)
    pub fn slope(&self, map: &[Rgb], k: usize, c: usize) -> f64 {
        let (w, at) = (self.width, |k: usize| map.get(k).map_or(f64::NAN, |v| v[c]));
        let larger = |a: usize, b: usize| {
            let steps = [at(a) - at(k), at(b) - at(k)];
            steps.into_iter().filter(|v| v.is_finite()).fold(0.0, |a: f64, v| a.max(v.abs()))
        };
        larger(k + 1, k.wrapping_sub(1)).hypot(larger(k + w, k.wrapping_sub(w)))
    }
}

/// A grid around the leaf of the front's picture.
///
/// # Errors
/// [`Error::Input`](crate::photo::Error::Input) where the stated texel leaves fewer than 8 along the leaf.
pub(super) fn grid(
    folder: &Path,
    m: &PhotoManifest,
    mask: &[bool],
    picture: &LinearPhotograph,
    scale: PictureScale,
) -> Result<Grid> {
    let on = || mask.iter().enumerate().filter(|(_, m)| **m).map(|(k, _)| picture.size().position(k));
    let low = [0, 1].map(|a: usize| on().map(|p| p[a]).min().unwrap_or(0));
    let high = [0, 1].map(|a: usize| on().map(|p| p[a]).max().unwrap_or(0));
    let longest = (high[0] - low[0]).max(high[1] - low[1]) + 1;
    let step = match m.texel_mm {
        None => longest.div_ceil(TEXELS).max(2),
        Some(texel) => ((texel / scale.pixel_mm).round() as usize).max(1),
    };
    if longest / step < 8 {
        let expected = format!("a length that divides the leaf's {:.1} mm", longest as f64 * scale.pixel_mm);
        return Err(PhotoManifest::wrong(
            folder,
            "texel_mm",
            m.texel_mm.unwrap_or(0.0),
            expected + " into 8 texels or more",
        ));
    }
    let origin = low.map(|v| v.saturating_sub(MARGIN * step));
    let [width, height] = [0, 1].map(|a: usize| (high[a] + 1 - origin[a]).div_ceil(step) + MARGIN);
    Ok(Grid { origin, step, width, height })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::random::RandomStream;

    /// White noise in a picture that is further away, as near, and three times as near as the front's, and turned a
    /// little: means over texels scatter by what a square of [`Grid::read`] pixels does.
    #[test]
    fn means_over_texels_are_as_noisy_as_said() {
        let (w, h) = (900, 900);
        let mut stream = RandomStream::new(7, &[1]);
        let pixels: Vec<Rgb<f32>> = (0..w * h).map(|_| Rgb::of(|_| stream.normal_pair()[0] as f32)).collect();
        let picture =
            LinearPhotograph { path: "noise.exr".into(), width: w, height: h, pixels, highest: (9.0, 1), steps: None };
        for (step, scale) in [(2, 0.5), (1, 1.0), (2, 1.0), (4, 0.9), (2, 3.0)] {
            let grid = Grid { origin: [8, 8], step, width: 60, height: 60 };
            let (sin, cos) = 0.07f64.sin_cos();
            let at = |[x, y]: [f64; 2]| [scale * (cos * x - sin * y) + 60.0, scale * (sin * x + cos * y) + 5.0];
            let found = grid.mean(&vec![true; 3600], scale, |p| picture.at(at(p)));
            let values: Vec<f64> = found.iter().flatten().copied().collect();
            let sd = (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
            println!("step {step}, scale {scale}: {sd:.4}, said {:.4}", 1.0 / grid.read(scale));
            assert!(
                (sd * grid.read(scale) - 1.0).abs() < 0.06,
                "step {step}, scale {scale}: {sd} {}",
                grid.read(scale)
            );
        }
    }
}
