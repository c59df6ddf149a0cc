//! The mirror strip: whether the tube's reflection is where `capture.toml` says that it must be.
//!
//! A level mirror sends the camera's ray (c is the camera's angle) to (−sin c, 0, cos c). It meets the axis of a tube
//! at height H where x = position + H tan c in pass x, and where y = position in pass y. An offset Δ from there may be
//! an error of the tube's zero, of its height (H is off by Δ/tan c), or of the camera's angle (off by Δ cos²c/H). One
//! view cannot tell these apart. In each case the fitted normals lean by −Δ cos²c/(2H) in pass x and −Δ/(2H) in pass y.
//! (Gardner et al. 2003 place the tube by a mirror strip; the arithmetic here is the law of reflection.) Lengths in mm.

use super::{TubeInspection, list_numbers};
use crate::Result;
use crate::manifest::{TubeManifest, TubePass, mirror_path};
use mesophyll_base::statistics::upper_quantile;
use mesophyll_files::image;
use mesophyll_optics::tube::Travel;
use serde::Serialize;
use std::path::Path;

/// Lean of the fitted normals (degrees) that deserves a warning.
const LEAN_DEG: f64 = 0.1;
/// An offset of more than this many standard errors is no chance.
const SURE: f64 = 3.0;
/// The reflection moves as far as the tube, up to this share.
const TRAVEL: f64 = 0.01;
/// It stands within this share of a texel of an even motion.
const SCATTER: f64 = 0.5;
/// Its width is that of the tube up to this share: a tube is darker at its rim.
const WIDTH: f64 = 0.25;

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
    /// How far the reflection moves for a millimetre of the tube's travel; 1 where `texel_mm` is right.
    pub travel: f64,
    /// Scatter of the reflection about an even motion (mm).
    pub scatter_mm: f64,
    /// Half the width of the reflection as a tube's radius (mm); `None` where a texel is wider than half of it.
    pub radius_mm: Option<f64>,
    /// Whether all of this is as `capture.toml` says.
    pub agrees: bool,
}

/// Adds the results of the capture's mirror strip to `found`: the offsets, and a note or a warning for each pass.
pub fn look(folder: &Path, m: &TubeManifest, found: &mut TubeInspection) {
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

fn judge(m: &TubeManifest, pass: &TubePass, seen: &[Seen], found: &mut TubeInspection) {
    let n = seen.len() as f64;
    let mean_of = |value: &dyn Fn(&Seen) -> f64| seen.iter().map(value).sum::<f64>() / n;
    let (mean, middle) = (mean_of(&|s| s.offset), mean_of(&|s| s.expected));
    // A straight line through the offsets: a texel of another size makes them grow with the place.
    let spread = mean_of(&|s| (s.expected - middle).powi(2));
    let slope = if spread > 0.0 { mean_of(&|s| (s.expected - middle) * (s.offset - mean)) / spread } else { 0.0 };
    let square = |s: &Seen| (s.offset - mean - slope * (s.expected - middle)).powi(2);
    let freedom = if seen.len() > 2 { n - 2.0 } else { 1.0 };
    let scatter = (seen.iter().map(square).sum::<f64>() / freedom).sqrt();
    // One frame says nothing about its scatter, so a texel's width is taken instead.
    let error = if seen.len() > 2 { scatter / n.sqrt() } else { m.texel_mm };
    let slope_error = if seen.len() > 2 && spread > 0.0 { scatter / (n * spread).sqrt() } else { f64::INFINITY };
    let camera = m.camera_deg.to_radians();
    let turn = if pass.name == Travel::X { camera.cos().powi(2) } else { 1.0 };
    let lean = (-mean * turn / (2.0 * m.tube.height_mm)).to_degrees();
    let (name, axis) = (pass.name.name(), if pass.name == Travel::X { "x" } else { "y" });
    let place = format!(
        "mirror/{name}: the tube's reflection stands {mean:+.3} ± {error:.3} mm from where capture.toml puts it ({n} \
         frames)"
    );
    let mut amiss = Vec::new();
    if slope.abs() > TRAVEL && slope.abs() > SURE * slope_error {
        amiss.push(format!(
            "the reflection moves by {:.3} mm for a millimetre of the tube: texel_mm should be {:.4} and not {}, or \
             the stops lie otherwise than stated",
            1.0 + slope,
            m.texel_mm / (1.0 + slope),
            m.texel_mm
        ));
    }
    if scatter > SCATTER * m.texel_mm && (scatter * turn / (2.0 * m.tube.height_mm)).to_degrees() > LEAN_DEG {
        amiss.push(format!(
            "its places scatter by ± {scatter:.2} mm about an even motion: stops were missed, or frames are in the \
             wrong order"
        ));
    }
    let stretch = if pass.name == Travel::X { camera.cos() } else { 1.0 };
    let half = |s: &Seen| s.width.map(|w| 0.5 * w * stretch);
    let halves: Vec<f64> = seen.iter().filter_map(half).collect();
    let radius = (!halves.is_empty()).then(|| halves.iter().sum::<f64>() / halves.len() as f64);
    if let Some(a) = radius.filter(|a| (a - m.tube.radius_mm).abs() > WIDTH * m.tube.radius_mm.max(*a)) {
        amiss.push(format!(
            "the reflection is as wide as that of a tube of radius {a:.2} mm, and tube.radius_mm is {}",
            m.tube.radius_mm
        ));
    }
    if lean.abs() > LEAN_DEG && mean.abs() > SURE * error {
        let suspects = match pass.name {
            Travel::X if camera.tan().abs() > 0.1 => format!(
                "tube.height_mm is off (by {:+.2} mm), camera_deg (the reflection fits {:.2}), or start_mm and end_mm",
                mean / camera.tan(),
                (camera.tan() + mean / m.tube.height_mm).atan().to_degrees()
            ),
            _ => "start_mm and end_mm are off".into(),
        };
        amiss.push(format!("normals will lean by {lean:+.2}° in {axis}: {suspects}, or the mirror is not level"));
    }
    let agrees = amiss.is_empty();
    if agrees {
        found.notes.push(format!("{place}, worth {lean:+.2}° of tilt in {axis}"));
    } else {
        found.warnings.push(format!("{place}; {}", amiss.join("; ")));
    }
    found.mirror.push(MirrorCheck {
        pass: name.into(),
        frames: seen.len(),
        offset_mm: mean,
        error_mm: error,
        lean_deg: lean,
        travel: 1.0 + slope,
        scatter_mm: scatter,
        radius_mm: radius,
        agrees,
    });
}

/// The reflection in one frame (mm along the travel).
struct Seen {
    /// Where it must stand.
    expected: f64,
    /// How far from there it stands.
    offset: f64,
    /// Its width, where texels are fine enough to tell.
    width: Option<f64>,
}

/// The reflection in every frame that shows the whole of it.
fn offsets(folder: &Path, m: &TubeManifest, pass: &TubePass) -> Result<Vec<Seen>> {
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
    let seen = |(position, p): &(f64, Vec<(f64, f64)>)| {
        let centre = centre(p, top)?;
        let base = base(p);
        let texel = p.windows(2).map(|w| (w[1].0 - w[0].0).abs()).fold(f64::INFINITY, f64::min);
        let width = p.iter().map(|(_, v)| v - base).filter(|v| *v > 0.05 * top).sum::<f64>() * texel / top;
        let expected = position + shift;
        Some(Seen { expected, offset: centre - expected, width: (width > 2.0 * texel).then_some(width) })
    };
    Ok(profiles.iter().filter_map(seen).collect())
}

/// Place along the travel and mean value over the strip and the channels. Places without any reading are left out.
fn profile(path: &Path, m: &TubeManifest, travel: Travel) -> Result<Vec<(f64, f64)>> {
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
    upper_quantile(&mut values, 1, 4).unwrap_or(f64::NAN)
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

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(change: impl Fn(f64, usize) -> f64, width: f64) -> (MirrorCheck, String) {
        let text = "schema = 1\nname = \"m\"\nwidth = 100\nheight = 75\ntexel_mm = 0.5\nthickness_mm = 0.2\n\
                    camera_deg = 55.0\nsides = [\"front\"]\n[tube]\nheight_mm = 100.0\nlength_mm = 500.0\n\
                    radius_mm = 2.5\n[[pass]]\nname = \"y\"\nstart_mm = -20.0\nend_mm = 20.0\nframes = 9\n";
        let manifest: TubeManifest = toml::from_str(text).unwrap();
        let pass = &manifest.passes[0];
        let seen: Vec<Seen> = pass
            .positions()
            .into_iter()
            .enumerate()
            .map(|(k, expected)| Seen { expected, offset: change(expected, k), width: Some(width) })
            .collect();
        let mut found = TubeInspection::default();
        judge(&manifest, pass, &seen, &mut found);
        (found.mirror[0].clone(), found.warnings.join("; "))
    }

    #[test]
    fn offset_step_scatter_and_width_are_told_apart() {
        let noise = |k: usize| 0.001 * [1.0, -2.0, 0.5][k % 3];
        let (check, warnings) = judged(|_, k| noise(k), 5.0);
        assert!(check.agrees && warnings.is_empty(), "{warnings}");
        // Texels stated 1.3 times too large put the reflection 1.3 times as far from the middle.
        let (check, warnings) = judged(|x, k| 0.3 * x + noise(k), 5.0);
        assert!(!check.agrees && (check.travel - 1.3).abs() < 1e-3 && warnings.contains("0.384"), "{warnings}");
        let (check, warnings) = judged(|_, k| if k % 2 == 0 { 1.5 } else { -1.5 }, 5.0);
        assert!(!check.agrees && warnings.contains("scatter by ±"), "{warnings}");
        let (check, warnings) = judged(|_, k| noise(k), 16.0);
        assert!(!check.agrees && warnings.contains("radius 8.00 mm"), "{warnings}");
        let (check, warnings) = judged(|_, k| 2.0 + noise(k), 5.0);
        assert!(!check.agrees && warnings.contains("start_mm and end_mm are off"), "{warnings}");
    }
}
