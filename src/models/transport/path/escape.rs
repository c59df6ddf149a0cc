//! Paths from a point of the scene outwards: where they leave it, and the light that comes in along them.

use super::{FOLLOWED, MOST_CARRIED, MOST_SCATTERINGS, PathSampler, PathTracer, goes_on};
use crate::accelerate::Ray;
use crate::path::scattering::ScatterPoint;
use crate::stage::SideBy;
use glam::DVec3;

/// The end of a path that left the scene.
pub(crate) struct Escape {
    /// The direction in which it left (a unit vector).
    pub direction: DVec3,
    /// The share of light from there that the path transports, for each channel.
    pub carried: [f64; 3],
    /// Whether it met nothing on its way.
    pub straight: bool,
}

impl PathTracer<'_> {
    /// Follows a path along `ray` (of unit direction) until it leaves the scene. `None` where it ends inside, at random
    /// or because it carries nothing any more.
    pub(crate) fn escape(&self, mut ray: Ray, samples: &mut PathSampler) -> Option<Escape> {
        let mut carried = [1.0; 3];
        for turned in 0..MOST_SCATTERINGS {
            let Some(met) = self.stage.nearest(&ray) else {
                return Some(Escape { direction: ray.direction, carried, straight: turned == 0 });
            };
            if turned > FOLLOWED && !goes_on(&mut carried, samples) {
                return None;
            }
            let surface = self.stage.surface(&met, SideBy::Triangle);
            let scatter = ScatterPoint::new(&self.stage, &surface, carried, surface.rho_t());
            let turn = scatter.draw(samples.next())?;
            (0..3).for_each(|c| carried[c] *= turn.weight[c]);
            if carried.iter().any(|c| *c > MOST_CARRIED) {
                return None;
            }
            ray = self.stage.leave(surface.point, surface.flat, turn.direction);
        }
        None
    }

    /// Radiance that arrives along `ray` against its (unit) direction, from sky and surfaces, without the sun's disk.
    pub(crate) fn arriving(&self, ray: Ray, samples: &mut PathSampler) -> [f64; 3] {
        let brought = self.follow(ray, samples);
        if brought.met { brought.radiance } else { self.sky(ray.direction) }
    }

    /// Radiance of the sky in a direction, without the sun's disk.
    pub(crate) fn sky(&self, direction: DVec3) -> [f64; 3] {
        self.lights.sky(direction)
    }
}
