//! What becomes of the sun's light in any number of bands, along the same paths.

use super::bands::{BandTracer, SurfaceBands, largest, product};
use super::canopy::{Canopy, CanopyFluxes};
use super::estimate::estimate_all;
use super::scattering::ScatterPoint;
use super::{FOLLOWED, MOST_SCATTERINGS, PathSampler};
use crate::accelerate::Ray;
use crate::stage::SideBy;

impl Canopy<'_> {
    /// What becomes of the light of each of `bands` bands, from `paths` paths that follow the light. `surfaces` has
    /// what each of the world's leaves scatters.
    ///
    /// # Errors
    /// As [`Canopy::brf_of_bands`].
    pub fn fluxes_of_bands(
        &self,
        surfaces: &[SurfaceBands],
        bands: usize,
        paths: u32,
    ) -> Result<Vec<CanopyFluxes>, String> {
        let tracer = BandTracer::new(self.tracer(), surfaces, bands)?;
        let found = estimate_all(self.flux_key(), paths, 4 * bands, |samples, add| {
            let mut brought = vec![0.0; 4 * bands];
            for samples in samples {
                let [u, v, ..] = samples.next();
                tracer.light(self.lit([u, v]), samples, bands, &mut brought);
                add(&brought);
            }
        });
        let of = |b: usize| CanopyFluxes {
            reflected: found[b],
            absorbed: found[bands + b],
            transmitted: found[2 * bands + b],
            closure: found[3 * bands + b],
        };
        Ok((0..bands).map(of).collect())
    }
}

impl BandTracer<'_> {
    /// One path that follows the light. `brought` becomes what is reflected, absorbed and transmitted, and the closing
    /// sum, each of all bands together.
    fn light(&self, mut ray: Ray, samples: &mut PathSampler, bands: usize, brought: &mut [f64]) {
        let stage = &self.tracer.stage;
        brought.fill(0.0);
        // The fourth part holds what the ground takes up until the end.
        let (mut reflected, mut absorbed, mut transmitted, mut in_ground) = {
            let mut parts = brought.chunks_exact_mut(bands.max(1));
            let mut next = || parts.next().unwrap_or_default();
            (next(), next(), next(), next())
        };
        let add = |sums: &mut &mut [f64], list: &[f64]| sums.iter_mut().zip(list).for_each(|(sum, v)| *sum += v);
        let mut carried = vec![1.0; bands];
        for turned in 1..=MOST_SCATTERINGS {
            let Some(met) = stage.nearest(&ray) else {
                if ray.direction.z > 0.0 {
                    add(&mut reflected, &carried);
                } else {
                    add(&mut transmitted, &carried);
                    add(&mut in_ground, &carried);
                }
                break;
            };
            let surface = stage.surface(&met, SideBy::Triangle);
            let ground = stage.world.ground == Some(surface.instance);
            let of = self.of(&surface);
            let (rho_d, rho_t) = (&of.rho_d[usize::from(surface.back)], &of.rho_t);
            let mut scatter = ScatterPoint::new(stage, &surface, [1.0; 3], surface.rho_t_inward());
            let rho_s = scatter.rho_s()[0];
            let shine = if rho_s > 0.0 { rho_s * carried.iter().sum::<f64>() } else { 0.0 };
            scatter.choose([product(&carried, rho_d), product(&carried, rho_t), shine]);
            let before = carried.clone();
            let direction = scatter.direction(samples.next());
            let density = direction.map_or(0.0, |l| scatter.density(l));
            match direction.filter(|_| density > 0.0) {
                Some(l) => {
                    let [diffuse, through, gloss] = scatter.factors(l);
                    let (rho, factor) = if through > 0.0 { (rho_t, through) } else { (rho_d, diffuse) };
                    carried.iter_mut().zip(rho).for_each(|(c, rho)| *c *= (rho * factor + gloss * rho_s) / density);
                }
                None => carried.fill(0.0),
            }
            let lost: Vec<f64> = before.iter().zip(&carried).map(|(a, b)| a - b).collect();
            if ground {
                add(&mut transmitted, &before);
                add(&mut in_ground, &lost);
            } else {
                add(&mut absorbed, &lost);
            }
            let largest = largest(&carried);
            let Some(l) = direction.filter(|_| largest > 0.0) else { break };
            ray = stage.leave(surface.point, surface.flat, l);
            if turned > FOLLOWED {
                let share = largest.min(1.0);
                carried.iter_mut().for_each(|c| *c /= share);
                if samples.next()[0] >= share {
                    break;
                }
            }
        }
        let sums = reflected.iter().zip(absorbed.iter());
        in_ground.iter_mut().zip(sums).for_each(|(sum, (a, b))| *sum += a + b);
    }
}
