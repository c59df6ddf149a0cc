//! Environment maps: radiance from all around, as a picture over zenith and azimuth.
//!
//! Row 0 is at the zenith, column 0 is towards +x, and azimuth turns towards +y. Texel (i, j) has its centre at azimuth
//! (i + ½)·360°/W and zenith angle (j + ½)·180°/H. Between centres the radiance is interpolated bilinearly. It wraps
//! around in azimuth, and is constant beyond the first and the last row.

use super::sphere_density::{Cell, SphereDensity};
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_files::image::{exr_info, read_exr_rows};
use mesophyll_files::memory;
use std::path::Path;

/// An environment map, with the density by which it is sampled.
#[derive(Debug, Clone)]
pub struct Environment {
    columns: usize,
    rows: usize,
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
        Ok(Environment { columns, rows, texels, density })
    }

    /// Reads an EXR with channels R, G and B (half or float) that is twice as wide as high.
    ///
    /// # Errors
    /// [`Error::Input`] that names the file and the fault: it is missing or truncated, lacks a channel, has another
    /// shape, or has a texel that is no radiance.
    pub fn read(path: &Path) -> Result<Environment> {
        let info = exr_info(path)?;
        let (columns, rows) = (info.width, info.height);
        if columns != 2 * rows {
            return Err(Error::input(
                path,
                format!(
                    "an environment map of {columns}×{rows} texels, expected twice as many columns as rows (360° by \
                     180°)"
                ),
            ));
        }
        let needed = (12 * columns * rows) as u64 + 2 * SphereDensity::bytes(columns, rows);
        memory::require(needed, &format!("the environment map {}", path.display()))?;
        let maps = read_exr_rows(path, Some(&["R", "G", "B"]), None)?;
        let texels = (0..columns * rows).map(|k| [0, 1, 2].map(|c| maps.channels[c].1[k])).collect();
        Environment::new(columns, rows, texels).map_err(|what| Error::input(path, what))
    }

    /// Columns, rows, and the radiance of each texel, row by row.
    pub fn texels(&self) -> (usize, usize, &[[f32; 3]]) {
        (self.columns, self.rows, &self.texels)
    }

    /// Radiance from a unit direction.
    pub fn at(&self, d: DVec3) -> [f64; 3] {
        let cell = Cell::of(d, self.columns, self.rows);
        [0, 1, 2].map(|c| cell.mix(|i, j| f64::from(self.texels[j * self.columns + i][c])))
    }

    /// Mean radiance over the sphere.
    pub fn mean(&self) -> [f64; 3] {
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for (j, row) in self.texels.chunks_exact(self.columns).enumerate() {
            let sin = (std::f64::consts::PI * (j as f64 + 0.5) / self.rows as f64).sin();
            weights += sin * self.columns as f64;
            row.iter().for_each(|t| (0..3).for_each(|c| sum[c] += sin * f64::from(t[c])));
        }
        sum.map(|s| s / weights)
    }
}
