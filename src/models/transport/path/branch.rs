//! Light as B1 follows it (§4). Every hit of a leaf sends three rays, with the weights of the table, until the
//! luminance that they carry falls below a threshold. Direct light uses the diffuse shares of the side.
//!
//! This is for comparison with the paper and with [`PathTracer::look`], which follows one of the rays at random and
//! loses no light. Here the number of rays grows with each hit, and light below the threshold is lost.

use super::scattering::ScatterPoint;
use super::{PathSampler, PathTracer, SamplingStrategy};
use crate::accelerate::Ray;
use crate::seeds::scramble;
use crate::stage::SideBy;
use glam::DVec3;
use mesophyll_optics::foliar::fsm;

/// The number of hits after which a ray ends, whatever it carries.
const DEEPEST: usize = 64;

impl PathTracer<'_> {
    /// Mean radiance along a line of sight from `times` trees of rays, which end below the luminance `cut`. Also
    /// returns the mean number of rays of a tree at each depth, the camera's ray first.
    pub fn branched(&self, eye: DVec3, direction: DVec3, cut: f64, times: u32, seed: u64) -> ([f64; 3], Vec<f64>) {
        let ray = Ray::new(eye, direction.normalize_or_zero());
        let (mut sum, mut rays) = ([0.0; 3], Vec::new());
        for k in 0..times {
            let mut tree = Tree { tracer: self, cut, rays: &mut rays };
            let mut samples = PathSampler::new(scramble(seed, 0), k);
            let found = tree.follow(ray, [1.0; 3], 0, true, &mut samples);
            (0..3).for_each(|c| sum[c] += found[c] / f64::from(times));
        }
        (sum, rays.iter().map(|n| *n as f64 / f64::from(times)).collect())
    }
}

struct Tree<'a, 'b> {
    tracer: &'a PathTracer<'b>,
    cut: f64,
    rays: &'a mut Vec<u64>,
}

impl Tree<'_, '_> {
    /// The light that comes back along `ray`. `sees` tells whether lights that it hits were not sampled before.
    fn follow(&mut self, ray: Ray, carried: [f64; 3], depth: usize, sees: bool, samples: &mut PathSampler) -> [f64; 3] {
        let tracer = self.tracer;
        if self.rays.len() <= depth {
            self.rays.resize(depth + 1, 0);
        }
        self.rays[depth] += 1;
        let Some(met) = tracer.stage.nearest(&ray) else {
            return match (depth, sees) {
                (0, _) => tracer.background(ray.direction),
                (_, true) => tracer.lights.seen(ray.direction, 1.0, SamplingStrategy::Surfaces, true),
                (_, false) => [0.0; 3],
            };
        };
        let surface = tracer.stage.surface(&met, SideBy::Triangle);
        let scatter = ScatterPoint::new(&tracer.stage, &surface, carried, surface.rho_t());
        let mut sum = [0.0; 3];
        if let Some(light) = tracer.lights.draw(samples.next(), SamplingStrategy::Lights) {
            let f = scatter.diffuse_times_cosine(light.direction);
            if f.iter().any(|x| *x > 0.0)
                && !tracer.stage.blocked(&tracer.stage.leave(surface.point, surface.flat, light.direction))
            {
                (0..3).for_each(|c| sum[c] += f[c] * light.weight[c]);
            }
        }
        for (k, (direction, weight)) in scatter.three(samples.next()).into_iter().enumerate() {
            let next = [0, 1, 2].map(|c: usize| carried[c] * weight[c]);
            if !(fsm::luminance(next) >= self.cut) || depth >= DEEPEST {
                continue;
            }
            let ray = tracer.stage.leave(surface.point, surface.flat, direction);
            let found = self.follow(ray, next, depth + 1, k == 0, samples);
            (0..3).for_each(|c| sum[c] += weight[c] * found[c]);
        }
        sum
    }
}
