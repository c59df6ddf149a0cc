//! Reflectance factors of any number of bands, and their derivatives, along the same paths.
//!
//! As for three channels ([`super::slopes`]), densities are held fixed and the product rule is followed. A number of a
//! band changes the light of that band alone, so each parameter has as many derivatives as there are bands. With three
//! bands and the same random numbers, all of them are those of the three channels.

use super::bands::{BandTracer, SurfaceBands, largest, product};
use super::scattering::ScatterPoint;
use super::sheet::{self, DerivativePicture};
use super::slopes::{LEAST, RadianceParameter, WORTH};
use super::{Canopy, FOLLOWED, MOST_CARRIED, MOST_SCATTERINGS, PathSampler, PathTracer};
use crate::accelerate::Ray;
use crate::stage::SideBy;
use crate::surface::Surface;
use crate::{Error, Result};

/// Reflectances and transmittances of which derivatives are asked for.
struct BandSlopes<'a> {
    tracer: BandTracer<'a>,
    of: &'a [RadianceParameter],
    bands: usize,
}

/// What a path carries on its way.
struct Carried {
    light: Vec<f64>,
    /// Derivatives, parameter by parameter.
    slopes: Vec<f64>,
    /// By how much each band counts where a lobe is chosen.
    weigh: Vec<f64>,
}

/// What a surface scatters in one direction: ρ of each band, and a factor on it. Gloss is the same for all bands.
struct Scattered<'a> {
    rho: &'a [f64],
    factor: f64,
    gloss: f64,
    through: bool,
}

impl Canopy<'_> {
    /// Reflectance factors of `surfaces`' bands towards directions (zenith and azimuth, rad), from rounds of `each`
    /// paths a direction, and their derivatives by everything in `of`, each by the numbers of its own band.
    ///
    /// # Errors
    /// [`Error::Missed`] where [`Canopy::brf_of_bands`] refuses the surfaces, and for a parameter that is neither a
    /// reflectance nor a transmittance; a stop that was asked for.
    pub fn factors_of_bands(
        &self,
        toward: &[[f64; 2]],
        surfaces: &[SurfaceBands],
        of: &[RadianceParameter],
        [rounds, each]: [u32; 2],
        seed: u64,
    ) -> Result<DerivativePicture> {
        let bands = surfaces.first().map_or(0, |surface| surface.rho_t.len());
        let known = |of: &RadianceParameter| matches!(of, RadianceParameter::RhoD { .. } | RadianceParameter::RhoT(_));
        if !of.iter().all(known) {
            let what = "bands have derivatives by reflectances and transmittances alone";
            return Err(Error::Missed(what.into()));
        }
        let tracer = BandTracer::new(self.tracer(), surfaces, bands).map_err(Error::Missed)?;
        let slopes = BandSlopes { tracer, of, bands };
        let mut out = sheet::sheet(toward.len(), [bands, of.len()], [rounds, each], seed, |k, samples, brought| {
            let [x, y, ..] = samples.next();
            slopes.follow(self.seen_from(toward[k], [x, y]), samples, brought);
        })?;
        out.scale(&vec![self.factor_of_unit(); bands]);
        Ok(out)
    }
}

impl BandSlopes<'_> {
    /// One path along `ray` (of unit direction). `brought` becomes its radiance in each band, and then its derivatives.
    fn follow(&self, mut ray: Ray, samples: &mut PathSampler, brought: &mut [f64]) {
        let PathTracer { stage, lights, paths } = self.tracer.tracer;
        let (strategy, bands) = (paths.strategy, self.bands);
        let most = paths.bounces.unwrap_or(MOST_SCATTERINGS).min(MOST_SCATTERINGS);
        let by_lights = lights.drawn(strategy);
        brought.fill(0.0);
        let Some(mut met) = stage.nearest(&ray) else {
            brought[..bands].fill(self.tracer.unit(self.tracer.tracer.background(ray.direction)));
            return;
        };
        let mut carried =
            Carried { light: vec![1.0; bands], slopes: vec![0.0; bands * self.of.len()], weigh: vec![1.0; bands] };
        for turned in 1..=most {
            let surface = stage.surface(&met, SideBy::Triangle);
            let (leaf, mut scatter) = (self.tracer.leaf(&surface), self.scatter(&surface, &mut carried));
            let asked = [false, true].map(|through| self.asked(leaf, &surface, through).next().is_some());
            scatter.raise([asked[0], asked[1], false], LEAST);
            if !by_lights {
                samples.skip();
            } else if let Some(light) = lights.draw(samples.next(), strategy) {
                let l = light.direction;
                let to = self.scattered(&surface, &scatter, l);
                if self.any(&to, leaf, &surface) && !stage.blocked(&stage.leave(surface.point, surface.flat, l)) {
                    let share = match light.density {
                        Some(density) => strategy.light(density, || scatter.density(l)),
                        None => light.level,
                    };
                    self.gather(brought, &carried, &to, leaf, &surface, self.tracer.unit(light.weight) * share);
                }
            }
            let Some(direction) = scatter.direction(samples.next()) else { return };
            let density = scatter.density(direction);
            if !(density > 0.0) {
                return;
            }
            let mut to = self.scattered(&surface, &scatter, direction);
            (to.factor, to.gloss) = (to.factor / density, to.gloss / density);
            self.turn(&mut carried, &to, leaf, &surface);
            let worth = carried.slopes.iter().fold(0.0, |a: f64, b| a.max(b.abs())) * WORTH;
            let largest = largest(&carried.light).max(worth);
            if !(largest > 0.0) || largest > MOST_CARRIED {
                return;
            }
            ray = stage.leave(surface.point, surface.flat, direction);
            let Some(next) = stage.nearest(&ray) else {
                let seen = self.tracer.unit(lights.seen(ray.direction, density, strategy, true));
                if seen > 0.0 {
                    let all = carried.light.iter().chain(&carried.slopes);
                    brought.iter_mut().zip(all).for_each(|(sum, c)| *sum += c * seen);
                }
                return;
            };
            if turned > FOLLOWED {
                let share = largest.min(1.0);
                if samples.next()[0] >= share {
                    return;
                }
                carried.light.iter_mut().chain(&mut carried.slopes).for_each(|c| *c /= share);
            }
            met = next;
        }
    }

    /// A point as light meets it. Which lobe is drawn follows what is carried, and its derivatives.
    fn scatter<'s>(&'s self, surface: &Surface<'s>, carried: &mut Carried) -> ScatterPoint<'s> {
        let Carried { light, slopes, weigh } = carried;
        weigh.copy_from_slice(light);
        for of in slopes.chunks_exact(self.bands) {
            weigh.iter_mut().zip(of).for_each(|(w, d)| *w += WORTH * d.abs());
        }
        if weigh.iter().all(|w| *w <= 0.0) {
            weigh.fill(1.0);
        }
        let stage = &self.tracer.tracer.stage;
        let mut scatter = ScatterPoint::new(stage, surface, [1.0; 3], surface.rho_t());
        let rho_s = scatter.rho_s()[0];
        let shine = if rho_s > 0.0 { rho_s * weigh.iter().sum::<f64>() } else { 0.0 };
        let of = self.tracer.of(surface);
        scatter.choose([product(weigh, &of.rho_d[usize::from(surface.back)]), product(weigh, &of.rho_t), shine]);
        scatter
    }

    /// What is scattered from one direction (1/sr).
    fn scattered(&self, surface: &Surface, scatter: &ScatterPoint, l: glam::DVec3) -> Scattered<'_> {
        let ([diffuse, through, gloss], of) = (scatter.factors(l), self.tracer.of(surface));
        let gloss = gloss * scatter.rho_s()[0];
        match through > 0.0 {
            true => Scattered { rho: &of.rho_t, factor: through, gloss, through: true },
            false => {
                let rho = &of.rho_d[usize::from(surface.back)];
                Scattered { rho, factor: diffuse, gloss, through: false }
            }
        }
    }

    /// Places of the parameters that change a lobe of a surface.
    fn asked(&self, leaf: usize, surface: &Surface, through: bool) -> impl Iterator<Item = usize> {
        let side = surface.back;
        self.of.iter().enumerate().filter_map(move |(k, of)| {
            let own = match of {
                RadianceParameter::RhoD { leaf: own, back } => !through && *own == leaf && *back == side,
                RadianceParameter::RhoT(own) => through && *own == leaf,
                _ => false,
            };
            own.then_some(k)
        })
    }

    /// Whether any light is scattered, or would be with other numbers.
    fn any(&self, to: &Scattered, leaf: usize, surface: &Surface) -> bool {
        let by_rho = to.rho.iter().any(|rho| *rho > 0.0) || self.asked(leaf, surface, to.through).next().is_some();
        to.gloss > 0.0 || to.factor > 0.0 && by_rho
    }

    /// Light of the strength `lit` that a surface scatters.
    fn gather(&self, brought: &mut [f64], carried: &Carried, to: &Scattered, leaf: usize, surface: &Surface, lit: f64) {
        let (light, slopes) = brought.split_at_mut(self.bands);
        let add = |sums: &mut [f64], of: &[f64]| {
            let each = sums.iter_mut().zip(of).zip(to.rho);
            each.for_each(|((sum, c), rho)| *sum += c * (rho * to.factor + to.gloss) * lit);
        };
        add(light, &carried.light);
        slopes.chunks_exact_mut(self.bands).zip(carried.slopes.chunks_exact(self.bands)).for_each(|(s, d)| add(s, d));
        for k in self.asked(leaf, surface, to.through) {
            let sums = &mut slopes[k * self.bands..][..self.bands];
            sums.iter_mut().zip(&carried.light).for_each(|(sum, c)| *sum += c * to.factor * lit);
        }
    }

    /// Goes on in a direction, in which `to` is divided by the density of the draw.
    fn turn(&self, carried: &mut Carried, to: &Scattered, leaf: usize, surface: &Surface) {
        let weight = |rho: &f64| rho * to.factor + to.gloss;
        for of in carried.slopes.chunks_exact_mut(self.bands) {
            of.iter_mut().zip(to.rho).for_each(|(d, rho)| *d *= weight(rho));
        }
        for k in self.asked(leaf, surface, to.through) {
            let of = &mut carried.slopes[k * self.bands..][..self.bands];
            of.iter_mut().zip(&carried.light).for_each(|(d, c)| *d += c * to.factor);
        }
        carried.light.iter_mut().zip(to.rho).for_each(|(c, rho)| *c *= weight(rho));
    }
}
