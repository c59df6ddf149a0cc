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

/// So many paths are followed side by side at most.
const SIDE_BY_SIDE: u32 = 256;

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
            let told = |Brought { radiance: [r, g, b], cut, .. }| [r, g, b, f64::from(u8::from(cut))];
            self.follow_each(samples.iter_mut().map(|samples| (ray, samples))).into_iter().map(told).collect()
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
    fn follow(&self, ray: Ray, samples: &mut Samples) -> Brought {
        self.follow_each([(ray, samples)]).pop().unwrap_or_default()
    }

    /// Paths from the camera along rays (of unit direction), side by side: all make their next turn, then what they meet
    /// next is looked for together. What a path brings does not depend on those beside it.
    fn follow_each<'s>(&self, begun: impl IntoIterator<Item = (Ray, &'s mut Samples)>) -> Vec<Brought> {
        let Paths { bounces, strategy } = self.paths;
        let most = bounces.unwrap_or(MOST_SCATTERINGS).min(MOST_SCATTERINGS);
        let by_lights = self.lights.drawn(strategy);
        let (mut paths, mut open, mut rays, mut turns) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (k, (ray, samples)) in begun.into_iter().enumerate() {
            let mut brought = Brought::default();
            // Neighbours see much the same: one by one is faster.
            match self.stage.nearest(&ray) {
                Some(met) => {
                    brought.met = true;
                    open.push((k, met));
                }
                None => brought.radiance = self.background(ray.direction),
            }
            paths.push(Path { samples, carried: [1.0; 3], brought });
        }
        for turned in 1..=most {
            if open.is_empty() {
                break;
            }
            open.iter().for_each(|(_, met)| self.stage.fetch_corners(met));
            open.iter().for_each(|(_, met)| self.stage.fetch_surface(met));
            for (k, met) in open.drain(..) {
                let Path { samples, carried, brought } = &mut paths[k];
                let surface = self.stage.surface(&met, SideBy::Triangle);
                let scatter = Scatter::new(&self.stage, &surface, *carried, surface.rho_t());
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
    samples: &'s mut Samples,
    /// What it lets through of light that it meets, a channel each.
    carried: [f64; 3],
    brought: Brought,
}
