//! The mirror strip: whether the tube's reflection is where `capture.toml` says that it must be.
//!
//! A level mirror sends the camera's ray (c is the camera's angle) to (−sin c, 0, cos c). It meets the axis of a tube
//! at height H where x = position + H tan c in pass x, and where y = position in pass y. An offset Δ from there may be
//! an error of the tube's zero, of its height (H is off by Δ/tan c), or of the camera's angle (off by Δ cos²c/H). One
//! view cannot tell these apart. In each case the fitted normals lean by −Δ cos²c/(2H) in pass x and −Δ/(2H) in pass y.
//! (Gardner et al. 2003 place the tube by a mirror strip; the arithmetic here is the law of reflection.) Lengths in mm.

use super::{Inspection, list_numbers};
use crate::Result;
use crate::manifest::{Manifest, Pass, mirror_path};
use mesophyll_files::image;
use mesophyll_optics::tube::Travel;
use serde::Serialize;
use std::path::Path;

/// Lean of the fitted normals (degrees) that deserves a warning.
const LEAN_DEG: f64 = 0.1;
/// An offset of more than this many standard errors is no chance.
const SURE: f64 = 3.0;

/// The reflection in one pass, compared with the stated geometry.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MirrorCheck {
    /// `x` or `y`.
    pub pass: String,
    /// Frames that show the whole reflection.
    pub frames: usize,
    /// Mean distance of the reflection from its expected place, along the travel.
    pub offset_mm: f64,
    /// Standard error of `offset_mm`.
    pub error_mm: f64,
    /// How much the fitted normals will lean in that direction (degrees) if nothing is corrected.
    pub lean_deg: f64,
}

/// Adds the results of the capture's mirror strip to `found`: the offsets, and a note or a warning for each pass.
pub fn look(folder: &Path, m: &Manifest, found: &mut Inspection) {
    if !folder.join("mirror").exists() {
        found
            .notes
            .push("mirror/ is absent: the tube's height and zero and the camera's angle are taken as stated".into());
        return;
    }
    for pass in &m.passes {
        let place = format!("mirror/{}", pass.name.name());
        let missing: Vec<usize> =
            (0..pass.positions().len()).filter(|&k| !mirror_path(folder, pass.name, k).exists()).collect();
        if !missing.is_empty() {
            let list = list_numbers(&missing);
            found.warnings.push(format!(
                "{place}: {} of {} frames are missing: {list}",
                missing.len(),
                pass.positions().len()
            ));
        }
        match offsets(folder, m, pass) {
            Err(e) => found.warnings.push(format!("{e}; a fit does not need it")),
            Ok(offsets) if offsets.is_empty() => {
                found.warnings.push(format!(
                    "{place}: no frame shows the whole of the tube's reflection; is the mirror level and in the field?"
                ));
            }
            Ok(offsets) => judge(m, pass, &offsets, found),
        }
    }
}

fn judge(m: &Manifest, pass: &Pass, offsets: &[f64], found: &mut Inspection) {
    let n = offsets.len() as f64;
    let mean = offsets.iter().sum::<f64>() / n;
    let scatter = (offsets.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
    // One frame says nothing about its scatter, so a texel's width is taken instead.
    let error = if offsets.len() > 1 { scatter / n.sqrt() } else { m.texel_mm };
    let camera = m.camera_deg.to_radians();
    let turn = if pass.name == Travel::X { camera.cos().powi(2) } else { 1.0 };
    let lean = (-mean * turn / (2.0 * m.tube.height_mm)).to_degrees();
    let (name, axis) = (pass.name.name(), if pass.name == Travel::X { "x" } else { "y" });
    let seen = format!(
        "mirror/{name}: the tube's reflection stands {mean:+.3} ± {error:.3} mm from where capture.toml puts it ({n} \
         frames)"
    );
    if lean.abs() > LEAN_DEG && mean.abs() > SURE * error {
        let suspects = match pass.name {
            Travel::X if camera.tan().abs() > 0.1 => {
                format!("start_mm or tube.height_mm is off (the height by {:+.2} mm)", mean / camera.tan())
            }
            _ => "start_mm is off".into(),
        };
        found.warnings.push(format!(
            "{seen}: normals will lean by {lean:+.2}° in {axis}; {suspects}, or the mirror is not level"
        ));
    } else {
        found.notes.push(format!("{seen}, worth {lean:+.2}° of tilt in {axis}"));
    }
    found.mirror.push(MirrorCheck {
        pass: name.into(),
        frames: offsets.len(),
        offset_mm: mean,
        error_mm: error,
        lean_deg: lean,
    });
}

/// Distance of the reflection from its stated place in every frame that shows the whole of it.
fn offsets(folder: &Path, m: &Manifest, pass: &Pass) -> Result<Vec<f64>> {
    let mut profiles = Vec::new();
    for (k, position) in pass.positions().into_iter().enumerate() {
        let path = mirror_path(folder, pass.name, k);
        if path.exists() {
            profiles.push((position, profile(&path, m, pass.name)?));
        }
    }
    // The brightest frame tells how bright a reflection is; frames without one show noise.
    let top = profiles
        .iter()
        .flat_map(|(_, p)| p.iter().map(|(_, v)| v - base(p)))
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max);
    let shift = if pass.name == Travel::X { m.tube.height_mm * m.camera_deg.to_radians().tan() } else { 0.0 };
    Ok(profiles.iter().filter_map(|(position, p)| Some(centre(p, top)? - position - shift)).collect())
}

/// Place along the travel and mean value over the strip and the channels. Places without any reading are left out.
fn profile(path: &Path, m: &Manifest, travel: Travel) -> Result<Vec<(f64, f64)>> {
    let maps = image::read_exr_rows(path, Some(&["R", "G", "B"]), None)?;
    let (w, h) = (maps.width, maps.height);
    let (count, length) = if travel == Travel::X { (w, m.width) } else { (h, m.height) };
    let wide = length as f64 * m.texel_mm / count as f64;
    let mut out = Vec::new();
    for at in 0..count {
        let texels: Vec<usize> = if travel == Travel::X {
            (0..h).map(|j| j * w + at).collect()
        } else {
            (0..w).map(|i| at * w + i).collect()
        };
        let values: Vec<f64> = maps
            .channels
            .iter()
            .flat_map(|c| texels.iter().map(|&k| f64::from(c.1[k])))
            .filter(|v| v.is_finite())
            .collect();
        if !values.is_empty() {
            let place = (at as f64 + 0.5 - count as f64 / 2.0) * wide;
            let place = if travel == Travel::X { place } else { -place };
            out.push((place, values.iter().sum::<f64>() / values.len() as f64));
        }
    }
    Ok(out)
}

/// The value beside the reflection. The reflection covers less than half of the strip.
fn base(profile: &[(f64, f64)]) -> f64 {
    let mut values: Vec<f64> = profile.iter().map(|(_, v)| *v).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 4).copied().unwrap_or(f64::NAN)
}

/// Centre of gravity of the reflection; `None` where the frame shows none, or only a part of it.
fn centre(profile: &[(f64, f64)], top: f64) -> Option<f64> {
    let base = base(profile);
    let bright: Vec<usize> = (0..profile.len()).filter(|&k| profile[k].1 - base > 0.05 * top).collect();
    let (&first, &last) = (bright.first()?, bright.last()?);
    let peak = bright.iter().map(|&k| profile[k].1 - base).fold(0.0, f64::max);
    if peak < 0.5 * top || first == 0 || last + 1 == profile.len() || bright.len() != last - first + 1 {
        return None;
    }
    let weight = |k: usize| profile[k].1 - base;
    let sum: f64 = bright.iter().map(|&k| weight(k)).sum();
    Some(bright.iter().map(|&k| weight(k) * profile[k].0).sum::<f64>() / sum)
}
