//! The light of a scene: a sun, a sky, and the hours of a day.

use super::table::StatedTable;
use crate::manifest::Result;
use crate::manifest::picture::PictureSky;
use mesophyll_sky::SkyModel;
use mesophyll_sky::sun::RADIUS_DEG;
use mesophyll_transport::transfer::TransferMethod;
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;

/// The sun as a disk.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneSun {
    /// Angle from straight up. With more than 90 the sun shines from below.
    pub zenith_deg: f64,
    /// Azimuth, from +x towards +y.
    pub azimuth_deg: f64,
    /// Where its light comes from.
    pub light: SunLight,
    /// Angular radius of the disk; the real sun's when absent.
    pub radius_deg: f64,
    /// Whether the sun will also stand elsewhere. Then the sky comes from the polynomial fit.
    pub moves: bool,
}

/// The irradiance of a surface that faces the sun.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SunLight {
    /// As the scene states it.
    Stated([f64; 3]),
    /// That of the model of a physical sky.
    Sky,
    /// Taken from the picture of the sky, which the path tracer draws as it is.
    Picture([f64; 3]),
}

impl SceneSun {
    /// Its irradiance, unless that is the model's own.
    pub fn irradiance(&self) -> Option<[f64; 3]> {
        match self.light {
            SunLight::Stated(light) | SunLight::Picture(light) => Some(light),
            SunLight::Sky => None,
        }
    }

    /// Reads the sun that stands in `sky`.
    pub(super) fn read(mut t: StatedTable, sky: Option<&SceneSky>) -> Result<SceneSun> {
        let physical = matches!(sky, Some(SceneSky::Physical(_)));
        let (zenith_deg, azimuth_deg) = (t.needed("zenith_deg")?, t.stated("azimuth_deg")?.unwrap_or_default());
        let light = match t.stated("irradiance")? {
            Some(irradiance) => SunLight::Stated(irradiance),
            None if physical => SunLight::Sky,
            None => {
                let what = "missing; only a sun under a physical sky has its light from the model";
                return Err(t.missing("irradiance", what));
            }
        };
        let radius_deg = t.stated("radius_deg")?.unwrap_or(RADIUS_DEG);
        let moves = t.stated("moves")?.unwrap_or_default();
        t.finish(", which is no field of a sun")?;
        Ok(SceneSun { zenith_deg, azimuth_deg, light, radius_deg, moves })
    }
}

/// Where the sun of a sky that is a picture is to be found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum SunLocation {
    /// The picture shows it.
    #[serde(rename = "in the picture")]
    Picture,
}

/// The sky of a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum SceneSky {
    /// The same radiance all around.
    Even([f64; 3]),
    /// A picture of everything around.
    Picture(StatedPanorama),
    /// A physical model above the horizon.
    Physical(PhysicalSky),
}

/// An environment map: a panorama of everything around, OpenEXR or Radiance.
#[derive(Debug, Clone, PartialEq)]
pub struct StatedPanorama {
    /// The file.
    pub environment: PathBuf,
    /// By how much it is turned from +x towards +y.
    pub rotation_deg: Option<f64>,
    /// Scene units of radiance for 1 in the file; 1 when absent.
    pub scale: Option<f64>,
    /// Where the sun is; when absent, it is taken from the environment map if that shows one and there is no
    /// [`SceneSun`].
    pub sun: Option<SunLocation>,
    /// The environment map itself, as read.
    pub picture: Option<Arc<PictureSky>>,
}

/// A physical sky.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhysicalSky {
    /// The model.
    pub model: SkyModel,
    /// Turbidity, from 2 (clear) to 10 (hazy).
    pub turbidity: f64,
    /// Reflectance of a level, matte ground that lights the scene from below; there is none when absent.
    pub ground_albedo: Option<[f64; 3]>,
    /// Scene units of radiance for 1 kcd/m²; 1 when absent.
    pub scale: Option<f64>,
}

impl SceneSky {
    /// Scene units of radiance for the sky's own unit, where the scene states them.
    pub fn scale(&self) -> Option<f64> {
        match self {
            SceneSky::Even(_) => None,
            SceneSky::Picture(sky) => sky.scale,
            SceneSky::Physical(sky) => sky.scale,
        }
    }

    pub(super) fn read(mut t: StatedTable) -> Result<SceneSky> {
        let (sky, beside) = if t.has("radiance") {
            (SceneSky::Even(t.needed("radiance")?), " beside radiance, which is all of a constant sky")
        } else if t.has("environment") {
            let (environment, rotation_deg, picture) = (t.needed("environment")?, t.stated("rotation_deg")?, None);
            let (scale, sun) = (t.stated("scale")?, t.stated("sun")?);
            let panorama = StatedPanorama { environment, rotation_deg, scale, sun, picture };
            (SceneSky::Picture(panorama), " beside environment, which is the whole sky")
        } else if t.has("model") {
            t.called = "a physical sky".into();
            let (model, turbidity) = (t.needed("model")?, t.needed("turbidity")?);
            let (ground_albedo, scale) = (t.stated("ground_albedo")?, t.stated("scale")?);
            let sky = PhysicalSky { model, turbidity, ground_albedo, scale };
            (SceneSky::Physical(sky), " beside model, whose sky is turned to its [sun]")
        } else {
            let what = "missing, and no model or environment either; expected a constant radiance, model = \
                        \"preetham\" or an environment map";
            return Err(t.missing("radiance", what));
        };
        t.finish(beside)?;
        Ok(sky)
    }
}

/// Light between leaves, which is computed before the first picture (`mesophyll fit transfer`), and its resolution.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneTransfer {
    /// A folder of `fit transfer`. Where it is absent or belongs to another scene, a run makes its own.
    pub fit: Option<PathBuf>,
    /// How the light is found: by `"paths"` through all scatterings, or by `"ambient-occlusion"`, which follows one ray
    /// each and estimates what surfaces in the way show.
    pub method: TransferMethod,
    /// Number of anchors along a leaf and across it.
    pub anchors: [usize; 2],
    /// Number of paths from each anchor.
    pub paths: u32,
    /// Number of bands of the light's harmonics, for a light that moves. When absent, it is 5 where the sun moves.
    /// Where the sun stands still, no harmonics are used, but the light itself.
    pub bands: Option<usize>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Whether the copies that an `[[instance]]` places by a list show the light of one of them
    /// ([`crate::plan::shared_light::sources`]).
    pub shared: bool,
    /// How the sun's own shadows are drawn.
    pub shadows: SceneShadows,
    /// With `shadows = "visibility"`, the longest edge of the meshes. The share of the sun is known at their vertices.
    pub edge_mm: f64,
}

impl Default for SceneTransfer {
    fn default() -> Self {
        SceneTransfer {
            fit: None,
            method: TransferMethod::default(),
            anchors: [5, 3],
            paths: 2048,
            bands: None,
            seed: 1,
            shared: false,
            shadows: SceneShadows::default(),
            edge_mm: 1.2,
        }
    }
}

/// How shadows of the sun are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneShadows {
    /// Shadow maps, which are drawn in the picture's own time.
    #[default]
    Maps,
    /// The share of the sun that every vertex sees, which is computed beforehand.
    Visibility,
}

/// A day with solar hours at which the scene is drawn too.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneDay {
    /// Latitude, positive to the north.
    pub latitude_deg: f64,
    /// Declination of the sun: 0 at the equinoxes, 23.44 in June.
    #[serde(default)]
    pub declination_deg: f64,
    /// Solar hours; 12 is noon.
    pub hours: Vec<f64>,
}

impl SceneDay {
    /// Zenith angle and azimuth (rad) of the sun at a solar hour. +x is east and +y is north.
    pub fn sun(&self, hour: f64) -> (f64, f64) {
        mesophyll_sky::solar_path::sun_place(self.latitude_deg, self.declination_deg, hour)
    }
}

/// Where the sun stands at an hour of a day, in words.
pub fn sun_words(hour: f64, zenith_deg: f64, azimuth_deg: f64) -> String {
    format!("hour {hour}: sun {zenith_deg:.2}° from the zenith, azimuth {azimuth_deg:.2}°")
}
