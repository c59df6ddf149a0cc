//! The path tracer: light between leaves by following rays from the camera, with no limit to how often they turn.
//!
//! Radiance is estimated by unidirectional paths (Kajiya 1986; Pharr, Jakob & Humphreys 2023, §13–14): at every point a
//! direction towards sun or sky is drawn (next-event estimation) and one by the surface itself; where both could have
//! given the same light, they share it by their densities (Veach & Guibas 1995, balance heuristic). A path ends at
//! random in proportion to what it still carries (Russian roulette), which does not bias the mean.
//!
//! All arithmetic is f64. Limits: surfaces only (no mist, no light inside a blade from one texel to another but for the
//! translucency maps of sunlight); nothing shines but sun, sky and environment.

mod branch;
mod canopy;
mod escape;
mod estimate;
#[cfg(test)]
mod foliar_tests;
mod lights;
mod picture;
mod samples;
mod scatter;
#[cfg(test)]
mod tests;

pub(crate) use crate::Result;
use crate::accelerate::Ray;
use crate::stage::{SideBy, Stage};
use crate::world::World;
pub use canopy::{Canopy, Fluxes};
pub use estimate::Estimate;
use glam::DVec3;
use lights::Lights;
pub use picture::{Picture, Progress, Request, Target};
pub use samples::MOST_PATHS;
pub(crate) use samples::Samples;
use scatter::Scatter;

/// How directions are drawn towards light. All have the same mean; that they do is a test of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Strategy {
    /// By lights and surfaces, each where it is better.
    #[default]
    Both,
    /// By lights alone; a mirror-like gloss is noisy.
    Lights,
    /// By surfaces alone; a small sun is found rarely, one without extent never.
    Surfaces,
}

impl Strategy {
    /// The share of light that falls to a draw by a light with density `light`, where the surface's is `surface`.
    fn light(self, light: f64, surface: impl FnOnce() -> f64) -> f64 {
        match self {
            Strategy::Both => light / (light + surface()),
            Strategy::Lights => 1.0,
            Strategy::Surfaces => 0.0,
        }
    }

    /// The share of light that falls to a draw by a surface.
    fn surface(self, surface: f64, light: impl FnOnce() -> f64) -> f64 {
        match self {
            Strategy::Both => surface / (surface + light()),
            Strategy::Lights => 0.0,
            Strategy::Surfaces => 1.0,
        }
    }
}

/// A path is cut off after this many scatterings: between surfaces that absorb nothing it might never end.
pub const MOST_SCATTERINGS: u32 = 20_000;

/// The first turns are always followed: they matter most, and a short path costs little.
const FOLLOWED: u32 = 2;

/// Russian roulette: whether a path goes on, by the most that it carries; it then carries as much more.
fn goes_on(carried: &mut [f64; 3], samples: &mut Samples) -> bool {
    let share = carried.iter().fold(0.0, |a: f64, b| a.max(*b)).min(1.0);
    *carried = carried.map(|c| c / share);
    samples.next()[0] < share
}

/// A path that carries more than this is cut off.
const MOST_CARRIED: f64 = 1e6;

/// How far paths are followed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Paths {
    /// The most scatterings; 1 is direct light alone, `None` follows paths until they end by themselves.
    pub bounces: Option<u32>,
    /// How directions are drawn.
    pub strategy: Strategy,
}

/// A world ready to be traced.
pub struct Tracer<'a> {
    pub(crate) stage: Stage<'a>,
    lights: Lights,
    paths: Paths,
}

/// What is seen along a line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Radiance, a channel each.
    pub radiance: [Estimate; 3],
    /// Whether paths were cut off, whose light is missing.
    pub cut: bool,
}

/// What one path brought back.
#[derive(Debug, Clone, Copy, Default)]
struct Brought {
    radiance: [f64; 3],
    /// Whether the first ray met a leaf.
    met: bool,
    /// Whether it was cut off: at [`MOST_SCATTERINGS`], or because it carried more than [`MOST_CARRIED`].
    cut: bool,
}

impl<'a> Tracer<'a> {
    /// # Errors
    /// [`crate::Error::Input`] when a map, a mesh or an index does not fit; see [`World::validate`].
    pub fn new(world: &'a World, paths: Paths) -> Result<Tracer<'a>> {
        world.validate()?;
        Ok(Tracer { stage: Stage::new(world), lights: Lights::new(world), paths })
    }

    /// What is traced.
    pub fn world(&self) -> &'a World {
        self.stage.world
    }

    /// What is seen along one line of sight, from `paths` paths.
    pub fn look(&self, eye: DVec3, direction: DVec3, paths: u32, seed: u64) -> Seen {
        let ray = Ray::new(eye, direction.normalize_or_zero());
        let [r, g, b, cut] = estimate::estimate(seed, paths, |samples| {
            let Brought { radiance: [r, g, b], cut, .. } = self.follow(ray, samples);
            [r, g, b, f64::from(u8::from(cut))]
        });
        Seen { radiance: [r, g, b], cut: cut.mean > 0.0 }
    }

    /// What a ray sees that meets nothing: the background under a constant sky, else the sky, and the sun's disk.
    fn background(&self, d: DVec3) -> [f64; 3] {
        let world = self.stage.world;
        if let Some(dome) = &world.dome {
            return dome.seen(d, world.sun.as_ref()).0;
        }
        let (behind, disk) =
            (world.environment.as_ref().map_or(world.background, |map| map.at(d)), self.lights.disk(d));
        [0, 1, 2].map(|c| behind[c] + disk[c])
    }

    /// One path from the camera along `ray` (of unit direction).
    fn follow(&self, mut ray: Ray, samples: &mut Samples) -> Brought {
        let Paths { bounces, strategy } = self.paths;
        let most = bounces.unwrap_or(MOST_SCATTERINGS).min(MOST_SCATTERINGS);
        let mut brought = Brought::default();
        let Some(mut met) = self.stage.nearest(&ray) else {
            return Brought { radiance: self.background(ray.direction), ..brought };
        };
        brought.met = true;
        let mut carried = [1.0; 3];
        let by_lights = self.lights.drawn(strategy);
        for turned in 1..=most {
            let surface = self.stage.surface(&met, SideBy::Triangle);
            let scatter = Scatter::new(&self.stage, &surface, carried, surface.rho_t());
            if !by_lights {
                // A turn's numbers are its own, whether lights are drawn or not.
                samples.skip();
            } else if let Some(light) = self.lights.draw(samples.next(), strategy) {
                let l = light.direction;
                let f = if light.sun { scatter.times_cosine_of_sun(l) } else { scatter.times_cosine(l) };
                if f.iter().any(|x| *x > 0.0) && !self.stage.blocked(&self.stage.leave(surface.point, surface.flat, l))
                {
                    let alone = light.sun && scatter.sun_by_maps();
                    let share = match light.density.filter(|_| !alone || scatter.faces(l)) {
                        Some(density) => strategy.light(density, || scatter.density(l)),
                        // By maps for the sun's centre, which weigh its irradiance.
                        None => light.level,
                    };
                    (0..3).for_each(|c| brought.radiance[c] += carried[c] * f[c] * light.weight[c] * share);
                }
            }
            let Some(turn) = scatter.draw(samples.next()) else { return brought };
            (0..3).for_each(|c| carried[c] *= turn.weight[c]);
            // Leaves that give more than they get can make a path carry without limit.
            if carried.iter().any(|c| *c > MOST_CARRIED) {
                return Brought { cut: true, ..brought };
            }
            ray = self.stage.leave(surface.point, surface.flat, turn.direction);
            let Some(next) = self.stage.nearest(&ray) else {
                let with_sun = !(turn.through && scatter.sun_by_maps());
                let seen = self.lights.seen(turn.direction, turn.density, strategy, with_sun);
                (0..3).for_each(|c| brought.radiance[c] += carried[c] * seen[c]);
                return brought;
            };
            met = next;
            if turned > FOLLOWED && !goes_on(&mut carried, samples) {
                return brought;
            }
        }
        brought.cut = bounces.is_none_or(|b| b > MOST_SCATTERINGS);
        brought
    }
}
