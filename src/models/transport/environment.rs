//! Environment maps: radiance from all around, as a picture over zenith and azimuth.
//!
//! The picture is a panorama as [`mesophyll_sky::panorama`] says. Between the centres of texels the radiance is
//! interpolated bilinearly. It wraps around in azimuth, and is constant beyond the first and the last row.

use super::sphere_density::{DirectionCell, SphereDensity};
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_files::memory;
use mesophyll_files::picture::{self, PictureRequest, RGB};
use mesophyll_sky::harmonics::{HarmonicBasis, HarmonicCoefficients};
use mesophyll_sky::panorama;
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// Columns of the map that harmonics are summed over: steps of 0.7°, where degree 6 changes over 30°.
const SUMMED: usize = 512;

/// An environment map, with the density by which it is sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct Environment {
    columns: usize,
    rows: usize,
    /// By how much it is turned from +x towards +y (whole turns).
    turn: f64,
    /// Radiance of each channel.
    texels: Vec<[f32; 3]>,
    /// The density; `None` for a map that is black everywhere.
    pub(super) density: Option<SphereDensity>,
}

impl Environment {
    /// A map of `columns · rows` texels, row by row.
    ///
    /// # Errors
    /// A sentence about the first texel that is no radiance (not finite, or negative), or about a wrong number of
    /// texels.
    pub fn new(columns: usize, rows: usize, texels: Vec<[f32; 3]>) -> std::result::Result<Environment, String> {
        if columns == 0 || rows == 0 || texels.len() != columns * rows {
            return Err(format!("{} texels, expected {columns}×{rows}", texels.len()));
        }
        for (k, texel) in texels.iter().enumerate() {
            for (value, channel) in texel.iter().zip(["R", "G", "B"]) {
                if !(value.is_finite() && *value >= 0.0) {
                    let (i, j) = (k % columns, k / columns);
                    return Err(format!(
                        "channel {channel}, column {i}, row {j}: found {value}, expected a radiance (finite and not \
                         negative)"
                    ));
                }
            }
        }
        let mean = texels.iter().map(|t| (t[0] / 3.0) + (t[1] / 3.0) + (t[2] / 3.0)).collect();
        let density = SphereDensity::new(columns, rows, mean);
        Ok(Environment { columns, rows, turn: 0.0, texels, density })
    }

    /// Reads an OpenEXR or Radiance picture that is twice as wide as high, as [`picture`] does, and says what was
    /// changed. A few readings that are no radiance are clamped.
    ///
    /// # Errors
    /// [`Error::Input`] that names the file and the fault: it is missing or truncated, lacks a channel, has another
    /// shape, or has many texels that are no radiance.
    pub fn read(path: &Path) -> Result<Environment> {
        let fits = |columns: usize, rows: usize| {
            if columns != 2 * rows {
                let expected = "expected twice as many columns as rows (360° by 180°)";
                return Err(Error::input(path, format!("an environment map of {columns}×{rows} texels, {expected}")));
            }
            let needed = (12 * columns * rows) as u64 + 2 * SphereDensity::bytes(columns, rows);
            memory::require(needed, &format!("the environment map {}", path.display()))
        };
        let picture::LinearPicture { maps, mut said } =
            picture::read(path, &PictureRequest { names: &RGB, all: false, outside: 0.0 }, fits)?;
        let columns = maps.width;
        let mut texels: Vec<[f32; 3]> =
            (0..columns * maps.height).map(|k| [0, 1, 2].map(|c| maps.channels[c].1[k])).collect();
        said.extend(picture::clamp(&mut texels, columns).map_err(|what| Error::input(path, what))?);
        picture::tell(path, &said);
        Environment::new(columns, maps.height, texels).map_err(|what| Error::input(path, what))
    }

    /// The same map, turned by an angle (degrees) from +x towards +y, with its radiance multiplied by `scale`.
    ///
    /// # Errors
    /// As [`Environment::new`], where a radiance becomes too large for a number.
    pub fn placed(self, degrees: f64, scale: f64) -> std::result::Result<Environment, String> {
        let mut out = self;
        if scale != 1.0 {
            let scaled = out.texels.iter().map(|t| t.map(|v| (f64::from(v) * scale) as f32)).collect();
            out = Environment { turn: out.turn, ..Environment::new(out.columns, out.rows, scaled)? };
        }
        out.turn = (out.turn + degrees / 360.0).rem_euclid(1.0);
        let turn = out.turn;
        out.density.iter_mut().for_each(|density| density.turn = turn);
        Ok(out)
    }

    /// The same map with other radiance in its texels.
    ///
    /// # Errors
    /// As [`Environment::new`].
    pub fn with_texels(&self, texels: Vec<[f32; 3]>) -> std::result::Result<Environment, String> {
        Environment::new(self.columns, self.rows, texels)?.placed(360.0 * self.turn, 1.0)
    }

    /// The map with at most so many columns (even). Each of its texels has the mean of those whose centres lie in it.
    pub fn reduced(&self, columns: usize) -> Environment {
        if self.columns <= columns {
            return self.clone();
        }
        let rows = columns / 2;
        let mut sums = vec![[0.0f64; 4]; columns * rows];
        for (j, row) in self.texels.chunks_exact(self.columns).enumerate() {
            let line = j * rows / self.rows * columns;
            for (i, texel) in row.iter().enumerate() {
                let sum = &mut sums[line + i * columns / self.columns];
                (0..3).for_each(|c| sum[c] += f64::from(texel[c]));
                sum[3] += 1.0;
            }
        }
        let texels = sums.iter().map(|s| [0, 1, 2].map(|c| (s[c] / s[3]) as f32)).collect();
        let map = Environment::new(columns, rows, texels).and_then(|map| map.placed(360.0 * self.turn, 1.0));
        map.unwrap_or_else(|_| self.clone())
    }

    /// Columns, rows, and the radiance of each texel, row by row.
    pub fn texels(&self) -> (usize, usize, &[[f32; 3]]) {
        (self.columns, self.rows, &self.texels)
    }

    /// By how much the map is turned from +x towards +y (whole turns, 0 to 1).
    pub fn turn(&self) -> f64 {
        self.turn
    }

    /// Unit vectors towards the centres of the texels, row by row, and their solid angles (sr).
    pub fn centres(&self) -> impl Iterator<Item = (DVec3, f64)> {
        let (sin, cos) = (TAU * self.turn).sin_cos();
        let size = |j: usize| {
            let edge = |j: usize| (PI * j as f64 / self.rows as f64).cos();
            TAU / self.columns as f64 * (edge(j) - edge(j + 1))
        };
        let turned = move |[x, y, z]: [f64; 3]| DVec3::new(cos * x - sin * y, sin * x + cos * y, z);
        let all = panorama::centres(self.columns, self.rows).enumerate();
        all.map(move |(k, d)| (turned(d), size(k / self.columns)))
    }

    /// N² coefficients of the radiance in real orthonormal harmonics, in world directions.
    pub fn harmonics(&self, bands: usize) -> HarmonicCoefficients {
        let map = self.reduced(SUMMED);
        let (basis, mut values) = (HarmonicBasis::new(bands), vec![0.0; bands * bands]);
        let mut out = HarmonicCoefficients::zero(bands);
        for ((d, size), texel) in map.centres().zip(&map.texels) {
            basis.fill(d.to_array(), &mut values);
            for (sum, value) in out.values_mut().iter_mut().zip(&values) {
                (0..3).for_each(|c| sum[c] += size * value * f64::from(texel[c]));
            }
        }
        out
    }

    /// Radiance from a unit direction.
    pub fn at(&self, d: DVec3) -> [f64; 3] {
        let cell = DirectionCell::of(d, self.columns, self.rows, self.turn);
        [0, 1, 2].map(|c| cell.mix(|i, j| f64::from(self.texels[j * self.columns + i][c])))
    }

    /// Mean radiance over the sphere.
    pub fn mean(&self) -> [f64; 3] {
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for (j, row) in self.texels.chunks_exact(self.columns).enumerate() {
            let sin = (PI * (j as f64 + 0.5) / self.rows as f64).sin();
            weights += sin * self.columns as f64;
            row.iter().for_each(|t| (0..3).for_each(|c| sum[c] += sin * f64::from(t[c])));
        }
        sum.map(|s| s / weights)
    }
}
