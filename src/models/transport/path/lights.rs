//! The lights beyond a scene: the sun's disk, and a sky or an environment map. This module also draws directions
//! towards them.

use super::SamplingStrategy;
use crate::dome::RadianceAt;
use crate::environment::Environment;
use crate::sphere_density::SphereDensity;
use crate::world::{ReferenceSun, ReferenceWorld};
use glam::DVec3;
use mesophyll_sky::panorama;
use std::f64::consts::{PI, TAU};

/// All lights of a scene.
pub struct SceneLights {
    sun: Option<Sun>,
    sky: Sky,
    /// The probability that a drawn direction is towards the sun and not the sky.
    sun_share: f64,
}

/// The sun's disk, with uniform radiance.
struct Sun {
    centre: DVec3,
    across: [DVec3; 2],
    sin_radius: f64,
    /// 1 − cos(radius), which stays accurate for a small disk.
    versine: f64,
    /// Irradiance on a surface that faces the sun.
    irradiance: [f64; 3],
}

enum Sky {
    None,
    /// The same radiance from everywhere.
    Constant([f64; 3]),
    Varying {
        radiance: RadianceAt,
        density: SphereDensity,
    },
}

/// A direction from which light comes.
pub struct LightSample {
    /// Unit vector towards the light.
    pub direction: DVec3,
    /// Radiance over the density of the draw. For a sun without extent, it is the irradiance over the probability of
    /// drawing the sun.
    pub weight: [f64; 3],
    /// Density of the draw (1/sr), which is balanced against a surface's own sampling. `None` where that sampling
    /// cannot hit the light.
    pub density: Option<f64>,
    /// Whether it is the sun.
    pub sun: bool,
    /// The sun's irradiance over the product of its radiance and its solid angle. It is 1 except for a large disk.
    pub level: f64,
}

/// Columns and rows of the table by which a modelled sky is sampled.
const TABLE: [usize; 2] = [512, 256];
/// The least density of a modelled sky, relative to its mean. The table might miss a bright spot between its texels.
const LEAST: f64 = 0.02;

impl SceneLights {
    /// The lights of a world.
    pub fn new(world: &ReferenceWorld) -> SceneLights {
        let sun = world.sun.as_ref().map(Sun::new);
        let (sky, mean) = sky(world);
        // The choice follows the light of both: the sun's irradiance on a surface that faces it, and the sky's on a
        // surface that sees all of it.
        let power = |c: [f64; 3]| c.iter().sum::<f64>();
        let (by_sun, by_sky) = (sun.as_ref().map_or(0.0, |s| power(s.irradiance)), PI * power(mean));
        let sun_share = match (&sun, &sky) {
            (None, _) => 0.0,
            (Some(_), Sky::None) => 1.0,
            _ if by_sun + by_sky > 0.0 => (by_sun / (by_sun + by_sky)).clamp(0.2, 0.8),
            _ => 0.5,
        };
        SceneLights { sun, sky, sun_share }
    }

    /// The probability of drawing the sun. `strategy` decides whether the sky is drawn at all. A constant sky is not
    /// drawn, because its radiance is the same in every direction that a surface draws.
    fn sun_share(&self, strategy: SamplingStrategy) -> f64 {
        let constant = matches!(self.sky, Sky::Constant(_)) && strategy != SamplingStrategy::Lights;
        if self.sun.is_some() && constant { 1.0 } else { self.sun_share }
    }

    /// Whether [`SceneLights::draw`] ever gives a direction.
    pub fn drawn(&self, strategy: SamplingStrategy) -> bool {
        let sky = match &self.sky {
            Sky::None => false,
            Sky::Constant(_) => strategy == SamplingStrategy::Lights,
            Sky::Varying { .. } => true,
        };
        strategy != SamplingStrategy::Surfaces && (self.sun.is_some() || sky)
    }

    /// Draws a direction from four uniform numbers.
    pub fn draw(&self, [choice, u, v, _]: [f64; 4], strategy: SamplingStrategy) -> Option<LightSample> {
        let share = self.sun_share(strategy);
        if let Some(sun) = self.sun.as_ref().filter(|_| choice < share) {
            return Some(if sun.versine > 0.0 {
                let density = share / (TAU * sun.versine);
                LightSample {
                    direction: sun.toward(u, v),
                    weight: sun.radiance().map(|l| l / density),
                    density: Some(density),
                    sun: true,
                    level: 1.0 - 0.5 * sun.versine,
                }
            } else {
                let weight = sun.irradiance.map(|e| e / share);
                LightSample { direction: sun.centre, weight, density: None, sun: true, level: 1.0 }
            });
        }
        let share = 1.0 - share;
        match &self.sky {
            Sky::None => None,
            Sky::Constant(radiance) if strategy == SamplingStrategy::Lights => {
                let (z, (sin, cos)) = (1.0 - 2.0 * u, (TAU * v).sin_cos());
                let r = (1.0 - z * z).max(0.0).sqrt();
                let density = share / (2.0 * TAU);
                Some(LightSample {
                    direction: DVec3::new(r * cos, r * sin, z),
                    weight: radiance.map(|l| l / density),
                    density: Some(density),
                    sun: false,
                    level: 1.0,
                })
            }
            Sky::Constant(_) => None,
            Sky::Varying { radiance, density } => {
                let direction = density.draw([u, v]);
                let density = share * density.of(direction);
                (density > 0.0).then(|| LightSample {
                    direction,
                    weight: radiance(direction).map(|l| l.max(0.0) / density),
                    density: Some(density),
                    sun: false,
                    level: 1.0,
                })
            }
        }
    }

    /// The radiance that a ray sees when it leaves the scene in direction `d`, after a surface drew it with the density
    /// `drawn` (1/sr): that of the sky and of the sun, each times the share of the surface's sampling.
    pub fn seen(&self, d: DVec3, drawn: f64, strategy: SamplingStrategy, with_sun: bool) -> [f64; 3] {
        let share = self.sun_share(strategy);
        let mut sum = [0.0; 3];
        let mut add = |radiance: [f64; 3], weight: f64| (0..3).for_each(|c| sum[c] += radiance[c] * weight);
        match &self.sky {
            Sky::None => {}
            Sky::Constant(radiance) => add(*radiance, if strategy == SamplingStrategy::Lights { 0.0 } else { 1.0 }),
            Sky::Varying { radiance, density } => {
                let weight = strategy.surface(drawn, || (1.0 - share) * density.of(d));
                if weight > 0.0 {
                    add(radiance(d).map(|l| l.max(0.0)), weight);
                }
            }
        }
        if let Some(sun) = self.sun.as_ref().filter(|s| with_sun && s.holds(d)) {
            add(sun.radiance(), strategy.surface(drawn, || share / (TAU * sun.versine)));
        }
        sum
    }

    /// Radiance of the sky alone in direction `d`.
    pub fn sky(&self, d: DVec3) -> [f64; 3] {
        match &self.sky {
            Sky::None => [0.0; 3],
            Sky::Constant(radiance) => *radiance,
            Sky::Varying { radiance, .. } => radiance(d).map(|l| l.max(0.0)),
        }
    }

    /// Radiance of the sun's disk in direction `d`; zero beside it.
    pub fn disk(&self, d: DVec3) -> [f64; 3] {
        self.sun.as_ref().filter(|s| s.holds(d)).map_or([0.0; 3], Sun::radiance)
    }
}

/// A world's sky in the form in which it is sampled, and its mean radiance.
fn sky(world: &ReferenceWorld) -> (Sky, [f64; 3]) {
    if let Some(radiance) = world.sky {
        return (Sky::Constant(radiance), radiance);
    }
    if let Some(environment) = &world.environment {
        let (map, mean) = (environment.clone(), environment.mean());
        return match &environment.density {
            Some(density) => {
                (Sky::Varying { radiance: std::sync::Arc::new(move |d| map.at(d)), density: density.clone() }, mean)
            }
            None => (Sky::None, mean),
        };
    }
    let Some(dome) = &world.dome else { return (Sky::None, [0.0; 3]) };
    let [columns, rows] = TABLE;
    let seen = |d: [f64; 3]| (dome.radiance)(DVec3::from(d)).map(|l| l.max(0.0) as f32);
    let texels: Vec<[f32; 3]> = panorama::centres(columns, rows).map(seen).collect();
    let Ok(map) = Environment::new(columns, rows, texels) else { return (Sky::None, [0.0; 3]) };
    let mean = map.mean();
    let least = (LEAST * mean.iter().sum::<f64>() / 3.0) as f32;
    match map.density.as_ref().and_then(|density| density.raised(least)) {
        Some(density) => (Sky::Varying { radiance: dome.radiance.clone(), density }, mean),
        None => (Sky::None, mean),
    }
}

impl Sun {
    fn new(sun: &ReferenceSun) -> Sun {
        let centre = sun.direction.normalize();
        let (a, b) = centre.any_orthonormal_pair();
        Sun {
            centre,
            across: [a, b],
            sin_radius: sun.radius.sin(),
            versine: 2.0 * (0.5 * sun.radius).sin().powi(2),
            irradiance: sun.irradiance,
        }
    }

    /// E over ∫ cosθ dω of the disk, which is π sin² of its radius. A sun without extent is drawn but never hit.
    fn radiance(&self) -> [f64; 3] {
        self.irradiance.map(|e| e / (PI * self.sin_radius * self.sin_radius))
    }

    /// A direction towards the disk, uniform in solid angle.
    fn toward(&self, u: f64, v: f64) -> DVec3 {
        let x = u * self.versine;
        let (cos, r) = (1.0 - x, (x * (2.0 - x)).sqrt());
        let (sin_phi, cos_phi) = (TAU * v).sin_cos();
        self.centre * cos + (self.across[0] * cos_phi + self.across[1] * sin_phi) * r
    }

    fn holds(&self, d: DVec3) -> bool {
        self.versine > 0.0 && d.dot(self.centre) > 0.0 && d.cross(self.centre).length() < self.sin_radius
    }
}

#[cfg(test)]
pub(super) use tests_support::*;

#[cfg(test)]
mod tests_support {
    use super::*;

    /// Density of the directions that [`Lights::draw`] returns, for tests.
    pub fn density(lights: &SceneLights, d: DVec3, strategy: SamplingStrategy) -> f64 {
        let share = lights.sun_share(strategy);
        let sun = lights.sun.as_ref().filter(|s| s.holds(d)).map_or(0.0, |s| share / (TAU * s.versine));
        let sky = match &lights.sky {
            Sky::None | Sky::Constant(_) => 0.0,
            Sky::Varying { density, .. } => (1.0 - share) * density.of(d),
        };
        sun + sky
    }
}
