//! What lights a scene: a sun, a sky, and the hours of a day.

use serde::Deserialize;
use std::path::PathBuf;

/// The sun as a disk.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sun {
    /// From straight up; more than 90 shines from below.
    pub zenith_deg: f64,
    /// From +x towards +y.
    #[serde(default)]
    pub azimuth_deg: f64,
    /// On a surface that faces the sun; under a physical sky the model's own when absent.
    pub irradiance: Option<[f64; 3]>,
    /// Of the disk; the real sun's when absent.
    #[serde(default = "sun_radius")]
    pub radius_deg: f64,
    /// The sun will stand elsewhere too: the sky comes from the polynomial fit.
    #[serde(default)]
    pub moves: bool,
}

/// A constant sky all around, a physical one above the horizon, or an environment map.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sky {
    /// Of the constant sky.
    pub radiance: Option<[f64; 3]>,
    /// A picture of all that is around, an EXR with zenith angle down and azimuth across.
    pub environment: Option<PathBuf>,
    /// Of the physical one.
    pub model: Option<SkyModel>,
    /// From 2 (clear) to 10 (hazy).
    pub turbidity: Option<f64>,
    /// Of a level, matte ground that lights the scene from below; none when absent.
    pub ground_albedo: Option<[f64; 3]>,
    /// Scene units of radiance a kcd/m²; 1 when absent.
    pub scale: Option<f64>,
}

/// Light between leaves, worked out before the first picture (`mesophyll fit transfer`): how finely.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Transfer {
    /// A folder of `fit transfer`; where it is of another scene, or absent, a run makes one.
    pub fit: Option<PathBuf>,
    /// Anchors along a leaf and across it.
    pub anchors: [usize; 2],
    /// Paths from each anchor.
    pub paths: u32,
    /// Bands of the light's harmonics, for a light that moves. When absent: 5 where the sun moves, and no harmonics
    /// but the light itself where it stands still.
    pub bands: Option<usize>,
    /// Of the random numbers.
    pub seed: u64,
    /// How the sun's own shadows are drawn.
    pub shadows: Shadows,
    /// With `shadows = "visibility"`: the longest edge of the meshes at whose vertices they are known.
    pub edge_mm: f64,
}

impl Default for Transfer {
    fn default() -> Self {
        Transfer {
            fit: None,
            anchors: [5, 3],
            paths: 2048,
            bands: None,
            seed: 1,
            shadows: Shadows::default(),
            edge_mm: 1.2,
        }
    }
}

/// How shadows of the sun are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shadows {
    /// By shadow maps, in the picture's own time.
    #[default]
    Maps,
    /// By the share of the sun that every vertex sees, worked out beforehand.
    Visibility,
}

/// A physical model of the sky.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SkyModel {
    /// Preetham, Shirley and Smits (1999).
    Preetham,
}

/// Solar hours at which the scene is drawn too.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Day {
    /// Positive to the north.
    pub latitude_deg: f64,
    /// Of the sun: 0 at the equinoxes, 23.44 in June.
    #[serde(default)]
    pub declination_deg: f64,
    /// 12 is noon.
    pub hours: Vec<f64>,
}

impl Day {
    /// Zenith angle and azimuth (rad) of the sun at a solar hour; +x is east, +y north.
    pub fn sun(&self, hour: f64) -> (f64, f64) {
        let (sin_d, cos_d) = self.declination_deg.to_radians().sin_cos();
        let (sin_l, cos_l) = self.latitude_deg.to_radians().sin_cos();
        let (sin_h, cos_h) = ((hour - 12.0) * 15.0).to_radians().sin_cos();
        let (east, north, up) =
            (-cos_d * sin_h, cos_l * sin_d - sin_l * cos_d * cos_h, sin_l * sin_d + cos_l * cos_d * cos_h);
        (up.clamp(-1.0, 1.0).acos(), north.atan2(east))
    }
}

fn sun_radius() -> f64 {
    0.2666
}
