//! Where a leaf's inside comes from: the maps of a leaf fit, brought into the form that the light transport takes.
//!
//! Lengths in mm, σ in 1/mm. Texels without a measurement take their nearest good neighbour's values, so that no light
//! is lost at a hole in the data; texels beside the leaf hold nothing.

use crate::leaf::{fill, map_path};
use crate::{Error, Result};
use mesophyll_files::hash;
use mesophyll_files::image::{Maps, read_exr_rows};
use mesophyll_optics::side::Side;
use mesophyll_optics::translucency::relief;
use mesophyll_record::{FitRecord, Section};
use std::path::{Path, PathBuf};

/// One side's maps, as its own camera saw it, row-major.
#[derive(Debug, Clone)]
pub struct SideMaps {
    pub name: Side,
    /// Diffuse reflectance and transmittance a channel.
    pub rho_d: [Vec<f32>; 3],
    pub rho_t: [Vec<f32>; 3],
    /// Unit normals in the frame that was asked for: x right, y up, z out of this side.
    pub normal: Vec<[f64; 3]>,
    /// Outward of this side, over that frame's plane (mm).
    pub height: Vec<f64>,
    /// Root mean square of the slope that no height explains.
    pub slope_residual: f64,
    pub thickness: Vec<f64>,
    pub mask: Vec<bool>,
    /// The slab's coefficients a channel (1/mm), their standard errors (infinite: nothing is known of them), and what
    /// the leaf fit says of those that it did not determine.
    pub sigma_a: [f64; 3],
    pub sigma_s: [f64; 3],
    pub sigma_err: [[f64; 3]; 2],
    pub undetermined: Vec<String>,
}

/// Blades are some tenths of a millimetre thick; far beyond these limits a map is in other units, or no map of
/// thickness.
const THICKNESS_MM: std::ops::RangeInclusive<f64> = 1e-6..=1e3;

/// What directions are told against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// The mesh's tangent frame, texel by texel: a renderer bends the blade itself.
    Mesh,
    /// The photographs': the blade as it lay, with its own bend.
    Photograph,
}

/// A leaf whose inside is to be computed.
#[derive(Debug, Clone)]
pub struct Source {
    pub name: String,
    pub width: usize,
    pub height: usize,
    pub texel_mm: f64,
    /// Mean thickness h (mm).
    pub thickness_mm: f64,
    pub sides: Vec<SideMaps>,
    /// Content hash of what was read.
    pub hash: String,
}

impl Source {
    /// Reads a folder of `fit leaf`.
    ///
    /// # Errors
    /// [`Error::Input`] for a folder that holds no leaf fit, a map that is missing, damaged or of another size, or a
    /// field that is missing.
    pub fn read(folder: &Path, frame: Frame) -> Result<Source> {
        let file = folder.join("fit.toml");
        if !file.is_file() {
            return Err(Error::input(folder, "no leaf fit here (no fit.toml); `mesophyll fit leaf` writes one"));
        }
        let record = FitRecord::read(folder)?;
        if record.kind != "leaf" {
            return Err(Error::field(&file, "kind", format!("found \"{}\", expected \"leaf\"", record.kind)));
        }
        let texel_mm = number(&file, &record, "texel_mm")?;
        let mut size = None;
        let mut sides = Vec::new();
        let mut thickness_mm = f64::NAN;
        for name in [Side::Front, Side::Back] {
            if !record.sections.contains_key(name.name()) {
                continue;
            }
            thickness_mm = parameter(&file, &record, name, "thickness", 1)?[0];
            sides.push(side(folder, &file, &record, name, frame, texel_mm, &mut size)?);
        }
        let Some((width, height)) = size else {
            return Err(Error::field(&file, "front", "missing, and so is back; expected the section of a side"));
        };
        record.verify(folder)?;
        let hash = hash::file(&file)?;
        Ok(Source { name: record.name, width, height, texel_mm, thickness_mm, sides, hash })
    }

    pub fn side(&self, name: Side) -> Option<&SideMaps> {
        self.sides.iter().find(|s| s.name == name)
    }
}

fn number(file: &Path, record: &FitRecord, field: &str) -> Result<f64> {
    let found = record.options.get(field).map_or("nothing", String::as_str);
    match found.parse::<f64>() {
        Ok(v) if v > 0.0 && v.is_finite() => Ok(v),
        _ => Err(Error::field(
            file,
            &format!("options.{field}"),
            format!("found {found}, expected a positive length in mm"),
        )),
    }
}

fn parameter(file: &Path, record: &FitRecord, side: Side, name: &str, count: usize) -> Result<Vec<f64>> {
    let values =
        record.sections.get(side.name()).and_then(|s| s.params.get(name)).map(|p| p.value.clone()).unwrap_or_default();
    if values.len() == count && values.iter().all(|v| v.is_finite() && *v >= 0.0) {
        return Ok(values);
    }
    let expected =
        if count == 1 { "one number of at least 0".into() } else { format!("{count} numbers of at least 0") };
    Err(Error::field(file, &format!("{}.{name}", side.name()), format!("found {values:?}, expected {expected}")))
}

/// Standard error of a channel; one that is not stated at all is no doubt.
fn error(section: &Section, name: &str, c: usize) -> f64 {
    section.params.get(name).and_then(|p| p.stderr.get(c).copied()).filter(|e| !e.is_nan()).unwrap_or(0.0)
}

fn side(
    folder: &Path,
    file: &Path,
    record: &FitRecord,
    name: Side,
    frame: Frame,
    texel_mm: f64,
    size: &mut Option<(usize, usize)>,
) -> Result<SideMaps> {
    let path = map_path(folder, name, "");
    let names: Vec<String> = ["rho_d", "rho_t"]
        .iter()
        .flat_map(|q| ["R", "G", "B"].iter().map(move |c| format!("{q}.{c}")))
        .chain(own(&["mask.Y", "thickness.Y"]))
        .collect();
    let maps = read(&path, &names, size)?;
    let (normal_path, axes) = match frame {
        Frame::Mesh => (map_path(folder, name, "normal"), ["X", "Y", "Z"]),
        Frame::Photograph => (path.clone(), ["normal.X", "normal.Y", "normal.Z"]),
    };
    let normals = read(&normal_path, &own(&axes), size)?;
    let (width, height) = (maps.width, maps.height);
    let plane = |m: &Maps, p: &PathBuf, n: &str| m.require(p, n).map(<[f32]>::to_vec);
    let code = plane(&maps, &path, "mask.Y")?;
    let mask: Vec<bool> = code.iter().map(|v| *v != 0.0).collect();
    let good: Vec<bool> = code.iter().map(|v| *v == 1.0).collect();
    if !good.contains(&true) {
        return Err(Error::input(&path, "mask.Y marks no texel as good (1); nothing is known of this side"));
    }
    let filled = |n: &str| -> Result<Vec<f32>> {
        let mut v = plane(&maps, &path, n)?;
        fill::nearest(&mut v, &good, width, height);
        Ok(v)
    };
    let rgb = |q: &str| -> Result<[Vec<f32>; 3]> {
        Ok([filled(&format!("{q}.R"))?, filled(&format!("{q}.G"))?, filled(&format!("{q}.B"))?])
    };
    let [x, y, z] = [
        plane(&normals, &normal_path, axes[0])?,
        plane(&normals, &normal_path, axes[1])?,
        plane(&normals, &normal_path, axes[2])?,
    ];
    let mut normal: Vec<[f64; 3]> = (0..x.len()).map(|k| unit([x[k], y[k], z[k]].map(f64::from))).collect();
    fill::nearest(&mut normal, &good, width, height);
    let thickness: Vec<f64> =
        filled("thickness.Y")?.iter().zip(&mask).map(|(v, m)| if *m { f64::from(*v) } else { 0.0 }).collect();
    if let Some(k) = (0..thickness.len()).find(|&k| mask[k] && !(THICKNESS_MM.contains(&thickness[k]))) {
        let (i, j) = (k % width, k / width);
        let found = thickness[k];
        let (low, high) = (THICKNESS_MM.start(), THICKNESS_MM.end());
        return Err(Error::input(
            &path,
            format!("thickness.Y at column {i}, row {j}: found {found}, expected {low} to {high} mm"),
        ));
    }
    let sigma = |q: &str| parameter(file, record, name, q, 3).map(|v| [v[0], v[1], v[2]]);
    let section = &record.sections[name.name()];
    let relief = relief::integrate(&normal, &mask, width, height, texel_mm);
    Ok(SideMaps {
        name,
        rho_d: rgb("rho_d")?,
        rho_t: rgb("rho_t")?,
        height: relief.height,
        slope_residual: relief.residual,
        normal,
        thickness,
        mask,
        sigma_a: sigma("sigma_a")?,
        sigma_s: sigma("sigma_s")?,
        sigma_err: ["sigma_a", "sigma_s"].map(|q| [0, 1, 2].map(|c| error(section, q, c))),
        undetermined: section.params.values().flat_map(|p| p.undetermined.iter().cloned()).collect(),
    })
}

fn own(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| n.to_string()).collect()
}

/// Some channels of a map that has the size of all others.
fn read(path: &Path, names: &[String], size: &mut Option<(usize, usize)>) -> Result<Maps> {
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let maps = read_exr_rows(path, Some(&names), None)?;
    let (w, h) = *size.get_or_insert((maps.width, maps.height));
    if (maps.width, maps.height) != (w, h) {
        return Err(Error::input(
            path,
            format!("found {}x{} texels, expected {w}x{h} as the fit's other maps", maps.width, maps.height),
        ));
    }
    Ok(maps)
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    // A normal that is no number, or looks into the leaf, is the mesh's own.
    if length > 0.0 && length.is_finite() && v[2] > 0.0 { v.map(|c| c / length) } else { [0.0, 0.0, 1.0] }
}
