//! A look at a capture before anyone waits for a fit. It checks every file that is needed, every header, and a sample
//! of the frames (or all of them), and says what follows from what exists and what is missing. Nothing is fitted. Every
//! problem is listed, not only the first.

mod frames;
pub mod mirror;
mod noise;
mod references;

use crate::Result;
use crate::manifest::TubeManifest;
use mesophyll_optics::side::Side;
use serde::Serialize;
use std::path::Path;

pub use frames::PassSummary;
pub use mirror::MirrorCheck;
pub use noise::NoiseEstimate;
pub use references::ReferenceSummary;

/// The result of a look at a capture.
#[derive(Debug, Clone, Default, Serialize)]
pub struct TubeInspection {
    /// The capture's folder.
    pub folder: String,
    /// The contents of the manifest; absent when it cannot be read.
    pub manifest: Option<TubeManifest>,
    /// Why the capture cannot be fitted; empty when it can.
    pub problems: Vec<String>,
    /// What can be fitted but deserves a look.
    pub warnings: Vec<String>,
    /// Consequences of what the capture holds and of what it lacks.
    pub notes: Vec<String>,
    /// The frames of each side's passes.
    pub passes: Vec<PassSummary>,
    /// White sheet, dark frame, light box, mask and truth.
    pub references: Vec<ReferenceSummary>,
    /// Noise seen in the frames; `None` where too few of them were read.
    pub noise: Option<NoiseEstimate>,
    /// Where the tube's reflection stands in each pass of a mirror strip, if there is one.
    pub mirror: Vec<MirrorCheck>,
    /// Texels on the leaf, from the mask or (roughly) from the light box.
    pub leaf_texels: Option<usize>,
    /// What a fit will roughly need.
    pub estimate: Option<ResourceEstimate>,
}

/// What a fit will roughly need.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ResourceEstimate {
    /// Files that a fit reads.
    pub files: usize,
    /// Their size together, in bytes.
    pub bytes: u64,
    /// Memory (MiB).
    pub memory_mib: f64,
    /// Time (s) on one core.
    pub seconds: f64,
}

impl TubeInspection {
    /// Whether it can be fitted.
    pub fn fits(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Looks at `CAPTURE`: all headers and the last row of every frame, and the samples of a few frames of each pass, or of
/// all frames when `deep`.
///
/// # Errors
/// Only [`crate::Error::Interrupted`]; whatever is wrong with the capture is in [`TubeInspection::problems`].
pub fn inspect(folder: &Path, deep: bool) -> Result<TubeInspection> {
    let mut found = TubeInspection { folder: folder.display().to_string(), ..TubeInspection::default() };
    let manifest = match TubeManifest::read(folder) {
        Ok(m) => m,
        Err(e) => {
            found.problems.push(e.to_string());
            return Ok(found);
        }
    };
    frames::look(folder, &manifest, deep, &mut found)?;
    references::look(folder, &manifest, &mut found);
    mirror::look(folder, &manifest, &mut found);
    consequences(&manifest, &mut found);
    compare_noise(&manifest, &mut found);
    found.estimate = Some(estimate(&manifest, &found));
    found.manifest = Some(manifest);
    Ok(found)
}

/// Consequences of the manifest alone.
fn consequences(m: &TubeManifest, found: &mut TubeInspection) {
    let mut note = |text: String| found.notes.push(text);
    if m.passes.len() == 1 {
        note("pass \"y\" is absent: only the tilt in x can be fitted, the normals' y is unknown".into());
    }
    if !m.sides.contains(&Side::Back) {
        note("the back is absent: a one-sided fit; the back of the rendered leaf is not measured".into());
    }
    if m.thickness_err_mm.is_none() {
        note("thickness_err_mm is absent: the errors of σa and σs leave out that of the thickness".into());
    }
    match m.lightbox.camera_deg {
        0.0 => note(
            "the light box is seen along the normal: its ratio is ρt for light that falls in along the normal".into(),
        ),
        angle => {
            note(format!("the light box is seen at {angle}°: its ratio is ρt for light that falls in at {angle}°"))
        }
    }
    if m.camera_deg.abs() < 20.0 {
        let angle = m.camera_deg;
        found.warnings.push(format!(
            "camera_deg is {angle}: so close to the normal, broad highlights cannot be told from diffuse light"
        ));
    }
    for pass in &m.passes {
        let p = pass.positions();
        let step = p.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        // Near the mirror angle, a slope changes the place of the reflection by 2 H/cos²(camera). At this m a lobe
        // spans two frames.
        let narrow = step / m.tube.height_mm * m.camera_deg.to_radians().cos().powi(2);
        note(format!(
            "pass \"{}\": {} positions, at most {step:.3} mm apart; roughness below about {narrow:.3} is not resolved",
            pass.name.name(),
            p.len()
        ));
    }
}

/// Compares the stated noise with the noise that is seen.
fn compare_noise(m: &TubeManifest, found: &mut TubeInspection) {
    let Some(seen) = &found.noise else { return };
    match (m.noise_relative, m.noise_floor) {
        (None, None) => found.notes.push("the noise is not stated: the fit estimates it".into()),
        (relative, floor) => {
            for at in [seen.typical_value, seen.bright_value] {
                let sd = |r: f64, f: f64| (r * at).hypot(f);
                let (stated, estimated) =
                    (sd(relative.unwrap_or(0.0), floor.unwrap_or(0.0)), sd(seen.relative, seen.floor));
                let ratio = estimated / stated;
                if !(0.67..=1.5).contains(&ratio) {
                    found.warnings.push(format!(
                        "the noise seen at the value {at:.3} is {estimated:.2e}, {ratio:.2} times the stated \
                         {stated:.2e}: errors and χ² will be off by as much"
                    ));
                    break;
                }
            }
        }
    }
}

/// A rough estimate. A fit reads every frame once, keeps maps and errors of every side, and takes some tens of
/// microseconds for each texel and pass.
fn estimate(m: &TubeManifest, found: &TubeInspection) -> ResourceEstimate {
    const READ_BYTES_A_SECOND: f64 = 2.0e8;
    const SECONDS_A_TEXEL_AND_PASS: f64 = 4.0e-5;
    /// Maps, errors and work space, in floats a texel and side.
    const FLOATS_A_TEXEL: f64 = 100.0;
    const BASE_MIB: f64 = 64.0;
    let texels = (m.width * m.height) as f64;
    let on_leaf = found.leaf_texels.map_or(texels, |n| n as f64);
    let sides = m.sides.len() as f64;
    let bytes: u64 =
        found.passes.iter().map(|p| p.bytes).sum::<u64>() + found.references.iter().map(|r| r.bytes).sum::<u64>();
    let files =
        found.passes.iter().map(|p| p.found).sum::<usize>() + found.references.iter().map(|r| r.files).sum::<usize>();
    ResourceEstimate {
        files,
        bytes,
        memory_mib: BASE_MIB + texels * sides * FLOATS_A_TEXEL * 4.0 / f64::from(1 << 20),
        seconds: bytes as f64 / READ_BYTES_A_SECOND
            + on_leaf * sides * m.passes.len() as f64 * SECONDS_A_TEXEL_AND_PASS,
    }
}

/// `0007, 0012–0014 and 3 more`.
fn list_numbers(numbers: &[usize]) -> String {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for &n in numbers {
        match runs.last_mut().filter(|r| r.1 + 1 == n) {
            Some(run) => run.1 = n,
            None => runs.push((n, n)),
        }
    }
    let shown: Vec<String> = runs
        .iter()
        .take(6)
        .map(|(a, b)| if a == b { format!("{a:04}") } else { format!("{a:04}\u{2013}{b:04}") })
        .collect();
    let listed: usize = runs.iter().take(6).map(|(a, b)| b - a + 1).sum();
    let more = numbers.len() - listed;
    if more > 0 { format!("{} and {more} more", shown.join(", ")) } else { shown.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::list_numbers;

    #[test]
    fn runs_of_numbers_are_drawn_together() {
        assert_eq!(list_numbers(&[7, 12, 13, 14]), "0007, 0012–0014");
        assert_eq!(list_numbers(&[1, 3, 5, 7, 9, 11, 13, 15]), "0001, 0003, 0005, 0007, 0009, 0011 and 2 more");
    }
}
