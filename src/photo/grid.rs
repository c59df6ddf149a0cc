//! The grid of the maps: square texels of whole pixels of the front's picture.

use super::manifest::Manifest;
use super::picture::Picture;
use super::ruler::Scale;
use crate::Result;
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
    /// A place in the front's picture: the middle of pixel (a, b) of texel `k`.
    fn pixel(&self, k: usize, a: usize, b: usize) -> [f64; 2] {
        let [x, y] = [self.origin[0] + k % self.width * self.step + a, self.origin[1] + k / self.width * self.step + b];
        [x as f64 + 0.5, y as f64 + 0.5]
    }

    /// The middle of texel `k`.
    pub fn middle(&self, k: usize) -> [f64; 2] {
        let [x, y] = self.pixel(k, 0, 0);
        let half = 0.5 * (self.step as f64 - 1.0);
        [x + half, y + half]
    }

    /// The mean of `value` over the pixels of every texel that is asked for.
    pub fn mean(&self, wanted: &[bool], value: impl Fn([f64; 2]) -> [f64; 3] + Sync) -> Vec<[f64; 3]> {
        let n = (self.step * self.step) as f64;
        let texel = |k: usize| {
            let mut sum = [0.0; 3];
            for p in (0..self.step * self.step).map(|s| self.pixel(k, s % self.step, s / self.step)) {
                let v = value(p);
                (0..3).for_each(|c| sum[c] += v[c] / n);
            }
            sum
        };
        (0..wanted.len()).into_par_iter().map(|k| if wanted[k] { texel(k) } else { [f64::NAN; 3] }).collect()
    }

    /// How much sampling between pixels smooths a map away: [`BLUR`] times the map's second differences.
    pub fn blur(&self, map: &[[f64; 3]], k: usize, c: usize) -> f64 {
        let (w, at) = (self.width, |k: usize| map.get(k).map_or(f64::NAN, |v| v[c]));
        let bend = at(k + 1) + at(k.wrapping_sub(1)) + at(k + w) + at(k.wrapping_sub(w)) - 4.0 * at(k);
        if bend.is_finite() { BLUR * bend.abs() / (self.step * self.step) as f64 } else { 0.0 }
    }

    /// How much a map changes from one texel to the next, in the steeper of both directions.
    pub fn slope(&self, map: &[[f64; 3]], k: usize, c: usize) -> f64 {
        let (w, at) = (self.width, |k: usize| map.get(k).map_or(f64::NAN, |v| v[c]));
        let across = 0.5 * (at(k + 1) - at(k.wrapping_sub(1)));
        let down = 0.5 * (at(k + w) - at(k.wrapping_sub(w)));
        [across, down].into_iter().filter(|v| v.is_finite()).fold(0.0, |a: f64, v| a.max(v.abs()))
    }
}

/// A grid around the leaf of the front's picture.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) where the stated texel leaves fewer than 8 along the leaf.
pub(super) fn grid(folder: &Path, m: &Manifest, mask: &[bool], picture: &Picture, scale: Scale) -> Result<Grid> {
    let w = picture.width;
    let on = || mask.iter().enumerate().filter(|(_, m)| **m).map(|(k, _)| [k % w, k / w]);
    let low = [0, 1].map(|a: usize| on().map(|p| p[a]).min().unwrap_or(0));
    let high = [0, 1].map(|a: usize| on().map(|p| p[a]).max().unwrap_or(0));
    let longest = (high[0] - low[0]).max(high[1] - low[1]) + 1;
    let step = match m.texel_mm {
        None => longest.div_ceil(TEXELS).max(2),
        Some(texel) => ((texel / scale.pixel_mm).round() as usize).max(1),
    };
    if longest / step < 8 {
        let expected = format!("a length that divides the leaf's {:.1} mm", longest as f64 * scale.pixel_mm);
        return Err(Manifest::wrong(
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
