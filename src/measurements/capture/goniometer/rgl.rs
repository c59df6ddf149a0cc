//! RGL's measured materials (Dupuy & Jakob 2018, "An adaptive parameterization for efficient material acquisition and
//! rendering"), as Mitsuba's `measured` plugin reads them.
//!
//! For every incident direction (φi, θi) a table of visible normals warps the unit square to half vectors, so that the
//! readings lie where the material reflects. At the point (x, y) of the square the half vector is u = warp(x, y), with
//! θm = u_x² π/2 and φm = (2 u_y − 1) π, turned by φi for an isotropic material, and
//!
//! ```text
//! f_r cosθo = reading · D(u)/(4 σ(ui)),   ui = (√(2 θi/π), (φi + π)/2π)
//! ```

use super::tensor::TensorFile;
use super::{DIRECTIONS, GoniometerReadings, direction, mirrored};
use crate::{Error, Result};
use std::f64::consts::PI;
use std::path::Path;

/// More wavelengths than this are a mistake.
const WAVELENGTHS: usize = 1024;

/// A function on the unit square: its nodes row by row, bilinear between them.
struct Square<'a> {
    columns: usize,
    rows: usize,
    values: &'a [f64],
}

impl Square<'_> {
    fn at(&self, x: f64, y: f64) -> f64 {
        let axis = |t: f64, n: usize| {
            let t = t.clamp(0.0, 1.0) * (n - 1) as f64;
            let k = (t as usize).min(n.saturating_sub(2));
            (k, (k + 1).min(n - 1), t - k as f64)
        };
        let ((i, j, f), (k, l, g)) = (axis(x, self.columns), axis(y, self.rows));
        let row = |r: usize| self.values[r * self.columns + i] * (1.0 - f) + self.values[r * self.columns + j] * f;
        row(k) * (1.0 - g) + row(l) * g
    }

    /// The integral of each row.
    fn sums(&self) -> Vec<f64> {
        self.values.chunks_exact(self.columns).map(integral).collect()
    }

    /// The point below which the share `y` of the function lies by rows, and the share `x` within its row.
    fn warp(&self, sums: &[f64], x: f64, y: f64) -> [f64; 2] {
        let line = |r: usize| &self.values[r * self.columns..][..self.columns];
        let v = share(sums, y);
        let at = v * (self.rows - 1) as f64;
        let r = (at as usize).min(self.rows.saturating_sub(2));
        let (low, high, f) = (line(r), line((r + 1).min(self.rows - 1)), at - r as f64);
        let row: Vec<f64> = low.iter().zip(high).map(|(a, b)| a + (b - a) * f).collect();
        [share(&row, x), v]
    }
}

/// The integral of a polygon with these values at even steps.
fn integral(values: &[f64]) -> f64 {
    values.windows(2).map(|w| 0.5 * (w[0] + w[1])).sum()
}

/// Where (0 to 1) the share `part` of a polygon's integral is reached.
fn share(values: &[f64], part: f64) -> f64 {
    let steps = values.len() - 1;
    let mut left = part.clamp(0.0, 1.0) * integral(values);
    for (k, w) in values.windows(2).enumerate() {
        let area = 0.5 * (w[0] + w[1]);
        if left <= area || k + 1 == steps {
            // w0 t + (w1 − w0) t²/2 = left.
            let root = (w[0] * w[0] + 2.0 * (w[1] - w[0]) * left).max(0.0).sqrt();
            let t = if w[0] + root > 0.0 { 2.0 * left / (w[0] + root) } else { 0.0 };
            return (k as f64 + t.clamp(0.0, 1.0)) / steps as f64;
        }
        left -= area;
    }
    1.0
}

/// Reads a file: its colours (`rgb`), or its spectra.
pub fn read(path: &Path) -> Result<GoniometerReadings> {
    let mut file = TensorFile::open(path)?;
    let (shape_phi, phi_i) = file.floats("phi_i", 1)?;
    let (shape_theta, theta_i) = file.floats("theta_i", 1)?;
    let (shape_ndf, ndf) = file.floats("ndf", 2)?;
    let (shape_sigma, sigma) = file.floats("sigma", 2)?;
    let (shape_vndf, vndf) = file.floats("vndf", 4)?;
    let (what, names, chosen) = columns(&mut file)?;
    let (shape, values) = file.floats(what, 5)?;
    let expected = [shape_phi[0], shape_theta[0], names.len(), shape[3], shape[4]];
    if shape != expected || shape_vndf[..2] != shape[..2] {
        let found = format!("found shapes {shape:?} and {shape_vndf:?} (vndf)");
        return Err(Error::field(file.path(), what, format!("{found}, expected {expected:?} and the first two of it")));
    }
    if let Some(small) = [&shape[3..], &shape_vndf[2..], &shape_ndf, &shape_sigma].into_iter().find(|s| s.contains(&1))
    {
        return Err(Error::input(
            file.path(),
            format!("found a table of {small:?} nodes, expected 2 or more each way"),
        ));
    }
    let isotropic = shape_phi[0] <= 2;
    let directions = if isotropic { 1 } else { shape_phi[0] };
    let (rows, columns) = (shape[3], shape[4]);
    let plane = rows * columns;
    let density = Square { columns: shape_ndf[1], rows: shape_ndf[0], values: &ndf };
    let area = Square { columns: shape_sigma[1], rows: shape_sigma[0], values: &sigma };
    // Whether the readings are relative to the lobe.
    let relative = file.flag("jacobian")?;
    let mut readings = GoniometerReadings { names, chosen, rows: Vec::new() };
    let bands = readings.names.len();
    let total = directions * theta_i.len() * plane;
    let every = total.div_ceil(DIRECTIONS).max(1);
    let (mut known, mut sums) = (usize::MAX, Vec::new());
    for k in (0..total).step_by(every) {
        let (incident, at) = (k / plane, k % plane);
        let (i, j) = (incident / theta_i.len(), incident % theta_i.len());
        let first = (i * shape_theta[0] + j) * shape_vndf[2] * shape_vndf[3];
        let visible = Square {
            columns: shape_vndf[3],
            rows: shape_vndf[2],
            values: &vndf[first..][..shape_vndf[2] * shape_vndf[3]],
        };
        if incident != known {
            (known, sums) = (incident, visible.sums());
        }
        let x = (at % columns) as f64 / (columns - 1) as f64;
        let y = (at / columns) as f64 / (rows - 1) as f64;
        let u = visible.warp(&sums, x, y);
        let phi = if isotropic { phi_i[i] } else { 0.0 };
        let half = direction(0.5 * PI * u[0] * u[0], (2.0 * u[1] - 1.0) * PI + phi);
        let light = direction(theta_i[j], phi_i[i]);
        let view = mirrored(light, half);
        let scale = if relative {
            let ui = [(2.0 * theta_i[j].max(0.0) / PI).sqrt(), (phi_i[i] + PI) / (2.0 * PI)];
            density.at(u[0], u[1]) / (4.0 * area.at(ui[0], ui[1]))
        } else {
            1.0
        };
        let reading = |band: usize| values[((i * shape_theta[0] + j) * bands + band) * plane + at];
        readings.add(light, view, || (0..bands).map(|b| reading(b) * scale / view[2]).collect());
    }
    Ok(readings)
}

/// The array that holds the readings, the names of its bands, and those that are fitted unless others are named.
fn columns(file: &mut TensorFile) -> Result<(&'static str, Vec<String>, Vec<String>)> {
    if file.find("rgb").is_some() {
        let names = ["brf_r", "brf_g", "brf_b"].map(String::from).to_vec();
        return Ok(("rgb", names.clone(), names));
    }
    let (_, wavelengths) = file.floats("wavelengths", 1)?;
    if wavelengths.len() > WAVELENGTHS {
        let found = format!("found {} wavelengths", wavelengths.len());
        return Err(Error::field(file.path(), "wavelengths", format!("{found}, expected at most {WAVELENGTHS}")));
    }
    let name = |nm: f64| format!("brf_{}", (nm * 10.0).round() / 10.0);
    let mut names: Vec<String> = wavelengths.iter().map(|nm| name(*nm)).collect();
    // Wavelengths closer than a tenth of a nanometre keep apart by their place.
    for k in 1..names.len() {
        if names[..k].contains(&names[k]) {
            names[k] = format!("{}_{k}", names[k]);
        }
    }
    let nearest = |nm: f64| {
        let distance = |k: &usize| (wavelengths[*k] - nm).abs();
        (0..names.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    let mut chosen: Vec<usize> = [640.0, 550.0, 460.0].into_iter().filter_map(nearest).collect();
    chosen.dedup();
    let chosen = chosen.into_iter().map(|k| names[k].clone()).collect();
    Ok(("spectra", names, chosen))
}
