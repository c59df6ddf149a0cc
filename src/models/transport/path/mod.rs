//! The path tracer: light between leaves, by following rays from the camera through any number of scatterings.
//!
//! Radiance is estimated by unidirectional paths (Kajiya 1986; Pharr, Jakob & Humphreys 2023, §13–14). At every point
//! one direction is drawn towards sun or sky (next-event estimation), and one from the surface's scattering. Where both
//! could find the same light, each gets a share according to the densities (Veach & Guibas 1995, balance heuristic). A
//! path ends at random, with a probability that grows as the light that it carries decreases (Russian roulette). This
//! leaves the mean unbiased.
//!
//! All arithmetic is f64. Limits: only surfaces scatter, so there is no mist. Inside a blade, light moves from one
//! texel to another only in the translucency maps of sunlight. Only sun, sky and environment emit light.

mod band_fluxes;
mod band_slopes;
#[cfg(test)]
mod band_slopes_tests;
mod bands;
#[cfg(test)]
mod bands_tests;
mod branch;
mod canopy;
mod escape;
mod estimate;
#[cfg(test)]
mod foliar_tests;
mod leaf_slopes;
mod lights;
mod picture;
#[cfg(test)]
mod picture_tests;
mod samples;
mod scattering;
mod sheet;
pub mod slopes;
#[cfg(test)]
mod slopes_tests;
#[cfg(test)]
mod tests;

pub(crate) use crate::Result;
use crate::accelerate::Ray;
use crate::stage::{SideBy, Stage};
use crate::world::ReferenceWorld;
pub use bands::SurfaceBands;
pub use canopy::{Canopy, CanopyFluxes};
pub use estimate::Estimate;
use glam::DVec3;
use lights::SceneLights;
pub use picture::{DrawingOutcome, PathPicture, PathRequest, SamplingTarget};
pub use samples::MOST_PATHS;
pub(crate) use samples::PathSampler;
use scattering::ScatterPoint;

/// How directions towards light are drawn. All strategies have the same mean, which serves as a test of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SamplingStrategy {
    /// From lights and from surfaces, with each weighted where it is better.
    #[default]
    Both,
    /// Only from lights. A gloss close to a mirror is then noisy.
    Lights,
    /// Only from surfaces. A small sun is then found rarely, and one without extent never.
    Surfaces,
}

impl SamplingStrategy {
    /// The weight of light that was drawn from a light with density `light`, where the surface's density is `surface`.
    fn light(self, light: f64, surface: impl FnOnce() -> f64) -> f64 {
        match self {
            SamplingStrategy::Both => light / (light + surface()),
            SamplingStrategy::Lights => 1.0,
            SamplingStrategy::Surfaces => 0.0,
        }
    }

    /// The weight of light that was drawn from a surface.
    fn surface(self, surface: f64, light: impl FnOnce() -> f64) -> f64 {
        match self {
            SamplingStrategy::Both => surface / (surface + light()),
            SamplingStrategy::Lights => 0.0,
            SamplingStrategy::Surfaces => 1.0,
        }
    }
}

/// A path is cut off after this many scatterings. Between surfaces that absorb nothing it might never end.
pub const MOST_SCATTERINGS: u32 = 20_000;

/// The first turns are always followed. They matter most, and a short path costs little.
const FOLLOWED: u32 = 2;

/// Russian roulette: returns whether a path goes on. The probability is the largest channel that it carries, at most 1,
/// and what it carries is divided by that probability.
fn goes_on(carried: &mut [f64; 3], samples: &mut PathSampler) -> bool {
    let share = carried.iter().fold(0.0, |a: f64, b| a.max(*b)).min(1.0);
    *carried = carried.map(|c| c / share);
    samples.next()[0] < share
}

/// So many paths are followed side by side at most.
const SIDE_BY_SIDE: u32 = 256;

/// A path that carries more than this is cut off.
const MOST_CARRIED: f64 = 1e6;

/// How paths are followed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathSettings {
    /// The largest number of scatterings: 1 is direct light alone. With `None` paths end only at random.
    pub bounces: Option<u32>,
    /// How directions are drawn.
    pub strategy: SamplingStrategy,
}

/// A world prepared for path tracing.
pub struct PathTracer<'a> {
    pub(crate) stage: Stage<'a>,
    lights: SceneLights,
    paths: PathSettings,
}

/// The light along a line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SightRadiance {
    /// Radiance of each channel.
    pub radiance: [Estimate; 3],
    /// Whether paths were cut off, so that their light is missing.
    pub cut: bool,
}

/// The result of one path.
#[derive(Debug, Clone, Copy, Default)]
struct Brought {
    radiance: [f64; 3],
    /// Whether the camera's ray hit a leaf.
    met: bool,
    /// Whether the path was cut off: at [`MOST_SCATTERINGS`], or because it carried more than [`MOST_CARRIED`].
    cut: bool,
}

impl<'a> PathTracer<'a> {
    /// # Errors
    /// [`crate::Error::Input`] when a map, a mesh or an index does not fit; see [`ReferenceWorld::validate`].
    pub fn new(world: &'a ReferenceWorld, paths: PathSettings) -> Result<PathTracer<'a>> {
        world.validate()?;
        Ok(PathTracer { stage: Stage::new(world), lights: SceneLights::new(world), paths })
    }

    /// The world that is traced.
    pub fn world(&self) -> &'a ReferenceWorld {
        self.stage.world
    }

    /// The light along one line of sight, estimated from `paths` paths.
    pub fn look(&self, eye: DVec3, direction: DVec3, paths: u32, seed: u64) -> SightRadiance {
        let ray = Ray::new(eye, direction.normalize_or_zero());
        let [r, g, b, cut] = estimate::estimate(seed, paths, |samples| {
            let told = |Brought { radiance: [r, g, b], cut, .. }| [r, g, b, f64::from(u8::from(cut))];
            self.follow_each(samples.iter_mut().map(|samples| (ray, samples))).into_iter().map(told).collect()
        });
        SightRadiance { radiance: [r, g, b], cut: cut.mean > 0.0 }
    }

    /// The radiance along a ray that hits nothing: the background where the sky is constant, otherwise the sky, and the
    /// sun's disk.
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
    fn follow(&self, ray: Ray, samples: &mut PathSampler) -> Brought {
        self.follow_each([(ray, samples)]).pop().unwrap_or_default()
    }

    /// Paths from the camera along rays (of unit direction), side by side: all make their next turn, then what they
    /// meet next is looked for together. What a path brings does not depend on those beside it.
    fn follow_each<'s>(&self, begun: impl IntoIterator<Item = (Ray, &'s mut PathSampler)>) -> Vec<Brought> {
        let PathSettings { bounces, strategy } = self.paths;
        let most = bounces.unwrap_or(MOST_SCATTERINGS).min(MOST_SCATTERINGS);
        let by_lights = self.lights.drawn(strategy);
        let (mut paths, mut open, mut rays, mut turns) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (ray, samples) in begun {
            rays.push(ray);
            paths.push(Path { samples, carried: [1.0; 3], brought: Brought::default() });
        }
        for (k, met) in self.stage.nearest_of_neighbours(&rays).into_iter().enumerate() {
            let brought = &mut paths[k].brought;
            match met {
                Some(met) => {
                    brought.met = true;
                    open.push((k, met));
                }
                None => brought.radiance = self.background(rays[k].direction),
            }
        }
        rays.clear();
        for turned in 1..=most {
            if open.is_empty() {
                break;
            }
            open.iter().for_each(|(_, met)| self.stage.fetch_corners(met));
            open.iter().for_each(|(_, met)| self.stage.fetch_surface(met));
            for (k, met) in open.drain(..) {
                let Path { samples, carried, brought } = &mut paths[k];
                let surface = self.stage.surface(&met, SideBy::Triangle);
                let scatter = ScatterPoint::new(&self.stage, &surface, *carried, surface.rho_t());
                if !by_lights {
                    // A turn's numbers are its own, whether lights are drawn or not.
                    samples.skip();
                } else if let Some(light) = self.lights.draw(samples.next(), strategy) {
                    let l = light.direction;
                    let f = if light.sun { scatter.times_cosine_of_sun(l) } else { scatter.times_cosine(l) };
                    if f.iter().any(|x| *x > 0.0)
                        && !self.stage.blocked(&self.stage.leave(surface.point, surface.flat, l))
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
                let Some(turn) = scatter.draw(samples.next()) else { continue };
                (0..3).for_each(|c| carried[c] *= turn.weight[c]);
                // Leaves that give more than they get can make a path carry without limit.
                if carried.iter().any(|c| *c > MOST_CARRIED) {
                    brought.cut = true;
                    continue;
                }
                rays.push(self.stage.leave(surface.point, surface.flat, turn.direction));
                turns.push((k, turn.density, !(turn.through && scatter.sun_by_maps())));
            }
            let met = self.stage.nearest_of_each(&rays);
            for (((k, density, with_sun), ray), met) in turns.drain(..).zip(&rays).zip(met) {
                let Path { samples, carried, brought } = &mut paths[k];
                match met {
                    None => {
                        let seen = self.lights.seen(ray.direction, density, strategy, with_sun);
                        (0..3).for_each(|c| brought.radiance[c] += carried[c] * seen[c]);
                    }
                    Some(_) if turned > FOLLOWED && !goes_on(carried, samples) => {}
                    Some(met) => open.push((k, met)),
                }
            }
            rays.clear();
        }
        for (k, _) in open {
            paths[k].brought.cut = bounces.is_none_or(|b| b > MOST_SCATTERINGS);
        }
        paths.into_iter().map(|path| path.brought).collect()
    }
}

/// A path on its way.
struct Path<'s> {
    samples: &'s mut PathSampler,
    /// What it lets through of light that it meets, a channel each.
    carried: [f64; 3],
    brought: Brought,
}
