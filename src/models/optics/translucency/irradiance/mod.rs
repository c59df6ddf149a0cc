//! The light that enters a lit side: E(x, ω) = entry(x) · V(x, ω) · max(0, n(x)·ω), in units of the light's irradiance
//! at normal incidence, and its projection onto functions of direction. entry is the share of light that enters, V the
//! visibility and n the normal at texel x (H9 Eq. 3.13, which lacks the max).
//!
//! The projection and the convolution after it are both linear. So the images of the coefficients are summed here,
//! light by light, and each is convolved once. No image of a single light is ever stored. Values off the leaf are 0.

use super::basis::Projector;
use super::blade::LitSide;
use super::horizon::{Horizon, SLICES, SliceInterpolation};
use rayon::prelude::*;

/// How the light's elevation is compared with the horizon's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Visibility {
    /// The light is either above or below the horizon (H9 §3.3.9).
    #[default]
    Hard,
    /// A linear ramp about the horizon, `width` wide in the sine of elevation. It is the share of an extended light
    /// (the sun: .0093), or of a light's cell, that is above the horizon.
    Soft {
        /// Width of the ramp, in the sine of elevation.
        width: f64,
    },
    /// Nothing is shadowed.
    Off,
}

/// One light's slices and ramp. The same arithmetic serves one direction, one direction a texel, and projections.
#[derive(Clone, Copy)]
struct Light {
    direction: [f64; 3],
    between: SliceInterpolation,
    /// V = clamp(gain·(z − h) + ½, 0, 1), or z > h where the gain is infinite.
    visibility: Visibility,
}

impl Light {
    fn new(direction: [f64; 3], visibility: Visibility) -> Light {
        let visibility = match visibility {
            Visibility::Soft { width } if !(width > 0.0) => Visibility::Hard,
            other => other,
        };
        Light { direction, between: SliceInterpolation::of(direction), visibility }
    }

    /// V·max(0, n·ω), with the sines of the horizon in the two slices beside the light.
    #[inline(always)]
    fn falls(&self, normal: [f64; 3], low: f64, high: f64) -> f64 {
        let w = self.direction;
        let cosine = (normal[0] * w[0] + normal[1] * w[1] + normal[2] * w[2]).max(0.0);
        let above = w[2] - (low + self.between.fraction * (high - low));
        match self.visibility {
            Visibility::Hard => {
                if above > 0.0 {
                    cosine
                } else {
                    0.0
                }
            }
            Visibility::Soft { width } => cosine * (above / width + 0.5).clamp(0.0, 1.0),
            Visibility::Off => cosine,
        }
    }
}

/// E with one direction for each texel: `direction(texel)` is the direction to the light in that texel's frame of the
/// lit side (for curved blades). Light from above has z > 0; light from below does not enter.
pub fn irradiance_with(
    lit: &LitSide,
    horizon: &Horizon,
    visibility: Visibility,
    direction: impl Fn(usize) -> [f64; 3] + Sync,
) -> Vec<f64> {
    let texel = |k: usize| {
        if !lit.mask[k] {
            return 0.0;
        }
        let light = Light::new(direction(k), visibility);
        let [a, b] = light.between.slices.map(|s| f64::from(horizon.slice(s)[k]));
        lit.surface.entry[k] * from_above(light.direction, light.falls(lit.surface.normal[k], a, b))
    };
    (0..lit.width * lit.height).into_par_iter().with_min_len(1024).map(texel).collect()
}

/// E for one direction of the lit side's frame.
pub fn irradiance(lit: &LitSide, horizon: &Horizon, direction: [f64; 3], visibility: Visibility) -> Vec<f64> {
    irradiance_with(lit, horizon, visibility, |_| direction)
}

fn from_above(direction: [f64; 3], e: f64) -> f64 {
    if direction[2] > 0.0 { e } else { 0.0 }
}

/// The coefficients' images of E over the projector's lights: image i holds Σ_m matrix\[i\]\[m\] E(x, ω_m).
pub fn project(lit: &LitSide, horizon: &Horizon, projector: &Projector, visibility: Visibility) -> Vec<Vec<f64>> {
    let (w, count) = (lit.width, projector.count());
    let lights: Vec<Light> = projector.directions.iter().map(|d| Light::new(*d, visibility)).collect();
    rows(lit, count, |row, scratch, sums| {
        scratch.read(lit, horizon, row);
        let Scratch { normal, sines, falls } = scratch;
        for (m, light) in lights.iter().enumerate().filter(|(_, l)| l.direction[2] > 0.0) {
            let [low, high] = light.between.slices.map(|s| &sines[s * w..(s + 1) * w]);
            let [nx, ny, nz] = &normal;
            // There is one loop for each kind of visibility, without branches inside.
            let mut each = |f: &dyn Fn([f64; 3], f64, f64) -> f64| {
                for x in 0..w {
                    falls[x] = f([nx[x], ny[x], nz[x]], low[x], high[x]);
                }
            };
            each(&|n, a, b| light.falls(n, a, b));
            for (sum, row) in sums.chunks_mut(w).zip(&projector.matrix) {
                let p = row[m];
                sum.iter_mut().zip(&*falls).for_each(|(s, e)| *s += p * e);
            }
        }
    })
}

/// The maps of one row, each contiguous.
struct Scratch {
    normal: [Vec<f64>; 3],
    sines: Vec<f64>,
    falls: Vec<f64>,
}

impl Scratch {
    fn new(w: usize) -> Scratch {
        Scratch {
            normal: [vec![0.0; w], vec![0.0; w], vec![0.0; w]],
            sines: vec![0.0; SLICES * w],
            falls: vec![0.0; w],
        }
    }

    fn read(&mut self, lit: &LitSide, horizon: &Horizon, row: usize) {
        let w = lit.width;
        for (x, n) in lit.surface.normal[row * w..(row + 1) * w].iter().enumerate() {
            (0..3).for_each(|c| self.normal[c][x] = n[c]);
        }
        for s in 0..SLICES {
            self.sines[s * w..(s + 1) * w]
                .iter_mut()
                .zip(horizon.row(s, row))
                .for_each(|(to, from)| *to = f64::from(*from));
        }
    }
}

/// The images that `fill` sums for each row (one image after another in its buffer), times entry; 0 off the leaf.
fn rows(lit: &LitSide, count: usize, fill: impl Fn(usize, &mut Scratch, &mut [f64]) + Sync) -> Vec<Vec<f64>> {
    let (w, h) = (lit.width, lit.height);
    if w * h == 0 || count == 0 {
        return vec![Vec::new(); count];
    }
    let mut sums = vec![0.0; w * h * count];
    sums.par_chunks_mut(w * count).enumerate().for_each_init(
        || Scratch::new(w),
        |scratch, (row, sums)| {
            if !lit.mask[row * w..(row + 1) * w].contains(&true) {
                return;
            }
            fill(row, scratch, sums);
            for image in sums.chunks_mut(w) {
                for (x, s) in image.iter_mut().enumerate() {
                    let k = row * w + x;
                    *s = if lit.mask[k] { *s * lit.surface.entry[k] } else { 0.0 };
                }
            }
        },
    );
    let gather = |i: usize| sums.chunks(w * count).flat_map(|row| row[i * w..(i + 1) * w].iter().copied()).collect();
    (0..count).into_par_iter().map(gather).collect()
}

#[cfg(test)]
mod tests;
