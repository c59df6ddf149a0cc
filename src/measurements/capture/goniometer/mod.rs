//! Goniometer measurements in the formats of two public databases: MERL (`.binary`, Matusik et al. 2003) and RGL
//! (`.bsdf`, Dupuy & Jakob 2018), as the table that `fit gloss --samples` reads.
//!
//! Both hold millions of readings of one material, so a fixed subset of at most about 1,000 directions is taken. Both
//! are read as isotropic. Values are reflectance factors, π f_r. Directions more than 80° from the normal are left
//! out: there the instruments are least sure. Files are read where they are asked; sizes are refused with a number
//! before memory is taken.

mod merl;
mod rgl;
mod tensor;

use crate::Result;
use std::f64::consts::PI;
use std::fmt::Write;
use std::path::Path;

/// The largest angle from the normal (cosine of 80°).
const LEAST_COSINE: f64 = 0.173_648_177_666_930_35;
/// About so many directions are taken of a file.
const DIRECTIONS: usize = 1000;

/// Readings of a material.
#[derive(Debug, Clone, PartialEq)]
pub struct GoniometerReadings {
    /// Names of the value columns.
    pub names: Vec<String>,
    /// The columns that are fitted where the user names none.
    pub chosen: Vec<String>,
    /// Unit vectors towards the source and the viewer, and reflectance factors (NaN: no reading).
    pub rows: Vec<([f64; 3], [f64; 3], Vec<f64>)>,
}

/// Whether the name of a file says that it is in one of these formats.
pub fn is_goniometer(path: &Path) -> bool {
    reader(path).is_some()
}

fn reader(path: &Path) -> Option<fn(&Path) -> Result<GoniometerReadings>> {
    match path.extension()?.to_ascii_lowercase().to_str()? {
        "binary" => Some(merl::read),
        "bsdf" => Some(rgl::read),
        _ => None,
    }
}

impl GoniometerReadings {
    /// Reads a file. The format is the one that its name's ending says.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a file that is missing, truncated or of another format, with what was found.
    pub fn read(path: &Path) -> Result<GoniometerReadings> {
        match reader(path) {
            Some(read) => read(path),
            None => Err(crate::Error::input(path, "expected a name that ends with .binary (MERL) or .bsdf (RGL)")),
        }
    }

    /// The readings as CSV, with the source at azimuth 0 and `leaf` in the first column.
    pub fn csv(&self, leaf: &str) -> String {
        let plain: String = leaf.chars().map(|c| if matches!(c, ',' | '"' | '\n' | '\r') { '_' } else { c }).collect();
        let mut text = format!("leaf,source_zenith_deg,view_zenith_deg,view_azimuth_deg,{}\n", self.names.join(","));
        for (light, view, values) in &self.rows {
            let zenith = |d: &[f64; 3]| d[2].clamp(-1.0, 1.0).acos().to_degrees();
            let azimuth = (view[1].atan2(view[0]) - light[1].atan2(light[0])).to_degrees();
            let _ = write!(text, "{plain},{},{},{azimuth}", zenith(light), zenith(view));
            for v in values {
                let _ = if v.is_finite() { write!(text, ",{v}") } else { write!(text, ",") };
            }
            text.push('\n');
        }
        text
    }

    /// Adds a direction whose BRDF is `f`, where both directions are far enough from grazing.
    fn add(&mut self, light: [f64; 3], view: [f64; 3], f: impl FnOnce() -> Vec<f64>) {
        if light[2] >= LEAST_COSINE && view[2] >= LEAST_COSINE {
            let values = f().into_iter().map(|f| if f.is_finite() && f >= 0.0 { PI * f } else { f64::NAN }).collect();
            self.rows.push((light, view, values));
        }
    }
}

/// The mirror image of `l` about the unit vector `h`.
fn mirrored(l: [f64; 3], h: [f64; 3]) -> [f64; 3] {
    let d = l[0] * h[0] + l[1] * h[1] + l[2] * h[2];
    [0, 1, 2].map(|k| 2.0 * d * h[k] - l[k])
}

/// The unit vector at these angles.
fn direction(theta: f64, phi: f64) -> [f64; 3] {
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}
