//! Radiance at any number of wavelengths along the same paths.
//!
//! Where a path goes does not depend on the wavelength, as long as surfaces are matte, or have a gloss that is the same
//! for all. So one path carries a number for each band, and only these are multiplied band by band:
//!
//! ```text
//! carried_b ← carried_b · f_b cos/p
//! ```
//! The density p of a draw is the same for all bands. It chooses between reflection, transmission and gloss in
//! proportion to the sums over the bands of what each would carry on, as the path tracer does with its three channels.
//! So the sum over all bands never grows, and no band's weight exceeds their number. Russian roulette follows the band
//! that carries most. With three bands and the same random numbers, the result is that of the three channels.

use super::estimate::{Estimate, estimate_all};
use super::scattering::ScatterPoint;
use super::{Canopy, FOLLOWED, MOST_CARRIED, MOST_SCATTERINGS, PathSampler, PathTracer};
use crate::accelerate::Ray;
use crate::stage::SideBy;
use crate::surface::Surface;

/// What a surface that is the same everywhere scatters at each wavelength. Its gloss is that of the world's surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceBands {
    /// ρd of the front and of the back.
    pub rho_d: [Vec<f64>; 2],
    /// ρt, the same in both directions.
    pub rho_t: Vec<f64>,
}

impl SurfaceBands {
    /// A matte surface whose front has this albedo. Its back is black, and it is opaque.
    pub fn opaque(albedo: Vec<f64>) -> SurfaceBands {
        let none = vec![0.0; albedo.len()];
        SurfaceBands { rho_d: [albedo, none.clone()], rho_t: none }
    }
}

/// The tracer of one canopy's bands.
pub(super) struct BandTracer<'a> {
    /// The tracer of its world.
    pub tracer: &'a PathTracer<'a>,
    /// One for each leaf of the world.
    surfaces: &'a [SurfaceBands],
    /// The sun's brightest channel, and its irradiance there. Each band has a sun of irradiance 1.
    channel: usize,
    irradiance: f64,
}

impl Canopy<'_> {
    /// The reflectance factors of `bands` bands towards a direction, from `paths` paths: `zenith` (rad) within ±π/2,
    /// `azimuth` (rad) from +x towards +y. `surfaces` has what each of the world's leaves scatters.
    ///
    /// # Errors
    /// A sentence where `surfaces` does not fit the world, where a surface has layers, maps of sunlight, or a gloss
    /// that differs between channels, and where the sun is dark.
    pub fn brf_of_bands(
        &self,
        [zenith, azimuth]: [f64; 2],
        surfaces: &[SurfaceBands],
        bands: usize,
        paths: u32,
    ) -> Result<Vec<Estimate>, String> {
        let tracer = BandTracer::new(self.tracer(), surfaces, bands)?;
        let factor = self.factor_of_unit();
        Ok(estimate_all(self.key([zenith, azimuth]), paths, bands, |samples, add| {
            let (mut carried, mut brought) = (vec![0.0; bands], vec![0.0; bands]);
            for samples in samples {
                let [u, v, ..] = samples.next();
                tracer.follow(self.seen_from([zenith, azimuth], [u, v]), samples, &mut carried, &mut brought);
                brought.iter_mut().for_each(|v| *v *= factor);
                add(&brought);
            }
        }))
    }
}

impl<'a> BandTracer<'a> {
    /// # Errors
    /// See [`Canopy::brf_of_bands`].
    pub fn new(
        tracer: &'a PathTracer<'a>,
        surfaces: &'a [SurfaceBands],
        bands: usize,
    ) -> Result<BandTracer<'a>, String> {
        let world = tracer.world();
        let [leaves, own] = [world.leaves.len(), surfaces.len()];
        if leaves != own {
            return Err(format!("{own} surfaces have bands, expected {leaves}, as many as the world has"));
        }
        for (k, surface) in surfaces.iter().enumerate() {
            let [front, back] = &surface.rho_d;
            if let Some(found) = [front, back, &surface.rho_t].into_iter().find(|list| list.len() != bands) {
                return Err(format!("surface {k} has {} bands, expected {bands}", found.len()));
            }
            if world.foliar.get(k).is_some_and(Option::is_some) {
                return Err(format!("surface {k} has layers, which are of three wavelengths"));
            }
            let sides = [&world.leaves[k].front, &world.leaves[k].back];
            let differs = |rho_s: &[Vec<f32>; 3]| rho_s[0] != rho_s[1] || rho_s[0] != rho_s[2];
            if sides.into_iter().filter_map(|side| side.gloss.as_ref()).any(|gloss| differs(&gloss.rho_s)) {
                return Err(format!("surface {k} has a gloss that differs between channels"));
            }
        }
        if world.through.iter().any(|through| through.entering.iter().any(Option::is_some)) {
            return Err("there are maps of sunlight through leaves, which are of three channels".into());
        }
        let irradiance = world.sun.as_ref().map_or([0.0; 3], |sun| sun.irradiance);
        let channel = (0..3).fold(0, |a, c| if irradiance[c] > irradiance[a] { c } else { a });
        let irradiance = irradiance[channel];
        if !(irradiance > 0.0) {
            return Err("the sun has no irradiance in any channel".into());
        }
        Ok(BandTracer { tracer, surfaces, channel, irradiance })
    }

    /// The leaf of the world at a point.
    pub fn leaf(&self, surface: &Surface) -> usize {
        self.tracer.stage.leaf_index(surface.instance)
    }

    /// What the leaf at a point scatters.
    pub fn of(&self, surface: &Surface) -> &'a SurfaceBands {
        &self.surfaces[self.leaf(surface)]
    }

    /// Light of the sun, over the sun's irradiance.
    pub fn unit(&self, light: [f64; 3]) -> f64 {
        light[self.channel] / self.irradiance
    }

    /// One path along `ray` (of unit direction). `brought` becomes its radiance in each band.
    fn follow(&self, mut ray: Ray, samples: &mut PathSampler, carried: &mut [f64], brought: &mut [f64]) {
        let PathTracer { stage, lights, paths } = self.tracer;
        let strategy = paths.strategy;
        let most = paths.bounces.unwrap_or(MOST_SCATTERINGS).min(MOST_SCATTERINGS);
        let by_lights = lights.drawn(strategy);
        carried.fill(1.0);
        brought.fill(0.0);
        let Some(mut met) = stage.nearest(&ray) else {
            brought.fill(self.unit(self.tracer.background(ray.direction)));
            return;
        };
        for turned in 1..=most {
            let surface = stage.surface(&met, SideBy::Triangle);
            let of = self.of(&surface);
            let (rho_d, rho_t) = (&of.rho_d[usize::from(surface.back)], &of.rho_t);
            let mut scatter = ScatterPoint::new(stage, &surface, [1.0; 3], surface.rho_t());
            let rho_s = scatter.rho_s()[0];
            let shine = if rho_s > 0.0 { rho_s * carried.iter().sum::<f64>() } else { 0.0 };
            let shares = [product(carried, rho_d), product(carried, rho_t), shine];
            scatter.choose(shares);
            // What is scattered from one direction: the diffuse share of each band, a factor on it, and the gloss.
            let from = |l| {
                let [diffuse, through, gloss] = scatter.factors(l);
                let (rho, factor) = if through > 0.0 { (rho_t, through) } else { (rho_d, diffuse) };
                let any = factor * if through > 0.0 { shares[1] } else { shares[0] } + gloss * shares[2] > 0.0;
                any.then_some((rho, factor, gloss * rho_s))
            };
            if !by_lights {
                samples.skip();
            } else if let Some(light) = lights.draw(samples.next(), strategy)
                && let Some((rho, factor, gloss)) = from(light.direction)
                && !stage.blocked(&stage.leave(surface.point, surface.flat, light.direction))
            {
                let share = match light.density {
                    Some(density) => strategy.light(density, || scatter.density(light.direction)),
                    None => light.level,
                };
                let lit = self.unit(light.weight) * share;
                for ((sum, c), rho) in brought.iter_mut().zip(&*carried).zip(rho) {
                    *sum += c * (rho * factor + gloss) * lit;
                }
            }
            let Some(direction) = scatter.direction(samples.next()) else { return };
            let density = scatter.density(direction);
            let Some((rho, factor, gloss)) = from(direction).filter(|_| density > 0.0) else { return };
            let (factor, gloss) = (factor / density, gloss / density);
            carried.iter_mut().zip(rho).for_each(|(c, rho)| *c *= rho * factor + gloss);
            let largest = largest(carried);
            // As for three channels, a path that gains without limit is cut off.
            if !(largest > 0.0) || largest > MOST_CARRIED {
                return;
            }
            ray = stage.leave(surface.point, surface.flat, direction);
            let Some(next) = stage.nearest(&ray) else {
                let seen = self.unit(lights.seen(ray.direction, density, strategy, true));
                if seen > 0.0 {
                    brought.iter_mut().zip(&*carried).for_each(|(sum, c)| *sum += c * seen);
                }
                return;
            };
            if turned > FOLLOWED {
                let share = largest.min(1.0);
                if samples.next()[0] >= share {
                    return;
                }
                if share < 1.0 {
                    carried.iter_mut().for_each(|c| *c /= share);
                }
            }
            met = next;
        }
    }
}

/// So many numbers are added side by side, which the processor does at once.
const LANES: usize = 8;

/// Σ aᵢ bᵢ.
pub(super) fn product(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (wide_a, wide_b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = wide_a.remainder().iter().zip(wide_b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in wide_a.zip(wide_b) {
        (0..LANES).for_each(|k| sums[k] += a[k] * b[k]);
    }
    sums.iter().sum::<f64>() + rest
}

/// The largest of numbers that are not negative.
pub(super) fn largest(a: &[f64]) -> f64 {
    let mut most = [0.0; LANES];
    let wide = a.chunks_exact(LANES);
    let rest = wide.remainder().iter().fold(0.0, |most: f64, v| most.max(*v));
    for a in wide {
        (0..LANES).for_each(|k| most[k] = if a[k] > most[k] { a[k] } else { most[k] });
    }
    most.iter().fold(rest, |most, v| most.max(*v))
}
