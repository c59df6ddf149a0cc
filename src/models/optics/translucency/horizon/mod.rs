//! Horizon maps (Max 1988; H9 §3.3.9): the height of the horizon that the surrounding relief forms around every texel,
//! in 16 slices of azimuth.
//!
//! A slice holds the mean sine of the horizon's elevation over its azimuths. The sine is used because 1 − sin is the
//! solid angle that stays open, so the mean keeps the slice's share of the sky. Between the centres of the slices the
//! value is interpolated linearly. Slice k is centred on azimuth 2πk/16 from x towards y. The value is never below 0,
//! the tangent plane: where the surface tilts away from the light, the cosine of its normal accounts for that. There is
//! nothing outside the leaf, so its edge casts no horizon. Heights are in units of the texel's physical size; the reach
//! is unlimited.
//!
//! **Method.** Along each azimuth that is sampled in a slice, the heights are read on parallel lines one texel apart
//! (linear between rows, or between columns for steep lines). Each line is swept once with the upper convex hull of the
//! samples passed so far (Timonen & Westerholm 2010). So every texel takes the same time, whatever the reach. Profiles
//! between samples are straight.

use super::blade::LitSide;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Slices of azimuth (H9 §3.3.9).
pub const SLICES: usize = 16;

/// Number of azimuths that are sampled in a slice by default, evenly about its centre.
pub(crate) const LINES: usize = 2;

/// Mean sines of the horizon's elevation, [`SLICES`] maps of `width · height`, slice after slice; 0 off the leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct Horizon {
    /// Texels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    sines: Vec<f32>,
}

/// Where an azimuth lies between the slices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SliceInterpolation {
    /// The slices on either side of the azimuth.
    pub slices: [usize; 2],
    /// Weight of the second slice.
    pub fraction: f64,
}

impl SliceInterpolation {
    /// The slices beside the azimuth of a direction. Straight above there is no azimuth, and any slices will do.
    pub fn of(direction: [f64; 3]) -> SliceInterpolation {
        let place = (direction[1].atan2(direction[0]) / TAU).rem_euclid(1.0) * SLICES as f64;
        let low = place.floor();
        SliceInterpolation { slices: [low as usize % SLICES, (low as usize + 1) % SLICES], fraction: place - low }
    }
}

impl Horizon {
    /// No relief: nothing stands above any texel.
    pub fn level(width: usize, height: usize) -> Horizon {
        Horizon { width, height, sines: vec![0.0; SLICES * width * height] }
    }

    /// The horizons of a lit side with [`LINES`] azimuths a slice.
    pub fn new(lit: &LitSide) -> Horizon {
        Horizon::sampled(lit, LINES)
    }

    /// The same with another number of azimuths in a slice (at least 1; 1 is only the slice's centre).
    pub fn sampled(lit: &LitSide, lines: usize) -> Horizon {
        let (width, height, lines) = (lit.width, lit.height, lines.max(1));
        let mut out = Horizon::level(width, height);
        let n = width * height;
        if n == 0 {
            return out;
        }
        let mut relief = Relief::new(lit);
        let share = 1.0 / lines as f32;
        let step = TAU / SLICES as f64;
        // Opposite azimuths share their lines.
        for k in 0..SLICES / 2 {
            for line in 0..lines {
                let both = relief.both(step * (k as f64 + (line as f64 + 0.5) / lines as f64 - 0.5));
                for (slice, found) in [k, k + SLICES / 2].into_iter().zip(both) {
                    let plane = &mut out.sines[slice * n..(slice + 1) * n];
                    plane.par_chunks_mut(width).zip(found.par_chunks(width)).for_each(|(to, from)| {
                        to.iter_mut().zip(from).for_each(|(t, f)| *t += share * f);
                    });
                }
            }
        }
        out
    }

    /// Slice `k` of all texels.
    pub fn slice(&self, k: usize) -> &[f32] {
        let n = self.width * self.height;
        &self.sines[k * n..(k + 1) * n]
    }

    /// Slice `k` of one row.
    pub fn row(&self, k: usize, row: usize) -> &[f32] {
        &self.slice(k)[row * self.width..(row + 1) * self.width]
    }

    /// Sine of the horizon's elevation at a texel in the azimuth of a direction.
    pub fn sine(&self, texel: usize, between: SliceInterpolation) -> f64 {
        let [a, b] = between.slices.map(|k| f64::from(self.slice(k)[texel]));
        a + between.fraction * (b - a)
    }
}

/// Sines of the horizon's elevation in one azimuth from x towards y (rad), one for each texel: the values that the
/// slices approximate.
pub fn towards(lit: &LitSide, azimuth: f64) -> Vec<f32> {
    if lit.width * lit.height == 0 {
        return Vec::new();
    }
    let mut relief = Relief::new(lit);
    let [found, _] = relief.both(azimuth);
    found.to_vec()
}

/// Heights in units of texels, so that slopes are right (NaN where there is no leaf), stored upright and transposed,
/// and the buffers of the sweeps over them.
struct Relief {
    width: usize,
    height: usize,
    upright: Vec<f32>,
    lying: Vec<f32>,
    sweep: Sweep,
    ahead: Vec<f32>,
    behind: Vec<f32>,
    turned: [Vec<f32>; 2],
}

impl Relief {
    fn new(lit: &LitSide) -> Relief {
        let (width, height, n) = (lit.width, lit.height, lit.width * lit.height);
        let in_texels = |(z, on): (&f64, &bool)| if *on { (z / lit.texel_mm) as f32 } else { f32::NAN };
        let upright: Vec<f32> = lit.surface.height.iter().zip(lit.mask.iter()).map(in_texels).collect();
        let mut lying = vec![0f32; n];
        transpose(&upright, width, height, &mut lying);
        let empty = || vec![0f32; n];
        Relief {
            width,
            height,
            upright,
            lying,
            sweep: Sweep::default(),
            ahead: empty(),
            behind: empty(),
            turned: [empty(), empty()],
        }
    }

    /// Sines of the horizons in an azimuth and in the opposite one.
    fn both(&mut self, azimuth: f64) -> [&[f32]; 2] {
        // Rows run downwards.
        let (dx, dy) = (azimuth.cos(), -azimuth.sin());
        let steep = dy.abs() > dx.abs();
        let (map, w, h, slope, along) = if steep {
            (&self.lying, self.height, self.width, dx / dy, dy)
        } else {
            (&self.upright, self.width, self.height, dy / dx, dx)
        };
        self.sweep.run(map, w, h, slope, &mut self.ahead, &mut self.behind);
        if steep {
            transpose(&self.ahead, w, h, &mut self.turned[0]);
            transpose(&self.behind, w, h, &mut self.turned[1]);
        }
        let [ahead, behind] = if steep { [&self.turned[0], &self.turned[1]] } else { [&self.ahead, &self.behind] };
        // `ahead` looks towards larger columns of the map that is swept.
        if along > 0.0 { [ahead, behind] } else { [behind, ahead] }
    }
}

/// The buffers of a sweep in one direction.
#[derive(Default)]
struct Sweep {
    ahead: Vec<f32>,
    behind: Vec<f32>,
}

/// Marks a place on a line where there is no leaf.
const NOTHING: f32 = -1.0;

impl Sweep {
    /// Sines of the horizons of a map's texels (NaN where there is no leaf) along lines that fall by `slope` rows a
    /// column, |slope| ≤ 1. `ahead` looks towards larger columns, `behind` towards smaller ones; both are 0 where there
    /// is no leaf.
    fn run(&mut self, map: &[f32], w: usize, h: usize, slope: f64, ahead: &mut [f32], behind: &mut [f32]) {
        // Line ℓ is at row ℓ + slope·(column − middle), so that a mirrored map is sampled in the same way. Lines run
        // from the first to the last that comes within a row of the map.
        let middle = 0.5 * (w - 1) as f64;
        let drift = (slope * middle).abs();
        let first = (-drift).floor() as i64 - 1;
        let lines = (h as f64 + drift).ceil() as i64 + 1 - first;
        let size = lines as usize * w;
        self.ahead.resize(size.max(self.ahead.len()), NOTHING);
        self.behind.resize(size.max(self.behind.len()), NOTHING);
        let stride = (1.0 + slope * slope).sqrt() as f32;
        let (forth, back) = (&mut self.ahead[..size], &mut self.behind[..size]);
        forth.par_chunks_mut(w).zip(back.par_chunks_mut(w)).enumerate().for_each_init(
            Line::default,
            |line, (index, (forth, back))| {
                line.read(map, w, h, (first + index as i64) as f64 - slope * middle, slope);
                back.fill(NOTHING);
                forth.fill(NOTHING);
                line.horizons(stride, forth, back);
            },
        );
        // Back to the texels, each of which lies between two lines.
        ahead.par_chunks_mut(w).zip(behind.par_chunks_mut(w)).enumerate().for_each(|(row, (ahead, behind))| {
            for c in 0..w {
                let place = row as f64 - slope * (c as f64 - middle) - first as f64;
                let low = place.floor();
                let f = (place - low) as f32;
                let at = low as usize * w + c;
                let there = !map[row * w + c].is_nan();
                ahead[c] = if there { sine(blend(forth[at], forth[at + w], f)) } else { 0.0 };
                behind[c] = if there { sine(blend(back[at], back[at + w], f)) } else { 0.0 };
            }
        });
    }
}

/// A value between those of two lines. Where one line found no leaf, the other's value is taken.
fn blend(a: f32, b: f32, f: f32) -> f32 {
    match (a >= 0.0, b >= 0.0) {
        (true, true) => a + f * (b - a),
        (true, false) => a,
        (false, true) => b,
        (false, false) => 0.0,
    }
}

/// Sine of the elevation whose tangent is t.
fn sine(t: f32) -> f32 {
    t / (1.0 + t * t).sqrt()
}

/// The heights on one line, and the hull.
#[derive(Default)]
struct Line {
    /// Column and height of the samples on the leaf.
    samples: Vec<(f32, f32)>,
    hull: Vec<(f32, f32)>,
}

impl Line {
    fn read(&mut self, map: &[f32], w: usize, h: usize, start: f64, slope: f64) {
        self.samples.clear();
        for c in 0..w {
            let y = start + slope * c as f64;
            let low = y.floor();
            if low < -1.0 || low > (h - 1) as f64 {
                continue;
            }
            let f = (y - low) as f32;
            let at = |row: f64| if (0.0..h as f64).contains(&row) { map[row as usize * w + c] } else { f32::NAN };
            let (a, b) = (at(low), at(low + 1.0));
            let z = match (a.is_nan(), b.is_nan()) {
                (false, false) => a + f * (b - a),
                // At the edge the nearer row decides.
                (false, true) if f <= 0.5 => a,
                (true, false) if f >= 0.5 => b,
                _ => continue,
            };
            self.samples.push((c as f32, z));
        }
    }

    /// Tangents of the horizon towards larger columns and towards smaller ones, at the samples' columns. `stride`: the
    /// distance in texels from one column to the next.
    fn horizons(&mut self, stride: f32, forth: &mut [f32], back: &mut [f32]) {
        self.hull.clear();
        for &p in self.samples.iter().rev() {
            forth[p.0 as usize] = rise(&mut self.hull, p) / stride;
        }
        self.hull.clear();
        for &(c, z) in &self.samples {
            back[c as usize] = rise(&mut self.hull, (-c, z)) / stride;
        }
    }
}

/// Slope from p to the sample that stands highest of those passed (at least 0). The samples passed all have larger
/// first coordinates. p joins their upper hull, in which the nearest sample comes last.
#[inline]
fn rise(hull: &mut Vec<(f32, f32)>, p: (f32, f32)) -> f32 {
    while let [.., b, a] = hull[..] {
        // The nearer sample stays only where it stands higher than the one behind it.
        if (a.1 - p.1) * (b.0 - p.0) <= (b.1 - p.1) * (a.0 - p.0) {
            hull.pop();
        } else {
            break;
        }
    }
    let slope = hull.last().map_or(0.0, |a| ((a.1 - p.1) / (a.0 - p.0)).max(0.0));
    hull.push(p);
    slope
}

/// `map` has `height` rows of `width`; `out` gets `width` rows of `height`. In blocks, for the cache.
fn transpose(map: &[f32], width: usize, height: usize, out: &mut [f32]) {
    const BLOCK: usize = 32;
    out.par_chunks_mut(BLOCK * height).enumerate().for_each(|(band, out)| {
        let left = band * BLOCK;
        let columns = out.len() / height;
        for top in (0..height).step_by(BLOCK) {
            for c in 0..columns {
                for r in top..(top + BLOCK).min(height) {
                    out[c * height + r] = map[r * width + left + c];
                }
            }
        }
    });
}

#[cfg(test)]
mod tests;
