//! Faults of a leaf under a dome, and of photographs without a laboratory: those that what comes through, the energy
//! and the thickness tell.

use super::edits::{change, flip, scale, shift};
use super::{LEAF, copy, judged};
use crate::stress::StressRow;
use crate::{Error, Result};
use mesophyll_synth::dome;
use mesophyll_synth::photo;
use mesophyll_synth::spec::{InteriorModel, LeafSpec};
use std::path::Path;

/// A fault, and what must be said of it.
type Fault = (&'static str, &'static str, fn(&Path) -> Result<()>);

const DOME: [Fault; 7] = [
    ("none", "ok", |_| Ok(())),
    ("thickness_max_mm in tenths", "noticed: thickness", |c| scale(c, "thickness_max_mm", 100.0)),
    (
        "white sheet that is twelve times darker than stated",
        "refused: the capture: no texel of the front is good",
        |c| change(&c.join("white.exr"), |v| v / 12.0),
    ),
    ("back not turned", "refused: back/height.exr", |c| {
        ["albedo", "translucency", "height"].iter().try_for_each(|name| flip(&c.join(format!("back/{name}.exr"))))
    }),
    ("leaf moved between the sides", "noticed: back-shifted", |c| {
        ["albedo", "translucency", "height"]
            .iter()
            .try_for_each(|name| shift(&c.join(format!("back/{name}.exr")), [2, 1]))
    }),
    ("back light 1.5 times as bright behind the back", "noticed: sides-transmit", |c| {
        change(&c.join("back/translucency.exr"), |v| 1.5 * v)
    }),
    ("even loss of a tenth in all photographs of the leaf", "ok", |c| {
        // Another leaf would look so.
        ["front/albedo", "back/albedo", "front/translucency", "back/translucency"]
            .iter()
            .try_for_each(|name| change(&c.join(format!("{name}.exr")), |v| 0.9 * v))
    }),
];

const PHOTO: [Fault; 4] = [
    ("none", "ok", |_| Ok(())),
    ("thickness_mm in hundredths", "noticed: thickness", |c| scale(c, "thickness_mm", 100.0)),
    ("grey card taken for a white one", "refused: capture.toml: front.card", |c| scale(c, "card.reflectance", 5.0)),
    // The table beside the leaf tells how bright it was, so that nothing is wrong.
    ("table 1.5 times as bright with the leaf's back up", "ok", |c| {
        change(&c.join("table_turned.exr"), |v| (1.5 * v).min(0.98))
    }),
];

/// Runs every fault of both.
///
/// # Errors
/// As [`super::rows`].
pub fn rows() -> Result<Vec<StressRow>> {
    let folder = tempfile::tempdir().map_err(|e| Error::write(&std::env::temp_dir(), e))?;
    let mut spec: LeafSpec = LEAF.parse().map_err(|e| Error::Missed(format!("the stress leaf cannot be read: {e}")))?;
    (spec.veins.tertiary_mm, spec.veins.areole_mm) = (0.0, 0.0);
    let none = || Error::Missed("no texel on the stress leaf".into());
    let mut out = Vec::new();
    for (kind, faults) in [("dome", &DOME[..]), ("photo", &PHOTO[..])] {
        let clean = folder.path().join(kind);
        if kind == "dome" {
            let options = dome::Options {
                width: 48,
                height: 36,
                patch: None,
                noise: 0.01,
                height_noise_mm: 0.01,
                seed: 5,
                model: InteriorModel::Exact,
            };
            let blade = dome::DomeLeaf::grow(&spec, &options)?.ok_or_else(none)?;
            dome::capture(&spec, &blade, &options, &clean)?;
        } else {
            let options =
                photo::Options { width: 160, height: 120, noise: 0.005, seed: 5, model: InteriorModel::Exact };
            let blade = photo::grow(&spec, &options)?.ok_or_else(none)?;
            photo::capture(&spec, &blade, &options, &clean)?;
        }
        for (n, (name, expected, put)) in faults.iter().enumerate() {
            let [capture, fit] = ["capture", "fit"].map(|what| folder.path().join(format!("{kind}-{what}-{n}")));
            copy(&clean, &capture)?;
            put(&capture)?;
            let run = |capture: &Path, fit: &Path| match kind {
                "dome" => mesophyll_fits::dome::run(capture, fit, &Default::default()),
                _ => mesophyll_fits::photo::run(capture, fit, false),
            };
            out.push(judged(&format!("fault of {kind}: {name}"), expected, [&capture, &fit], run)?);
        }
    }
    Ok(out)
}
