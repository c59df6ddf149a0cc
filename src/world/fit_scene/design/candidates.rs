//! The pictures that could be taken: cameras and suns.

use super::SceneDesignOptions;
use crate::photographs::{PixelUse, ReadingKind, ScenePhotograph, hold_back};
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_scene::manifest::SceneManifest;
use mesophyll_transport::ReferenceCamera;

/// Heights of the dome's cameras above what they look at, as the sine of the elevation.
const HEIGHTS: [f64; 2] = [0.05, 0.98];

/// A picture that could be taken.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneCandidate {
    /// Name of its camera: that of a view, or `dome-3`.
    pub camera_name: String,
    /// Its camera.
    pub camera: ReferenceCamera,
    /// Zenith angle and azimuth of its sun (degrees), where that is not the scene's.
    pub sun_deg: Option<[f64; 2]>,
}

impl SceneCandidate {
    /// The picture as number `k`, whose readings nobody knows yet.
    pub fn shot(&self, k: usize, size: [usize; 2], [noise, floor]: [f64; 2]) -> ScenePhotograph {
        let mut uses = vec![PixelUse::Fitted; size[0] * size[1]];
        hold_back(&mut uses, k, false);
        ScenePhotograph {
            name: self.camera_name.clone(),
            by: ReadingKind::Camera(self.camera),
            size,
            channels: 3,
            seen: vec![0.0; 3 * size[0] * size[1]],
            error: None,
            noise,
            floor,
            uses,
            exposure: None,
            sun_deg: self.sun_deg,
            saturated: 0,
        }
    }
}

/// Every camera under every sun.
pub fn all(manifest: &SceneManifest, options: &SceneDesignOptions) -> Result<Vec<SceneCandidate>> {
    let mut cameras: Vec<(String, ReferenceCamera)> =
        manifest.perspectives().map(|view| (view.name.clone(), view.camera)).collect();
    let Some((_, first)) = cameras.first().cloned() else {
        let what = "found no perspective view, expected at least one: it states where cameras look, from how far, and \
                    with which lens";
        return Err(Error::field(&manifest.path, "view", what));
    };
    cameras.extend(dome(&first, options.cameras));
    let mut suns: Vec<Option<[f64; 2]>> = vec![None];
    let of_day = manifest.day.iter().flat_map(|day| day.hours.iter().map(|hour| day.sun(*hour)));
    // A sun on the horizon is in a day and takes no picture that a fit could use.
    let of_day = of_day.map(|(zenith, azimuth)| [zenith, azimuth].map(f64::to_degrees));
    let mut others: Vec<[f64; 2]> = of_day.filter(|sun| manifest.movable_sun(*sun).is_ok()).collect();
    for sun in &options.suns {
        manifest.movable_sun(*sun).map_err(|what| Error::Usage(format!("--suns: {what}")))?;
        others.push(*sun);
    }
    let own = manifest.sun.as_ref().map(|sun| [sun.zenith_deg, sun.azimuth_deg]);
    for sun in others.into_iter().filter(|sun| Some(*sun) != own) {
        if !suns.contains(&Some(sun)) {
            suns.push(Some(sun));
        }
    }
    let under = |sun_deg: &Option<[f64; 2]>| {
        let sun_deg = *sun_deg;
        cameras.iter().map(move |(name, camera)| SceneCandidate { camera_name: name.clone(), camera: *camera, sun_deg })
    };
    Ok(suns.iter().flat_map(under).collect())
}

/// Cameras on the upper half of a sphere around what a camera looks at, as far from it and with the same lens. Each
/// stands for as much of the sphere as any other.
fn dome(like: &ReferenceCamera, count: usize) -> impl Iterator<Item = (String, ReferenceCamera)> {
    let (like, distance) = (*like, like.eye.distance(like.target));
    (0..count).map(move |k| {
        let height = HEIGHTS[0] + (HEIGHTS[1] - HEIGHTS[0]) * (k as f64 + 0.5) / count as f64;
        let (sin, cos) = (k as f64 * std::f64::consts::PI * (3.0 - 5f64.sqrt())).sin_cos();
        let level = (1.0 - height * height).sqrt();
        let eye = like.target + distance * DVec3::new(level * cos, level * sin, height);
        // A camera that looks straight down has no upright direction of its own.
        let up = if height > 0.9 { DVec3::Y } else { DVec3::Z };
        (format!("dome-{}", k + 1), ReferenceCamera { eye, up, ..like })
    })
}
