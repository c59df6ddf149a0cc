//! Motion textures: periodic two-channel noise. A straight line through it gives the swaying of a branch (H9
//! §4.5.2–4.5.3).
//!
//! Channel 0 drives the deflection towards r, channel 1 towards s. They are two independent fields with one spectrum:
//! the real and the imaginary part of one inverse FFT. Values have the unit whose power density the spectrum states
//! (for [`super::wind::Sway`], tip deflection over length); they are not normalised. The same seed gives the same
//! texture.
//!
//! Isotropic textures ([`SpectrumMethod::Plain`], [`SpectrumMethod::InverseAbel`]) may be crossed in any direction, as
//! leaves do, but they cannot represent a sharp resonance. [`SpectrumMethod::Directed`] can, for lines nearly along x:
//! one line for each branch, far enough apart in y.
//!
//! A cycle of the highest frequency f_max takes 8 texels, so that the hardware's linear filter is good enough (it
//! removes 10 % of the power there; directed textures compensate for it). A texture of n texels a side then contains
//! frequencies down to f_min = 8 f_max/n. (The print has f_max/(8 n).)

use super::motion_spectrum::{SpectrumMethod, SpectrumRings};
use mesophyll_base::fourier::Complex;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Texels in a cycle of the highest frequency.
pub const TEXELS_A_CYCLE: usize = 8;

/// A texture of `size` × `size` texels, row by row, texel centres at (i + ½)/size.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionTexture {
    /// Texels along each edge.
    pub size: usize,
    /// Lowest frequency that it contains (Hz), for a line at [`MotionTexture::speed`].
    pub lowest: f64,
    /// The highest frequency (Hz).
    pub highest: f64,
    /// Displacements towards r and s, a texel each, row by row.
    pub values: Vec<[f32; 2]>,
    /// How the texture was made.
    pub method: SpectrumMethod,
}

/// The four texels around a place in a texture, and where the place is among them. [`MotionTexture::sample`] does all
/// at once; who reads at many places works out all cells first and then reads them, so that memory is waited for only
/// once.
#[derive(Debug, Clone, Copy)]
pub struct TextureCell {
    texels: [usize; 4],
    share: [f64; 2],
}

impl TextureCell {
    /// The values of the four texels, linearly filtered.
    pub fn between(&self, texels: &[[f32; 2]; 4]) -> [f64; 2] {
        let [fx, fy] = self.share;
        [0, 1].map(|k| {
            let [a, b, c, d] = texels.map(|v| f64::from(v[k]));
            let (low, high) = (a * (1.0 - fx) + b * fx, c * (1.0 - fx) + d * fx);
            low * (1.0 - fy) + high * fy
        })
    }
}

/// Texels in a cycle of the highest frequency along y of a directed texture.
const TEXELS_ACROSS: usize = 16;
/// In each passage a line through a directed texture climbs by one of the texture's independent rows, and by up to this
/// share more. Rows that are one climb apart are independent, and the line meets its first row again only after as many
/// passages as there are rows. This smears the frequencies along the line by slope times cycles along y: at most about
/// half a frequency step of the texture.
const UNEVEN: f64 = 0.03;

/// Cycles along y of a directed texture: from minus this to this; its independent rows are one more than twice this.
fn across(size: usize) -> i64 {
    (size / TEXELS_ACROSS) as i64
}

/// A line through a texture: where a branch is at time t (s), in texture units (wrapped).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trajectory {
    /// Place at time 0, in texture units.
    pub start: [f64; 2],
    /// Texture units a second.
    pub velocity: [f64; 2],
}

impl Trajectory {
    /// A line in any direction; every `seed` gives another one. `speed` is [`MotionTexture::speed`]. Directions whose
    /// slope is near a ratio of small whole numbers are not used, because such lines soon repeat.
    pub fn new(seed: u64, speed: f64) -> Trajectory {
        let mut rng = Pcg64::seed_from_u64(seed);
        let start = [rng.random::<f64>(), rng.random::<f64>()];
        let mut angle = 0.3;
        for _ in 0..64 {
            angle = TAU * rng.random::<f64>();
            if !nearly_rational(angle) {
                break;
            }
        }
        Trajectory { start, velocity: [speed * angle.cos(), speed * angle.sin()] }
    }

    /// A line for a directed texture of `size` texels: nearly along x.
    fn along(seed: u64, speed: f64, size: usize) -> Trajectory {
        let mut rng = Pcg64::seed_from_u64(seed);
        let start = [rng.random::<f64>(), rng.random::<f64>()];
        let climb = (1.0 + UNEVEN * rng.random::<f64>()) / (2 * across(size) + 1) as f64;
        let slope = if rng.random::<f64>() < 0.5 { -climb } else { climb };
        Trajectory { start, velocity: [speed, speed * slope] }
    }

    /// Place at time `t` (s), in texture units, wrapped to 0..1. It may round to 1.
    pub fn at(&self, t: f64) -> [f64; 2] {
        [0, 1].map(|k| wrapped(self.start[k] + t * self.velocity[k]))
    }
}

/// A place in texture units, wrapped to 0..1. It may round to 1.
fn wrapped(place: f64) -> f64 {
    place - place.floor()
}

/// Whether a direction is within 0.01 rad of one with whole-number components up to 4.
fn nearly_rational(angle: f64) -> bool {
    (-4i32..=4).any(|p| {
        (-4i32..=4).any(|q| {
            let off = (angle - f64::from(p).atan2(f64::from(q))).rem_euclid(TAU);
            (p, q) != (0, 0) && off.min(TAU - off) < 0.01
        })
    })
}

impl MotionTexture {
    /// Speed (texture units a second) at which a line has the texture's frequencies. A branch whose own resonance is f
    /// instead of the texture's f_h moves f/f_h times as fast (H9 "Branch frequencies"). Its density is then f_h/f
    /// times the wanted one, at f/f_h times the frequency.
    pub fn speed(&self) -> f64 {
        self.lowest
    }

    /// A texture whose lines have the `spectrum` (one-sided power density over Hz) from `highest`·8/`size` up to
    /// `highest` (Hz). `size` is at least 32 texels; powers of two are fastest. `None` for a smaller size, a `highest`
    /// that is not positive, or a spectrum that is not positive and finite there.
    pub fn new(
        spectrum: impl Fn(f64) -> f64,
        highest: f64,
        size: usize,
        seed: u64,
        method: SpectrumMethod,
    ) -> Option<MotionTexture> {
        if size < 32 || !(highest > 0.0 && highest.is_finite()) {
            return None;
        }
        let count = size / TEXELS_A_CYCLE;
        let lowest = highest / count as f64;
        if !(1..=count).all(|j| (f64::MIN_POSITIVE..f64::MAX).contains(&spectrum(j as f64 * lowest))) {
            return None;
        }
        // Two-sided density of a line along x, for each unit of the wave number k, over the waves across.
        let across = across(size);
        let directed: Vec<f64> =
            (1..=count).map(|j| 0.5 * lowest * spectrum(j as f64 * lowest) / (2 * across + 1) as f64).collect();
        // The share of the power of a wave of k cycles that the linear filter leaves: sinc⁴(k/size). A directed texture
        // compensates for it.
        let filtered = |k: i64| {
            let x = std::f64::consts::PI * k as f64 / size as f64;
            if x == 0.0 { 1.0 } else { (x.sin() / x).powi(4) }
        };
        let rings = SpectrumRings::new(spectrum, lowest, count, method);
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut field = vec![Complex::new(0.0, 0.0); size * size];
        let reach = count as i64;
        for row in -reach..=reach {
            for column in -reach..=reach {
                let ring = match method {
                    SpectrumMethod::Directed if row.abs() > across => 0,
                    SpectrumMethod::Directed => column.unsigned_abs() as usize,
                    _ => ((row * row + column * column) as f64).sqrt().round() as usize,
                };
                // It is drawn for every place, so that the pattern of phases is the same when the spectrum changes.
                let angle = TAU * rng.random::<f64>();
                if ring == 0 || ring > count {
                    continue;
                }
                // Phases are random, sizes are fixed. So each part of the sum has the variance Σ Φ whatever the draw,
                // and the sum of this many waves is Gaussian. (H9 Eq. 4.18 also draws the sizes; then the spectrum of a
                // single texture scatters.)
                let density = match method {
                    SpectrumMethod::Directed => directed[ring - 1] / (filtered(row) * filtered(column)),
                    _ => rings.0[ring - 1],
                };
                let size_of = (2.0 * density).sqrt();
                let at = |k: i64| k.rem_euclid(size as i64) as usize;
                field[at(row) * size + at(column)] = Complex::from_polar(size_of, angle);
            }
        }
        inverse_transform(&mut field, size);
        Some(MotionTexture {
            size,
            lowest,
            highest,
            values: field.iter().map(|c| [c.re as f32, c.im as f32]).collect(),
            method,
        })
    }

    /// The line of branch number `seed` through this texture, at [`MotionTexture::speed`] times `faster` (1, or the
    /// branch's resonance over the texture's).
    pub fn trajectory(&self, seed: u64, faster: f64) -> Trajectory {
        let speed = faster * self.speed();
        if self.method == SpectrumMethod::Directed {
            Trajectory::along(seed, speed, self.size)
        } else {
            Trajectory::new(seed, speed)
        }
    }

    /// Both channels at a place in texture units, wrapped and linearly filtered as a sampler with repeat addressing
    /// does.
    pub fn sample(&self, at: [f64; 2]) -> [f64; 2] {
        let cell = self.cell(at);
        cell.between(&self.texels(&cell))
    }

    /// The texels around a place in texture units.
    pub fn cell(&self, at: [f64; 2]) -> TextureCell {
        let n = self.size;
        let [(x0, x1, fx), (y0, y1, fy)] = at.map(|c| {
            let c = wrapped(c) * n as f64 + 0.5;
            // The texel after the place; the first one comes after the last.
            let after = (c as usize).min(n);
            (if after == 0 { n - 1 } else { after - 1 }, if after == n { 0 } else { after }, c - after as f64)
        });
        TextureCell { texels: [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| y * n + x), share: [fx, fy] }
    }

    /// Both channels of a cell's texels.
    pub fn texels(&self, cell: &TextureCell) -> [[f32; 2]; 4] {
        cell.texels.map(|k| self.values[k])
    }

    /// Root mean square of both channels over the texture.
    pub fn rms(&self) -> [f64; 2] {
        [0, 1].map(|k| {
            (self.values.iter().map(|v| f64::from(v[k]).powi(2)).sum::<f64>() / self.values.len() as f64).sqrt()
        })
    }
}

/// Transforms rows, then columns, without normalisation, as for a sum of waves.
fn inverse_transform(field: &mut [Complex<f64>], size: usize) {
    let fft = mesophyll_base::fourier::inverse(size);
    let mut turned = vec![Complex::new(0.0, 0.0); field.len()];
    for _ in 0..2 {
        fft.process(field);
        for row in 0..size {
            for column in 0..size {
                turned[column * size + row] = field[row * size + column];
            }
        }
        field.copy_from_slice(&turned);
    }
}

/// How far the spectrum of lines through a texture is from the wanted one: root mean square of log₁₀(measured/wanted)
/// over `bands` bands. The bands are even in ln f between twice the lowest and the highest frequency, and the spectrum
/// is measured along `lines` trajectories in both channels. Also returns the bands: (frequency, wanted, measured).
pub fn deviation(
    motion: &MotionTexture,
    spectrum: impl Fn(f64) -> f64,
    lines: u64,
    bands: usize,
) -> (f64, Vec<[f64; 3]>) {
    let dt = 1.0 / (TEXELS_A_CYCLE as f64 * motion.highest);
    // Eight times the resolution of the texture: neighbouring lines of its lattice are averaged within a band.
    let segment = 8 * motion.size;
    let step = 1.0 / (segment as f64 * dt);
    let mut mean = vec![0.0; segment / 2 + 1];
    for line in 0..lines {
        let path = motion.trajectory(1000 + line, 1.0);
        let samples: Vec<[f64; 2]> = (0..4 * segment).map(|k| motion.sample(path.at(k as f64 * dt))).collect();
        for channel in 0..2 {
            let one: Vec<f64> = samples.iter().map(|s| s[channel]).collect();
            for (m, p) in mean.iter_mut().zip(super::motion_spectrum::periodogram(&one, dt, segment)) {
                *m += p / (2 * lines) as f64;
            }
        }
    }
    let (low, high) = (2.0 * motion.lowest, motion.highest);
    let edge = |b: usize| low * (high / low).powf(b as f64 / bands as f64);
    let found: Vec<[f64; 3]> = (0..bands)
        .filter_map(|b| {
            let inside: Vec<usize> =
                (1..mean.len()).filter(|k| (edge(b)..edge(b + 1)).contains(&(*k as f64 * step))).collect();
            let n = inside.len() as f64;
            let wanted = inside.iter().map(|k| spectrum(*k as f64 * step)).sum::<f64>() / n;
            let measured = inside.iter().map(|k| mean[*k]).sum::<f64>() / n;
            (n > 0.0).then(|| [(edge(b) * edge(b + 1)).sqrt(), wanted, measured])
        })
        .collect();
    let sum: f64 = found.iter().map(|[_, want, have]| (have / want).log10().powi(2)).sum();
    ((sum / found.len() as f64).sqrt(), found)
}

#[cfg(test)]
mod tests;
