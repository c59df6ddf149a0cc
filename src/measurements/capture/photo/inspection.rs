//! What photographs show before anyone waits for a fit. Everything that the reduction finds is looked at.

use super::manifest::PhotoManifest;
use super::reduction::{DARK, reduce};
use mesophyll_optics::side::Side;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// The outcome of a look at photographs.
#[derive(Debug, Serialize)]
pub struct PhotoInspection {
    /// The manifest, where it could be read.
    pub manifest: Option<PhotoManifest>,
    /// Columns, rows and size (mm) of the texels of the maps.
    pub texels: Option<(usize, usize, f64)>,
    /// Texels on the leaf.
    pub leaf_texels: Option<usize>,
    /// What was found in each side's pictures, by name.
    pub figures: BTreeMap<&'static str, BTreeMap<&'static str, f64>>,
    /// What a reader should know.
    pub notes: Vec<String>,
    /// What makes results worse.
    pub warnings: Vec<String>,
    /// Why the capture cannot be fitted.
    pub problems: Vec<String>,
}

/// Looks at the photographs in `folder`.
pub fn inspect(folder: &Path) -> PhotoInspection {
    let mut found = PhotoInspection {
        manifest: None,
        texels: None,
        leaf_texels: None,
        figures: BTreeMap::new(),
        notes: Vec::new(),
        warnings: Vec::new(),
        problems: Vec::new(),
    };
    let manifest = match PhotoManifest::read(folder) {
        Ok(manifest) => manifest,
        Err(e) => {
            found.problems.push(e.to_string());
            return found;
        }
    };
    match reduce(folder, &manifest) {
        Err(e) => found.problems.push(e.to_string()),
        Ok(r) => {
            found.texels = Some((r.width, r.height, r.texel_mm));
            found.leaf_texels = Some(r.mask.iter().filter(|m| **m).count());
            for side in [Side::Front, Side::Back] {
                found.figures.insert(side.name(), r.sides[side].figures.clone());
                if r.sides[side].figures.get("light_blocks").is_some_and(|n| *n < 18.0) {
                    let what = "the sheet shows too little of itself to say how even the light is; 5 % are assumed";
                    found.warnings.push(format!("{}: {what}", side.name()));
                }
            }
            if r.sides.iter().any(|(_, s)| s.figures.get("turn_doubtful").is_some_and(|d| *d > 0.0)) {
                let what = "the outline fits after a large turn as well, and the texture does not say which is \
                            right; make sure that the leaf lies the same way in all pictures";
                found.warnings.push(what.into());
            }
            for side in [Side::Front, Side::Back] {
                if r.sides[side].figures.get(DARK).is_some_and(|d| *d > 0.0) {
                    let what = "nearly as dark as the sheet; its outline is that of the light table, laid over the \
                                place that differs from the sheet";
                    found.notes.push(format!("{}: {what}", side.name()));
                }
            }
            if !r.scale.by_ticks {
                found.notes.push("the ticks of the ruler were not seen; its two marks alone give the scale".into());
            }
            if manifest.gloss.is_none() {
                found.notes.push("no gloss is stated: the middle of the range that leaves have is subtracted".into());
            }
            found.notes.push("open shade shows neither gloss nor normals: one is stated, the other stay flat".into());
        }
    }
    if crate::truth_path(folder, Side::Front).exists() {
        found.notes.push("synthetic: the folder holds the truth".into());
    }
    found.manifest = Some(manifest);
    found
}
