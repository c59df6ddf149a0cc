//! A canopy as in remote sensing: its bidirectional reflectance factor from above, and what becomes of the sun's light.
//!
//! ```text
//! BRF = π L / (E cos θs), L the mean radiance of the scene's rectangle at its top, E the sun's irradiance
//! reflected + absorbed by what is not ground + (1 − albedo of the ground) · transmitted = 1
//! ```
//! L is the mean radiance of the scene's rectangle at its top, and E is the sun's irradiance. "Transmitted" is all
//! light that reaches the ground (or leaves at the bottom where there is no ground). Light that the ground sends up and
//! leaves send down again counts twice (RAMI4PILPS, Widlowski et al. 2011). All shares are relative to the flux that
//! falls on the rectangle. Standard errors come from independent randomisations. For fluxes the sun is a point, and
//! light passes leaves by ρt alone, without maps of sunlight. With mapped normals they are not exact, because light and
//! view cannot quite be exchanged then (Veach 1997, §5.3).

use super::estimate::{Estimate, estimate};
use super::samples::PathSampler;
use super::{MOST_SCATTERINGS, PathSettings, PathTracer, goes_on};
use crate::accelerate::Ray;
use crate::seeds::mix;
use crate::stage::SideBy;
use crate::world::ReferenceWorld;
use glam::DVec3;
use std::f64::consts::PI;

/// Shares of the incident flux.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CanopyFluxes {
    /// Light that leaves the scene upwards.
    pub reflected: Estimate,
    /// Light that is absorbed by everything except the ground.
    pub absorbed: Estimate,
    /// Light that reaches the ground.
    pub transmitted: Estimate,
    /// Their sum, where only the part of the transmitted light that the ground absorbs counts. It is 1, except for
    /// noise.
    pub closure: Estimate,
}

/// A periodic world under a sun.
pub struct Canopy<'a> {
    tracer: PathTracer<'a>,
    /// Half the period (mm).
    half: [f64; 2],
    /// Height at which rays from above begin.
    top: f64,
    sun: DVec3,
    irradiance: [f64; 3],
    seed: u64,
}

impl<'a> Canopy<'a> {
    /// # Errors
    /// A sentence about a world that is no canopy: it does not repeat, is empty, has no sun above the horizon, or has a
    /// sky; or [`ReferenceWorld::validate`] refuses it.
    pub fn new(world: &'a ReferenceWorld, seed: u64) -> Result<Canopy<'a>, String> {
        let bad = |what: &str| Err(what.to_string());
        let Some(size) = world.periodic else { return bad("the scene does not repeat; expected a [periodic]") };
        let Some(sun) = world.sun.as_ref().filter(|s| s.direction.z > 0.0) else {
            return bad("there is no [sun] above the horizon; a reflectance factor needs one");
        };
        if world.sky.is_some() || world.dome.is_some() || world.environment.is_some() {
            return bad("there is a [sky]; a reflectance factor is of the sun's light alone");
        }
        if world.background != [0.0; 3] {
            return bad("background: is not black; a reflectance factor is of the sun's light alone");
        }
        let tracer = PathTracer::new(world, PathSettings::default()).map_err(|e| e.to_string())?;
        let Some([_, high]) = tracer.stage.bounds() else { return bad("there is nothing in it") };
        Ok(Canopy {
            half: size.map(|s| 0.5 * s),
            top: high.z + tracer.stage.step(),
            sun: sun.direction.normalize(),
            irradiance: sun.irradiance,
            seed,
            tracer,
        })
    }

    /// The canopy with rays from above that begin at this height (mm) at least. Canopies of which one has more leaves
    /// than another then have the same rays.
    #[must_use]
    pub fn from_above(self, height: f64) -> Self {
        Canopy { top: self.top.max(height), ..self }
    }

    /// The seed of the paths towards a direction.
    pub(super) fn key(&self, [zenith, azimuth]: [f64; 2]) -> u64 {
        let (sin, cos) = zenith.sin_cos();
        [sin * azimuth.cos(), sin * azimuth.sin(), cos].iter().fold(self.seed, |key, x| mix(key, x.to_bits()))
    }

    /// The seed of paths that follow the light.
    pub(super) fn flux_key(&self) -> u64 {
        mix(self.seed, 4)
    }

    /// A ray of the sun's light.
    pub(super) fn lit(&self, at: [f64; 2]) -> Ray {
        self.enter(-self.sun, at)
    }

    /// The tracer of its light.
    pub fn tracer(&self) -> &PathTracer<'a> {
        &self.tracer
    }

    /// A ray from a random place of the rectangle, against the light that leaves it towards `[zenith, azimuth]` (rad).
    pub(super) fn seen_from(&self, [zenith, azimuth]: [f64; 2], at: [f64; 2]) -> Ray {
        let (sin, cos) = zenith.sin_cos();
        self.enter(-DVec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos), at)
    }

    /// The reflectance factor for a radiance of 1 in each channel.
    pub(super) fn factors(&self) -> [f64; 3] {
        self.irradiance.map(|e| PI / (e * self.sun.z))
    }

    /// The reflectance factor for a radiance of 1 under a sun of irradiance 1.
    pub(super) fn factor_of_unit(&self) -> f64 {
        PI / self.sun.z
    }

    /// Azimuth of the sun (rad), from +x towards +y.
    pub fn sun_azimuth(&self) -> f64 {
        self.sun.y.atan2(self.sun.x)
    }

    /// A ray from a random point of the rectangle at the top, in the direction `d` (downwards).
    fn enter(&self, d: DVec3, [u, v]: [f64; 2]) -> Ray {
        let at = |u: f64, half: f64| (2.0 * u - 1.0) * half;
        Ray::new(DVec3::new(at(u, self.half[0]), at(v, self.half[1]), self.top), d)
    }

    /// The reflectance factor of channel `channel` towards a direction, from `paths` paths: `zenith` (rad) within ±π/2,
    /// `azimuth` (rad) from +x towards +y.
    pub fn brf(&self, [zenith, azimuth]: [f64; 2], channel: usize, paths: u32) -> Estimate {
        let scale = self.factors()[channel];
        let [brf] = estimate(self.key([zenith, azimuth]), paths, |samples| {
            let begun = samples.iter_mut().map(|samples| {
                let [u, v, ..] = samples.next();
                (self.seen_from([zenith, azimuth], [u, v]), samples)
            });
            self.tracer.follow_each(begun).into_iter().map(|path| [scale * path.radiance[channel]]).collect()
        });
        brf
    }

    /// What becomes of the light of channel `channel`, from `paths` paths that follow the light.
    pub fn fluxes(&self, channel: usize, paths: u32) -> CanopyFluxes {
        let [reflected, absorbed, transmitted, closure] = estimate(self.flux_key(), paths, |samples| {
            let follow = |samples: &mut PathSampler| {
                let [u, v, ..] = samples.next();
                self.light(self.lit([u, v]), channel, samples)
            };
            samples.iter_mut().map(follow).collect()
        });
        CanopyFluxes { reflected, absorbed, transmitted, closure }
    }

    /// One path that follows the light: reflected, absorbed, transmitted, and the closing sum.
    fn light(&self, mut ray: Ray, channel: usize, samples: &mut PathSampler) -> [f64; 4] {
        let stage = &self.tracer.stage;
        let mut carried = [1.0; 3];
        let [mut reflected, mut absorbed, mut transmitted, mut in_ground] = [0.0; 4];
        for turned in 1..=MOST_SCATTERINGS {
            let Some(met) = stage.nearest(&ray) else {
                match ray.direction.z > 0.0 {
                    true => reflected += carried[channel],
                    false => {
                        transmitted += carried[channel];
                        in_ground += carried[channel];
                    }
                }
                break;
            };
            let surface = stage.surface(&met, SideBy::Triangle);
            let ground = stage.world.ground == Some(surface.instance);
            let scatter = super::ScatterPoint::new(stage, &surface, carried, surface.rho_t_inward());
            let before = carried[channel];
            let turn = scatter.draw(samples.next());
            carried = turn.as_ref().map_or([0.0; 3], |t| [0, 1, 2].map(|c| carried[c] * t.weight[c]));
            match ground {
                true => {
                    transmitted += before;
                    in_ground += before - carried[channel];
                }
                false => absorbed += before - carried[channel],
            }
            let Some(turn) = turn else { break };
            ray = stage.leave(surface.point, surface.flat, turn.direction);
            if turned > super::FOLLOWED && !goes_on(&mut carried, samples) {
                break;
            }
        }
        [reflected, absorbed, transmitted, reflected + absorbed + in_ground]
    }
}
