//! The scene around a fitted leaf, for verbs that are given a fit's folder in place of a scene.

use super::SceneManifest;
use crate::{Error, Result};
use mesophyll_fits::record::{FitKind, FitRecord};
use std::path::Path;

impl SceneManifest {
    /// Reads a scene file. Where `path` is the folder of a leaf's fit, the scene around this leaf is made: from both
    /// sides, over a ground, in sun and sky.
    ///
    /// # Errors
    /// As [`SceneManifest::read`]; [`Error::Input`] where a folder holds no fit of a leaf.
    pub fn of(path: &Path) -> Result<SceneManifest> {
        if path.is_dir() { SceneManifest::around(path) } else { SceneManifest::read(path) }
    }

    /// The scene around the leaf whose fit is in the folder `fit`.
    ///
    /// # Errors
    /// [`Error::Input`] where the folder holds no fit of a leaf.
    pub fn around(fit: &Path) -> Result<SceneManifest> {
        let head = fit.join("fit.toml");
        if !head.exists() {
            let expected = "a scene file, or the folder of a leaf's fit";
            return Err(Error::unexpected(fit, "scene", "a folder without fit.toml", expected));
        }
        let record = FitRecord::read(fit)?;
        if record.kind != FitKind::Leaf {
            let found = format!("a fit of the kind {}", record.kind);
            return Err(Error::unexpected(&head, "kind", found, "a leaf's fit, which a scene can be made around"));
        }
        let fit = std::path::absolute(fit).map_err(|e| Error::input(fit, e))?;
        let name = fit.file_name().map_or("leaf".into(), |n| n.to_string_lossy().into_owned());
        // The leaf fills a circle of 30 degrees, seen from 37 degrees beside its normal: pictures and windows of any
        // shape hold it.
        let [width, height] = extent(&record).unwrap_or([100.0; 2]);
        let far = 0.5 * height.max(width) / 15f64.to_radians().sin();
        let (side, up) = (-0.6 * far, 0.8 * far);
        // Both eyes are above the ground. It reaches as far as the views see it; beyond, the ground of the sky goes on.
        let numbers = [("SIDE", side), ("UP", up), ("LOW", 2.0 * up), ("WIDE", 12.0 * far), ("GRAIN", 0.04 * far)];
        let text =
            numbers.iter().fold(AROUND.to_string(), |text, (word, value)| text.replace(word, &format!("{value:.3}")));
        // The name comes last, because it may hold any word.
        let text = text.replace("NAME", &toml::Value::from(name).to_string());
        SceneManifest::parse(&text, &fit.join("fit.toml"))
    }
}

/// Width and height of a fit's maps, in mm.
fn extent(record: &FitRecord) -> Option<[f64; 2]> {
    let number = |text: &str| text.parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0);
    let (width, height) = record.options.get("size")?.split_once('x')?;
    let texel_mm = number(record.options.get("texel_mm")?)?;
    Some([number(width)? * texel_mm, number(height)? * texel_mm])
}

/// The scene around a fit: ground, sky and camera of the gallery. Channels of a fit are the bands that leaves are
/// measured in. `exposure` is for the window's check, which has no film.
const AROUND: &str = r#"
schema = 1
name = NAME
exposure = 0.15
channels = "bands"

[[leaf]]
name = NAME
fit = "."

[[instance]]
leaf = NAME

[ground]
albedo = [0.06, 0.055, 0.04]
height_mm = -LOW
reach_mm = WIDE
grain_mm = GRAIN
contrast = 0.4

[sun]
zenith_deg = 48
azimuth_deg = 150

[sky]
model = "preetham"
turbidity = 3
ground_albedo = [0.06, 0.055, 0.04]

[camera]
f_number = 9.5
shutter_s = 0.008

[[view]]
name = "front"
kind = "perspective"
eye_mm = [0, SIDE, UP]
target_mm = [0, 0, 0]
fov_deg = 30

[[view]]
name = "back"
kind = "perspective"
eye_mm = [0, SIDE, -UP]
target_mm = [0, 0, 0]
fov_deg = 30

[check]
width = 800
height = 600
"#;
