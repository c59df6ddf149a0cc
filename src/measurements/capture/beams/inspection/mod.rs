//! A first look at photographs under beams. It lists everything that is wrong with the files, and then what they hold:
//! lights, exposure, noise, the outline's place in the picture, and whether the photographs agree with each other about
//! side and scale. Nothing is fitted.

mod agreement;
mod photograph;

use super::manifest::{BeamPhotograph, BeamsManifest};
use super::reader;
use crate::kind::CaptureKind;
use mesophyll_base::statistics::median_of;
use mesophyll_optics::side::Side;
use serde::Serialize;
use std::path::Path;

pub use photograph::BeamPhotographSummary;

/// The result of a first look at a capture.
#[derive(Debug, Clone, Default, Serialize)]
pub struct BeamsInspection {
    /// The capture's folder.
    pub folder: String,
    /// What its field `kind` says: `beams`.
    pub kind: &'static str,
    /// The contents of `capture.toml`; absent when it cannot be read.
    pub manifest: Option<BeamsManifest>,
    /// Why the capture cannot be fitted; empty when it can.
    pub problems: Vec<String>,
    /// What can be fitted but deserves a look.
    pub warnings: Vec<String>,
    /// Consequences of what the capture holds and of what it lacks.
    pub notes: Vec<String>,
    /// The photographs that can be read, in the manifest's order.
    pub photographs: Vec<BeamPhotographSummary>,
    /// Width and height of the picture on the blade (mm).
    pub field_mm: Option<[f64; 2]>,
    /// Texels with a reading in some photograph.
    pub leaf_texels: Option<usize>,
    /// Noise seen divided by the noise stated, at the photographs' medians. It is an upper bound, because fine texture
    /// counts as noise. Absent where either is unknown.
    pub noise_seen_over_stated: Option<f64>,
}

impl BeamsInspection {
    /// Whether it can be fitted.
    pub fn fits(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Beams lower than this (degrees) tell little, because their light is taken to spread like that of a beam along the
/// normal.
const LOW_BEAM: f64 = 30.0;
/// Texels of this size (mm) or larger are coarser than most leaves are thick.
const COARSE: f64 = 0.2;

/// Looks at `CAPTURE`; whatever is wrong with it is in [`BeamsInspection::problems`].
pub fn inspect(folder: &Path) -> BeamsInspection {
    let mut found = BeamsInspection {
        folder: folder.display().to_string(),
        kind: CaptureKind::Beams.field().unwrap_or_default(),
        ..BeamsInspection::default()
    };
    let m = match BeamsManifest::read(folder) {
        Ok(m) => m,
        Err(e) => {
            found.problems.push(e.to_string());
            return found;
        }
    };
    let mut views = agreement::BeamViews::new(m.width, m.height);
    for (k, beam) in m.beams.iter().enumerate() {
        match reader::photograph(folder, &m, beam) {
            Ok(channels) => {
                let photograph = BeamPhotographSummary::look(k, beam, &channels, m.width);
                photograph.warnings(&mut found.warnings);
                views.add(k, beam, &channels, photograph.median);
                found.photographs.push(photograph);
            }
            Err(e) => found.problems.push(e.to_string()),
        }
    }
    let leaf = views.leaf();
    let texels = leaf.iter().filter(|on| **on).count();
    for p in &mut found.photographs {
        p.miss(texels, &mut found.warnings);
    }
    found.warnings.extend(views.mirrored());
    lights(&m.beams, &mut found);
    noise(&m, &mut found);
    consequences(folder, &m, &leaf, &mut found);
    (found.leaf_texels, found.field_mm) = (Some(texels), Some([m.width, m.height].map(|n| n as f64 * m.texel_mm)));
    found.manifest = Some(m);
    found
}

/// What the directions of the beams tell, alone and together with the brightness of the photographs.
fn lights(beams: &[BeamPhotograph], found: &mut BeamsInspection) {
    for (k, b) in beams.iter().enumerate() {
        let number = k + 1;
        if b.elevation_deg < LOW_BEAM {
            found.warnings.push(format!(
                "beam {number} stands {}° over the blade: the fit spreads its light as that of a beam along the \
                 normal; steep beams are better",
                b.elevation_deg
            ));
        }
        for (j, a) in beams[..k].iter().enumerate() {
            let cosine: f64 = a.direction().iter().zip(b.direction()).map(|(x, y)| x * y).sum();
            if a.file == b.file {
                found.warnings.push(format!("beams {} and {number} name the same photograph, {}", j + 1, a.file));
            } else if a.lit == b.lit && cosine > 0.99999 {
                found.warnings.push(format!(
                    "beams {} and {number} light the {} from the same direction",
                    j + 1,
                    a.lit.name()
                ));
            }
        }
    }
    // A smaller share of the light comes through of a slanting beam than of a steep one.
    let share = |p: &BeamPhotographSummary| p.median / p.elevation_deg.to_radians().sin();
    for side in [Side::Front, Side::Back] {
        let mut lit: Vec<&BeamPhotographSummary> =
            found.photographs.iter().filter(|p| p.lit == side.name() && p.median > 0.0).collect();
        lit.sort_by(|a, b| b.elevation_deg.total_cmp(&a.elevation_deg));
        let Some((steepest, others)) = lit.split_first() else {
            found.notes.push(format!("no beam lights the {}: it is not measured from there", side.name()));
            continue;
        };
        for p in others.iter().filter(|p| share(p) > 1.1 * share(steepest)) {
            found.warnings.push(format!(
                "of the light of beam {} {:.2} times as much comes through as of the steeper beam {}, expected less: \
                 the unit is a white sheet that faces \
                the beam, not one that lies level; or the blade leans towards it",
                p.beam,
                share(p) / share(steepest),
                steepest.beam
            ));
        }
    }
}

/// Compares the stated noise, if any, with the noise that is seen.
fn noise(m: &BeamsManifest, found: &mut BeamsInspection) {
    let given = [m.noise_relative, m.noise_floor];
    let stated = given.iter().any(Option::is_some).then(|| given.map(|v| v.unwrap_or(0.0)));
    for p in &found.photographs {
        p.doubts(stated, &mut found.warnings);
    }
    let Some([relative, floor]) = stated else {
        return found.notes.push("the noise is not stated: the fit estimates it".into());
    };
    if relative == 0.0 && floor == 0.0 {
        return found
            .notes
            .push("the noise is stated as 0: readings are taken as exact, and errors come from the residuals".into());
    }
    let channels = found.photographs.iter().flat_map(|p| p.noise.iter().zip(p.colour));
    let each = channels.filter_map(|(sd, level)| Some((*sd)? / (relative * level).hypot(floor)));
    let Some(ratio) = median_of(each) else { return };
    found.noise_seen_over_stated = Some(ratio);
    // The noise seen is an upper bound, so it can only show that the stated noise is too large.
    if ratio < 0.67 {
        found.warnings.push(format!(
            "the noise seen is {ratio:.2} times the stated one at most: errors will be called larger than they are"
        ));
    }
}

/// Consequences of the manifest, of the outline, and of missing files.
fn consequences(folder: &Path, m: &BeamsManifest, leaf: &[bool], found: &mut BeamsInspection) {
    let (w, h) = (m.width, m.height);
    let borders = [
        ("left", (0..h).any(|j| leaf[j * w])),
        ("right", (0..h).any(|j| leaf[j * w + w - 1])),
        ("top", leaf[..w].contains(&true)),
        ("bottom", leaf[(h - 1) * w..].contains(&true)),
    ];
    let beyond: Vec<&str> = borders.iter().filter(|(_, on)| *on).map(|(name, _)| *name).collect();
    if !beyond.is_empty() {
        found.notes.push(format!(
            "the leaf goes on beyond the picture ({}, as the front is seen): readings nearer than six thicknesses to \
             that border do not count",
            beyond.join(", ")
        ));
    }
    if m.texel_mm >= COARSE {
        found.warnings.push(format!(
            "texel_mm is {}: light spreads sideways by about a leaf's thickness, which such texels do not resolve; a \
             fit then finds products of \
            absorption, scattering and thickness only",
            m.texel_mm
        ));
    }
    found.notes.push(format!(
        "a fit needs the blade (`--blade`) from a leaf fit of {w} × {h} texels of {} mm, rectified to the same place",
        m.texel_mm
    ));
    if crate::truth_path(folder, Side::Front).exists() {
        found.notes.push("truth/ is there: a synthetic capture; the fit reports its error to the truth".into());
    }
}
