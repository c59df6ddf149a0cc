//! Radiance and its derivatives by numbers of the scene, along the same paths.
//!
//! A path's radiance is a sum of products: of what each surface scatters, over the density by which the next direction
//! was drawn, and of the light at its end. Densities are held fixed (Zeltner et al. 2021, "detached" sampling), so a
//! derivative follows from the product rule. At each surface, with the weight w of the turn,
//!
//! ```text
//! d ← d·w + carried·∂w     carried ← carried·w
//! ```
//! and where light is met, d times the light and carried times the light's own derivative are added. Nothing is divided
//! by a reflectance, so that black leaves have derivatives too. Balance weights and roulette are fixed numbers.

use super::leaf_slopes::{self, LeafSlopes, Term};
use super::lights::LightSample;
use super::scattering::ScatterPoint;
pub use super::sheet::DerivativePicture;
use super::{Canopy, FOLLOWED, MOST_CARRIED, MOST_SCATTERINGS, PathSampler, PathTracer, sheet};
use crate::Result;
use crate::accelerate::Ray;
use crate::camera::{CameraRays, ReferenceCamera};
use crate::dome::RadianceAt;
use crate::stage::SideBy;
use crate::world::ReferenceSide;
use glam::DVec3;
use std::sync::Arc;

/// What radiance is differentiated by. Each has a number for each channel, which changes the light of that channel
/// alone; a number that all channels share is the sum of its derivatives.
#[derive(Clone)]
pub enum RadianceParameter {
    /// ρd of a leaf of the world, by its index, of the front or the back.
    RhoD {
        /// Index of the leaf.
        leaf: usize,
        /// Whether of the back.
        back: bool,
    },
    /// ρt of a leaf, the same for light that enters at the front and at the back.
    RhoT(usize),
    /// ρs of a leaf's gloss, the same on both sides.
    RhoS(usize),
    /// The slope m of a leaf's gloss, the same on both sides.
    Slope(usize),
    /// A number on which the maps of a leaf depend. The derivatives of a look are a look of the same size: ρd, ρt, ρs
    /// and m of it are the derivatives of ρd, ρt, ρs and m.
    Look {
        /// Index of the leaf.
        leaf: usize,
        /// The derivatives, of the front and of the back.
        sides: Arc<[ReferenceSide; 2]>,
    },
    /// A number on which the absorptions of one crossing depend, of a leaf by B1's models that
    /// [`crate::foliar::FoliarMaterial::with_depths`] made.
    Depth {
        /// Index of the leaf.
        leaf: usize,
        /// The derivatives of the absorptions.
        by: [f64; 3],
    },
    /// A number of the light.
    Light {
        /// The derivative of the sky's radiance by direction, where the sky depends on it.
        sky: Option<RadianceAt>,
        /// The derivative of the sun's irradiance.
        sun: [f64; 3],
    },
}

/// The least share of draws of a lobe whose derivative is asked for.
pub(super) const LEAST: f64 = 0.1;
/// What a derivative counts in the roulette, relative to the radiance that a path carries. Reflectances are about this.
pub(super) const WORTH: f64 = 0.1;

/// What one path brings.
#[derive(Debug, Clone, PartialEq)]
pub struct PathContribution {
    /// Radiance.
    pub radiance: [f64; 3],
    /// Its derivatives, in the order of the list.
    pub slopes: Vec<[f64; 3]>,
}

/// A tracer that also follows derivatives.
pub struct DerivativeTracer<'a> {
    tracer: &'a PathTracer<'a>,
    of: &'a [RadianceParameter],
    leaves: LeafSlopes<'a>,
}

impl<'a> DerivativeTracer<'a> {
    /// Derivatives by everything in `of`.
    pub fn new(tracer: &'a PathTracer<'a>, of: &'a [RadianceParameter]) -> DerivativeTracer<'a> {
        DerivativeTracer { tracer, of, leaves: LeafSlopes::new(tracer.world().leaves.len(), of) }
    }

    /// One path along `ray` (of unit direction).
    fn follow(&self, mut ray: Ray, samples: &mut PathSampler) -> PathContribution {
        let PathTracer { stage, lights, paths } = self.tracer;
        let strategy = paths.strategy;
        let most = paths.bounces.unwrap_or(MOST_SCATTERINGS).min(MOST_SCATTERINGS);
        let mut out = PathContribution { radiance: [0.0; 3], slopes: vec![[0.0; 3]; self.of.len()] };
        let Some(mut met) = stage.nearest(&ray) else {
            out.radiance = self.tracer.background(ray.direction);
            let disk = lights.disk(ray.direction);
            // A constant sky gives light, but is not what is seen behind the scene.
            let shown = stage.world.dome.is_some() || stage.world.environment.is_some();
            let behind = |sky: Option<&RadianceAt>| sky.filter(|_| shown).map_or([0.0; 3], |sky| sky(ray.direction));
            self.light(&mut out, [1.0; 3], behind, self.unit(disk));
            return out;
        };
        let (mut carried, mut d) = ([1.0; 3], vec![[0.0f64; 3]; self.of.len()]);
        let by_lights = lights.drawn(strategy);
        let (mut points, mut terms): (Vec<_>, Vec<Term>) = (Vec::new(), Vec::new());
        for turned in 1..=most {
            let surface = stage.surface(&met, SideBy::Triangle);
            // Which lobe is drawn follows what is carried, and its derivatives.
            let mut weigh = carried;
            d.iter().for_each(|d| (0..3).for_each(|c| weigh[c] += WORTH * d[c].abs()));
            if weigh.iter().all(|c| *c <= 0.0) {
                weigh = [1.0; 3];
            }
            let mut scatter = ScatterPoint::new(stage, &surface, weigh, surface.rho_t());
            let (leaf, foliar) = (stage.leaf_index(surface.instance), stage.foliar(surface.instance));
            self.leaves.at(leaf, &surface, foliar, scatter.layered(), &mut points);
            scatter.raise(leaf_slopes::asked(&points), LEAST);
            if !by_lights {
                samples.skip();
            } else if let Some(light) = lights.draw(samples.next(), strategy) {
                let l = light.direction;
                let f = if light.sun { scatter.times_cosine_of_sun(l) } else { scatter.times_cosine(l) };
                leaf_slopes::terms(&points, &scatter, l, &mut terms);
                let any = f.iter().any(|x| *x > 0.0) || !terms.is_empty();
                if any && !stage.blocked(&stage.leave(surface.point, surface.flat, l)) {
                    let alone = light.sun && scatter.sun_by_maps();
                    let share = match light.density.filter(|_| !alone || scatter.faces(l)) {
                        Some(density) => strategy.light(density, || scatter.density(l)),
                        None => light.level,
                    };
                    self.gather(&mut out, &light, share, carried, &d, f, &terms);
                }
            }
            let (direction, weight, density) = if scatter.layered() {
                let Some(turn) = scatter.draw(samples.next()) else { return out };
                leaf_slopes::crossed(&points, turn.weight, turn.crossings, &mut terms);
                (turn.direction, turn.weight, turn.density)
            } else {
                let Some(direction) = scatter.direction(samples.next()) else { return out };
                let density = scatter.density(direction);
                if !(density > 0.0) {
                    return out;
                }
                leaf_slopes::terms(&points, &scatter, direction, &mut terms);
                terms.iter_mut().for_each(|(_, by)| *by = by.map(|v| v / density));
                (direction, scatter.times_cosine(direction).map(|f| f / density), density)
            };
            d.iter_mut().for_each(|d| (0..3).for_each(|c| d[c] *= weight[c]));
            for (k, by) in &terms {
                (0..3).for_each(|c| d[*k][c] += carried[c] * by[c]);
            }
            (0..3).for_each(|c| carried[c] *= weight[c]);
            let worth = d.iter().flatten().fold(0.0, |a: f64, b| a.max(b.abs())) * WORTH;
            let most = carried.iter().fold(worth, |a, b| a.max(*b));
            if !(most > 0.0) || most > MOST_CARRIED {
                return out;
            }
            let with_sun = scatter.faces(direction) || !scatter.sun_by_maps();
            ray = stage.leave(surface.point, surface.flat, direction);
            let Some(next) = stage.nearest(&ray) else {
                self.end(&mut out, ray.direction, density, with_sun, carried, &d);
                return out;
            };
            if turned > FOLLOWED {
                let share = most.min(1.0);
                if samples.next()[0] >= share {
                    return out;
                }
                carried = carried.map(|c| c / share);
                d.iter_mut().flatten().for_each(|v| *v /= share);
            }
            met = next;
        }
        out
    }

    /// Light that was drawn, through a surface that scatters `f` of it and changes that by `terms`.
    #[allow(clippy::too_many_arguments, reason = "the state of a path at one surface")]
    fn gather(
        &self,
        out: &mut PathContribution,
        light: &LightSample,
        share: f64,
        carried: [f64; 3],
        d: &[[f64; 3]],
        f: [f64; 3],
        terms: &[Term],
    ) {
        let lit = light.weight.map(|w| w * share);
        for c in 0..3 {
            out.radiance[c] += carried[c] * f[c] * lit[c];
        }
        for (k, d) in d.iter().enumerate() {
            (0..3).for_each(|c| out.slopes[k][c] += d[c] * f[c] * lit[c]);
        }
        for (k, by) in terms {
            (0..3).for_each(|c| out.slopes[*k][c] += carried[c] * by[c] * lit[c]);
        }
        let through = [0, 1, 2].map(|c| carried[c] * f[c]);
        match (light.sun, light.density) {
            (true, _) => self.light(out, through, |_| [0.0; 3], self.unit(lit)),
            (false, Some(density)) => {
                let at = |sky: Option<&RadianceAt>| {
                    sky.map_or([0.0; 3], |sky| sky(light.direction).map(|v| v * share / density))
                };
                self.light(out, through, at, 0.0);
            }
            _ => {}
        }
    }

    /// The end of a path, outside of the scene.
    fn end(
        &self,
        out: &mut PathContribution,
        at: DVec3,
        density: f64,
        with_sun: bool,
        carried: [f64; 3],
        d: &[[f64; 3]],
    ) {
        let (lights, strategy) = (&self.tracer.lights, self.tracer.paths.strategy);
        let sky = lights.seen(at, density, strategy, false);
        let all = if with_sun { lights.seen(at, density, strategy, true) } else { sky };
        for c in 0..3 {
            out.radiance[c] += carried[c] * all[c];
        }
        for (k, d) in d.iter().enumerate() {
            (0..3).for_each(|c| out.slopes[k][c] += d[c] * all[c]);
        }
        // What is seen of the sky is its radiance times one weight for all channels.
        let radiance = lights.sky(at);
        let brightest = (0..3).fold(0, |a, c| if radiance[c] > radiance[a] { c } else { a });
        let weight = if radiance[brightest] > 0.0 { sky[brightest] / radiance[brightest] } else { 0.0 };
        let of_sky = |sky: Option<&RadianceAt>| sky.map_or([0.0; 3], |sky| sky(at).map(|v| v * weight));
        self.light(out, carried, of_sky, self.unit([0, 1, 2].map(|c| all[c] - sky[c])));
    }

    /// Adds the derivatives by the light's own numbers. `through` is what the path lets through, `sky` the derivative
    /// of the sky's part, and `sun` what a sun of irradiance 1 would give.
    fn light(
        &self,
        out: &mut PathContribution,
        through: [f64; 3],
        sky: impl Fn(Option<&RadianceAt>) -> [f64; 3],
        sun: f64,
    ) {
        for (k, of) in self.of.iter().enumerate() {
            if let RadianceParameter::Light { sky: by_sky, sun: by_sun } = of {
                let sky = sky(by_sky.as_ref());
                (0..3).for_each(|c| out.slopes[k][c] += through[c] * (sky[c] + by_sun[c] * sun));
            }
        }
    }

    /// Light of the sun over the sun's irradiance, which is the same for all channels.
    fn unit(&self, lit: [f64; 3]) -> f64 {
        let irradiance = self.tracer.world().sun.as_ref().map_or([0.0; 3], |sun| sun.irradiance);
        let most = (0..3).fold(0, |a, c| if irradiance[c] > irradiance[a] { c } else { a });
        if irradiance[most] > 0.0 { lit[most] / irradiance[most] } else { 0.0 }
    }

    /// What paths from `count` places bring. `ray` gives a place's ray for two uniform numbers.
    fn sheet(
        &self,
        count: usize,
        paths: [u32; 2],
        seed: u64,
        ray: impl Fn(usize, [f64; 2]) -> Ray + Sync,
    ) -> Result<DerivativePicture> {
        sheet::sheet(count, [3, self.of.len()], paths, seed, |place, samples, brought| {
            let [x, y, ..] = samples.next();
            let PathContribution { radiance, slopes } = self.follow(ray(place, [x, y]), samples);
            let all = radiance.iter().chain(slopes.as_flattened());
            brought.iter_mut().zip(all).for_each(|(to, v)| *to = *v);
        })
    }

    /// A picture of `size` (columns, rows) pixels, row by row from the top, from rounds of
    /// `each` paths a pixel.
    ///
    /// # Errors
    /// [`crate::Error::Usage`] for a camera that looks nowhere, and a stop that was asked for.
    pub fn picture(
        &self,
        camera: &ReferenceCamera,
        size: [usize; 2],
        [rounds, each]: [u32; 2],
        seed: u64,
    ) -> Result<DerivativePicture> {
        let [width, height] = size;
        let lens = CameraRays::new(camera, width, height)?;
        self.sheet(width * height, [rounds, each], seed, |k, [x, y]| {
            lens.ray((k % width) as f64 + x, (k / width) as f64 + y)
        })
    }

    /// Reflectance factors of a canopy towards directions (zenith and azimuth, rad), from rounds of `each` paths a
    /// direction. The tracer must be the canopy's.
    ///
    /// # Errors
    /// A stop that was asked for.
    pub fn factors(
        &self,
        canopy: &Canopy,
        toward: &[[f64; 2]],
        [rounds, each]: [u32; 2],
        seed: u64,
    ) -> Result<DerivativePicture> {
        let mut sheet = self.sheet(toward.len(), [rounds, each], seed, |k, at| canopy.seen_from(toward[k], at))?;
        sheet.scale(&canopy.factors());
        Ok(sheet)
    }
}
