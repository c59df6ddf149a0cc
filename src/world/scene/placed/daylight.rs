//! The physical sky of a scene: a model's sky at a turbidity, turned to the sun's azimuth and in the scene's unit,
//! with the sun's own light and the light that the ground returns. The renderer gets harmonics of it, and the reference
//! gets the function itself.
//!
//! Unit: 1 kcd/m² is `scale` scene units of radiance, and so 1 klx is `scale` scene units of irradiance. For a fixed
//! sun, the N² coefficients are integrated. A sun that moves takes them from the polynomial fit, which is made once,
//! and only for such a sun.

use crate::manifest::{SceneManifest, SceneSun};
use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use glam::DVec3;
use mesophyll_fits::sky as fit;
use mesophyll_sky::polynomials::FoldedPolynomials;
use mesophyll_sky::{HarmonicCoefficients, HosekWilkie, Preetham, Sky, SkyFamily, SkyModel, SkyRefusal};
use mesophyll_sky::{harmonics, irradiance, projection, sun};
use mesophyll_transport::ReferenceSun;
use mesophyll_transport::tone::display;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Perez coefficients A … E of luminance and chromaticities, and the factors of Y, Y/y and Y·x/y in the scene's unit.
pub type PerezCoefficients = ([[f64; 5]; 3], [f64; 3]);

/// One sky above the horizon, with its sun and ground. Everything is in the scene's unit.
#[derive(Debug, Clone)]
pub struct Daylight {
    sky: Arc<dyn Sky>,
    /// Perez coefficients and factors; `None` for a model that has none.
    perez: Option<PerezCoefficients>,
    /// Turbidity, from 2 (clear) to 10 (hazy).
    pub turbidity: f64,
    /// Zenith angle of the sun (rad).
    pub zenith: f64,
    /// Azimuth of the sun (rad), from +x towards +y.
    pub azimuth: f64,
    /// Scene units of radiance for 1 kcd/m².
    pub scale: f64,
    /// Irradiance of the sun on a surface that faces it.
    pub sun: [f64; 3],
    albedo: Option<[f64; 3]>,
    /// Irradiance of the sky on level ground.
    pub level: [f64; 3],
}

/// The sky's light for the renderer.
#[derive(Debug, Clone, PartialEq)]
pub struct DaylightCoefficients {
    /// Harmonics of the radiance all around.
    pub harmonics: HarmonicCoefficients,
    /// Radiance below the horizon; `None` where the sky has no ground.
    pub ground: Option<[f64; 3]>,
}

/// The direction towards a sun.
pub fn direction(zenith: f64, azimuth: f64) -> DVec3 {
    DVec3::new(zenith.sin() * azimuth.cos(), zenith.sin() * azimuth.sin(), zenith.cos())
}

/// The direction towards the scene's sun.
pub fn sun_direction(manifest: &SceneManifest) -> Option<DVec3> {
    manifest.sun.as_ref().map(|s| direction(s.zenith_deg.to_radians(), s.azimuth_deg.to_radians()))
}

/// The directions towards the sun at all its places: the scene's own, and that of each hour of its day.
pub fn sun_directions(manifest: &SceneManifest) -> Vec<DVec3> {
    let hours = manifest.day.iter().flat_map(|day| day.hours.iter().map(|hour| day.sun(*hour)));
    sun_direction(manifest).into_iter().chain(hours.map(|(zenith, azimuth)| direction(zenith, azimuth))).collect()
}

/// The scene's sun, with its own light or that of the physical sky that it stands in.
///
/// # Errors
/// As [`Daylight::of`].
pub fn sun_disk(manifest: &SceneManifest) -> Result<Option<ReferenceSun>> {
    let (Some(direction), Some(stated)) = (sun_direction(manifest), &manifest.sun) else { return Ok(None) };
    let own = Daylight::of(manifest)?.map(|d| d.sun);
    let irradiance = stated.irradiance().or(own).unwrap_or_default();
    Ok(Some(ReferenceSun { direction, irradiance, radius: stated.radius_deg.to_radians() }))
}

/// Irradiance of the sun and mean radiance of the sky, in the scene's unit; 0 for one that is absent.
pub fn levels(manifest: &SceneManifest) -> ([f64; 3], [f64; 3]) {
    if let Ok(Some(daylight)) = Daylight::of(manifest) {
        return (daylight.sun, daylight.level.map(|e| e / PI));
    }
    let sun = manifest.sun.as_ref().and_then(SceneSun::irradiance).unwrap_or_default();
    let sky = manifest.pictured().map(|p| p.rest.mean()).or_else(|| manifest.even_sky());
    (sun, sky.unwrap_or_default())
}

impl Daylight {
    /// The physical sky of the scene, if it has one.
    ///
    /// # Errors
    /// [`Error::Input`] for a sun or turbidity that the model refuses.
    pub fn of(manifest: &SceneManifest) -> Result<Option<Daylight>> {
        let (Some(sky), Some(sun)) = (manifest.physical_sky(), &manifest.sun) else { return Ok(None) };
        Daylight::at(manifest, sun.zenith_deg.to_radians(), sun.azimuth_deg.to_radians(), sky.turbidity).map(Some)
    }

    /// The scene's sky with another sun (rad) and turbidity. An irradiance of the sun that the scene states is kept.
    ///
    /// # Errors
    /// As [`Daylight::of`].
    pub fn at(manifest: &SceneManifest, zenith: f64, azimuth: f64, turbidity: f64) -> Result<Daylight> {
        let refused = |e: SkyRefusal| Error::field(&manifest.path, "sky", e.to_string());
        let told = manifest.physical_sky();
        let scale = told.and_then(|s| s.scale).unwrap_or(1.0);
        let albedo = told.and_then(|s| s.ground_albedo);
        let (sky, perez): (Arc<dyn Sky>, _) = match told.map(|s| s.model).unwrap_or_default() {
            SkyModel::Preetham => {
                let sky = Preetham.at(zenith, turbidity).map_err(refused)?;
                let perez = (sky.turbid().perez(), sky.prefactors().map(|v| v * scale));
                (Arc::new(sky), Some(perez))
            }
            SkyModel::HosekWilkie => {
                let model = HosekWilkie { albedo: albedo.unwrap_or_default() };
                (Arc::from(model.sky(zenith, turbidity).map_err(refused)?), None)
            }
        };
        let stated = manifest.sun.as_ref().and_then(SceneSun::irradiance);
        let level = irradiance::on_level_ground(&projection::direct(sky.as_ref(), 2)).map(|v| v * scale);
        let sun = stated.unwrap_or_else(|| sun::irradiance(zenith, turbidity).map(|v| v * scale));
        Ok(Daylight { perez, turbidity, zenith: sky.sun_zenith(), azimuth, scale, sun, albedo, level, sky })
    }

    /// Irradiance of the sun on level ground.
    fn sun_on_ground(&self) -> [f64; 3] {
        self.sun.map(|e| e * self.zenith.cos().max(0.0))
    }

    /// Radiance of a matte ground under this sky and sun.
    pub fn ground(&self) -> Option<[f64; 3]> {
        let sun = self.sun_on_ground();
        self.albedo.map(|a| [0, 1, 2].map(|c| a[c] * (self.level[c] + sun[c]) / PI))
    }

    /// The sky itself, by direct evaluation: radiance from the unit direction `d`. Below the horizon it is that of the
    /// ground.
    pub fn radiance(&self, d: DVec3) -> [f64; 3] {
        if d.z <= 0.0 {
            return self.ground().unwrap_or([0.0; 3]);
        }
        let (sin, cos) = self.azimuth.sin_cos();
        self.sky.rgb([cos * d.x + sin * d.y, cos * d.y - sin * d.x, d.z]).map(|v| v * self.scale)
    }

    /// N² coefficients of the light all around, in world directions: by integration, or from the polynomials if they
    /// are given.
    ///
    /// # Errors
    /// [`Error::Usage`] for a sun or turbidity outside the fit's range.
    pub fn light(&self, bands: usize, polynomials: Option<&FoldedPolynomials<f32>>) -> Result<DaylightCoefficients> {
        let sky = match polynomials {
            Some(f) => f.coefficients(self.zenith, self.turbidity).map_err(|e| Error::Usage(e.to_string()))?,
            None => projection::direct(self.sky.as_ref(), bands.max(2)),
        };
        let sun = self.sun_on_ground().map(|v| v / self.scale);
        let level = irradiance::on_level_ground(&sky);
        let ground = self.albedo.map(|a| [0, 1, 2].map(|c| self.scale * a[c] * (level[c] + sun[c]) / PI));
        let mut whole =
            self.albedo.map_or_else(|| sky.clone(), |a| irradiance::add_ground(&sky, a, sun)).truncated(bands);
        whole.values_mut().iter_mut().for_each(|v| *v = v.map(|x| self.scale * x));
        Ok(DaylightCoefficients { harmonics: harmonics::rotate_z(&whole, self.azimuth), ground })
    }

    /// The Perez coefficients and factors, for drawing the sky; `None` for a model that has none.
    pub fn perez(&self) -> Option<PerezCoefficients> {
        self.perez
    }

    /// The error that each number of bands causes on a matte leaf that reflects a tenth: the largest error of a
    /// displayed value over all normals, compared with an integration of the sky itself.
    pub fn truncation(&self, bands: &[usize], exposure: f64) -> Result<Vec<f64>> {
        let mut nodes: Vec<(DVec3, [f64; 3])> = Vec::new();
        for (sign, rings, spokes) in [(1.0, 40, 96), (-1.0, 20, 48)] {
            for i in 0..rings {
                let t = (f64::from(i) + 0.5) / f64::from(rings);
                let z = sign * t * t;
                for k in 0..spokes {
                    let (sin, cos) = (TAU * (f64::from(k) + 0.5) / f64::from(spokes)).sin_cos();
                    let d = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
                    let weight = 2.0 * t / f64::from(rings) * TAU / f64::from(spokes);
                    nodes.push((d, self.radiance(d).map(|v| v * weight)));
                }
            }
        }
        let golden = PI * (3.0 - 5f64.sqrt());
        let normals: Vec<DVec3> = (0..100)
            .map(|k| (1.0 - (f64::from(k) + 0.5) / 50.0, golden * f64::from(k)))
            .map(|(z, phi)| DVec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z))
            .collect();
        let truth: Vec<[f64; 3]> = normals
            .iter()
            .map(|n| {
                nodes.iter().fold([0.0; 3], |sum, (d, l)| {
                    let c = n.dot(*d).max(0.0);
                    [0, 1, 2].map(|k| sum[k] + c * l[k])
                })
            })
            .collect();
        let shown = |e: f64| display(0.1 * e.max(0.0) / PI, exposure);
        bands
            .iter()
            .map(|&n| {
                let c = irradiance::convolved(&self.light(n, None)?.harmonics);
                let basis = harmonics::HarmonicBasis::new(n);
                let errors = normals.iter().zip(&truth).flat_map(|(normal, e)| {
                    let seen = basis.sum(&c, normal.to_array());
                    [0, 1, 2].map(|k| (shown(seen[k]) - shown(e[k])).abs())
                });
                Ok(errors.fold(0.0, f64::max))
            })
            .collect()
    }
}

/// The polynomials of the scene's sky, if the sun `moves`. The fit is made once in a process, and noted at that time.
/// Other scenes run no fit, nor do those with another model than Preetham's: there each sun is integrated.
///
/// # Errors
/// [`Error::Missed`] where the fit fails.
pub fn polynomials(
    manifest: &SceneManifest,
    moves: bool,
    ledger: &Ledger,
) -> Result<Option<&'static FoldedPolynomials<f32>>> {
    let fitted = manifest.physical_sky().map(|s| s.model) == Some(SkyModel::Preetham);
    match (moves && fitted, ledger.count("fit", "sky")) {
        (false, _) => Ok(None),
        (true, 0) => ledger.note("fit", "sky", 0, fit::standard).map(Some),
        (true, _) => fit::standard().map(Some),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::SceneDay;

    fn manifest(sky: &str) -> SceneManifest {
        let text = format!(
            "schema = 1\nname = \"s\"\ntolerance = 0.004\n[[leaf]]\nname = \"elm\"\nfit = \"f\"\n[[instance]]\nleaf \
             = \"elm\"\n\
             [sun]\nzenith_deg = 50\nazimuth_deg = 70\n[sky]\nmodel = \"preetham\"\nturbidity = 3\n{sky}\n\
             [[view]]\nname = \"a\"\nkind = \"perspective\"\neye_mm = [0, -10, 100]\ntarget_mm = [0, 0, 0]\nfov_deg = \
             30\nflip_p99 = 0.1\nmax_error = 0.1\n"
        );
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.toml");
        std::fs::write(&path, text).unwrap();
        SceneManifest::read(&path).unwrap()
    }

    /// At the equinox the sun rises in the east at six. At noon it is in the south at the latitude's angle, and the
    /// afternoon mirrors the morning.
    #[test]
    fn the_sun_goes_its_way() {
        let day = SceneDay { latitude_deg: 50.0, declination_deg: 0.0, hours: Vec::new() };
        let (z, a) = day.sun(6.0);
        assert!((z - PI / 2.0).abs() < 1e-12 && a.abs() < 1e-12, "{z} {a}");
        let (z, a) = day.sun(12.0);
        assert!((z.to_degrees() - 50.0).abs() < 1e-9 && (a + PI / 2.0).abs() < 1e-12);
        let ((z1, a1), (z2, a2)) = (day.sun(9.0), day.sun(15.0));
        assert!((z1 - z2).abs() < 1e-12 && (direction(z1, a1).x + direction(z2, a2).x).abs() < 1e-12);
    }

    /// With many bands, the harmonics reproduce sky and ground where these are smooth, and the irradiance of level
    /// ground.
    #[test]
    fn harmonics_are_of_the_sky_that_is_looked_at() {
        let d = Daylight::of(&manifest("ground_albedo = [0.2, 0.3, 0.1]\nscale = 0.5")).unwrap().unwrap();
        let c = d.light(40, None).unwrap();
        let basis = harmonics::HarmonicBasis::new(40);
        for (z, phi) in [(0.9f64, 0.3f64), (0.5, 2.0), (-0.6, 1.0), (-0.9, -2.0)] {
            let n = DVec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z);
            let (seen, true_sky) = (basis.sum(&c.harmonics, n.to_array()), d.radiance(n));
            for k in 0..3 {
                assert!((seen[k] - true_sky[k]).abs() < 0.05 * true_sky[1], "{n}: {seen:?} {true_sky:?}");
            }
        }
        // The sky turns with the sun, and is brightest on its side.
        let side = |turn: f64| d.radiance(direction(0.6, d.azimuth + turn))[1];
        assert!(side(0.0) > side(1.5) && (side(0.7) / side(-0.7) - 1.0).abs() < 1e-12);
        let plain = Daylight::of(&manifest("")).unwrap().unwrap();
        assert!((plain.level[1] / d.level[1] - 2.0).abs() < 1e-12 && (plain.sun[0] / d.sun[0] - 2.0).abs() < 1e-12);
    }

    /// The fit agrees with the integration to 1e-5 of it. More bands have smaller errors.
    #[test]
    fn polynomials_and_integration_agree() {
        let d = Daylight::of(&manifest("ground_albedo = [0.2, 0.2, 0.2]")).unwrap().unwrap();
        let (a, b) = (d.light(7, None).unwrap(), d.light(7, Some(fit::standard().unwrap())).unwrap());
        let c00 = a.harmonics.get(0, 0)[1];
        assert!(a.harmonics.distance(&b.harmonics).iter().all(|e| *e < 1e-4 * c00));
        let cost = d.truncation(&[3, 5, 7], 0.05).unwrap();
        assert!(cost[2] < cost[0] && cost[2] < 0.02, "{cost:?}");
    }
}
