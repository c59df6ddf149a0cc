//! Pictures of slabs of blades. Rays along a slab's normal take them.

use crate::grass::blades::LawnMeadow;
use crate::grass::sheet::{CHANNELS, SliceTexel};
use glam::DVec3;
use mesophyll_transport::rays::Ray;
use rayon::prelude::*;

/// The slab of blades that a slice represents.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SliceSlab {
    /// A slab across x: its number, and how many slabs there are.
    X(usize, usize),
    /// A slab across y, with the same two numbers.
    Y(usize, usize),
    /// The whole layer, seen from above.
    Z,
}

impl SliceSlab {
    /// The ray through the slab at the share `u` of the slice's length and the share `v` of its height, and the length
    /// of the ray.
    fn ray(self, meadow: &LawnMeadow, u: f64, v: f64) -> (Ray, f64) {
        let [lx, ly] = meadow.period;
        let (x, y, z) = ((u - 0.5) * lx, (u - 0.5) * ly, v * meadow.height);
        match self {
            SliceSlab::X(k, n) => {
                let step = lx / n as f64;
                (Ray::new(DVec3::new((k as f64 + 1.0) * step - 0.5 * lx, y, z), DVec3::NEG_X), step)
            }
            SliceSlab::Y(k, n) => {
                let step = ly / n as f64;
                (Ray::new(DVec3::new(x, (k as f64 + 1.0) * step - 0.5 * ly, z), DVec3::NEG_Y), step)
            }
            SliceSlab::Z => (Ray::new(DVec3::new(x, (v - 0.5) * ly, meadow.height), DVec3::NEG_Z), meadow.height),
        }
    }

    /// The slab's picture of `cell` texels, the top row first, with `rays` × `rays` rays for each texel.
    pub fn picture(self, meadow: &LawnMeadow, cell: [usize; 2], rays: usize) -> Vec<SliceTexel> {
        let [w, h] = cell;
        let share = |k: usize, i: usize, n: usize| (k as f64 + (i as f64 + 0.5) / rays as f64) / n as f64;
        let texel = |k: usize| {
            let (x, y) = (k % w, k / w);
            let mut sum = [0.0; CHANNELS];
            for i in 0..rays * rays {
                let (ray, length) = self.ray(meadow, share(x, i % rays, w), 1.0 - share(y, i / rays, h));
                // The ground hides the parts of blades that hang below it.
                let Some(met) = meadow.nearest(&ray, length) else { continue };
                let normal = met.normal.to_array();
                let values = [1.0].into_iter().chain(met.rho_d.into_iter().flatten()).chain(met.rho_t).chain(normal);
                let values = values.chain([1.0 - met.t / length]);
                sum.iter_mut().zip(values).for_each(|(s, v)| *s += v);
            }
            sum.map(|s| (s / (rays * rays) as f64) as f32)
        };
        (0..w * h).into_par_iter().map(texel).collect()
    }
}
