//! Pictures of a world. Stratified rays go through each pixel's square (a box filter, like multisampling), and each of
//! them samples the sun's disk. Radiance is averaged before the tone map.
//!
//! Sample points are Owen-scrambled Sobol points (Burley 2020). The samples of a pixel form two independent sets, and
//! their difference is the printed noise. It has one degree of freedom, so it is right on average and not for a single
//! pixel. The sets of a pixel depend only on the seed and on its place, so the number of threads changes nothing.

use super::accelerate::Ray;
use super::camera::{CameraRays, ReferenceCamera};
use super::dome::{BELOW, DISK};
use super::seeds::scramble;
use super::shading::{Direct, DiskPoint};
use super::tone;
use super::world::ReferenceWorld;
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_files::progress::TaskProgress;
use rayon::prelude::*;
use sobol_burley::sample_4d;
use std::f64::consts::PI;

/// The density of the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Rays for each pixel, 1 to 65,536. Numbers above 1 are rounded up to even ones; powers of two are stratified
    /// best.
    pub samples_per_pixel: u32,
    /// Points of the sun's disk for each ray. The product with `samples_per_pixel` is at most 65,536.
    pub sun_samples: u32,
    /// Directions in which a glossy side samples a dome, for each ray, with the same limit.
    pub sky_samples: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Width of the margin: a pixel counts as interior, or as free of penumbra, when all pixels within this distance
    /// agree.
    pub margin: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options { samples_per_pixel: 16, sun_samples: 2, sky_samples: 4, seed: 1, margin: 1 }
    }
}

/// A picture and what is known about its error, row by row, with row 0 on top.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePicture {
    /// Number of pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Radiance before exposure, and the share of the pixel that shows a leaf.
    pub hdr: Vec<[f32; 4]>,
    /// The picture, sRGB, alpha 255.
    pub ldr: Vec<[u8; 4]>,
    /// Standard error of the picture's worst channel, in display units (1 is white); 0 where there is one sample for
    /// each pixel.
    pub noise: Vec<f32>,
    /// Whether all rays of the pixel and of its neighbours met the same side of the same instance, or all met nothing.
    pub interior: Vec<bool>,
    /// Whether the sun is partly hidden here or nearby, or lights different sides of the blade.
    pub penumbra: Vec<bool>,
}

impl ReferencePicture {
    /// Replaces the light by the radiance of another picture of the same shapes: that of the path tracer, with light
    /// between leaves.
    pub fn relit(&mut self, radiance: &[[f32; 3]], exposure: f64) {
        for ((hdr, ldr), new) in self.hdr.iter_mut().zip(&mut self.ldr).zip(radiance) {
            hdr[..3].copy_from_slice(new);
            let byte = |v: f32| (tone::display(f64::from(v), exposure) * 255.0 + 0.5) as u8;
            *ldr = [byte(new[0]), byte(new[1]), byte(new[2]), 255];
        }
    }
}

/// A world with its trees and tables, ready for any number of pictures.
pub struct ReferenceRenderer<'a> {
    direct: Direct<'a>,
}

/// [`ReferenceRenderer::new`] and one picture.
pub fn render(
    world: &ReferenceWorld,
    camera: &ReferenceCamera,
    width: usize,
    height: usize,
    options: &Options,
) -> Result<ReferencePicture> {
    ReferenceRenderer::new(world)?.render(camera, width, height, options)
}

impl<'a> ReferenceRenderer<'a> {
    /// # Errors
    /// [`Error::Input`] when a map, a mesh or an index does not fit; see [`ReferenceWorld::validate`].
    pub fn new(world: &'a ReferenceWorld) -> Result<ReferenceRenderer<'a>> {
        world.validate()?;
        Ok(ReferenceRenderer { direct: Direct::new(world) })
    }

    /// The world that is drawn.
    pub(super) fn world(&self) -> &ReferenceWorld {
        self.direct.stage.world
    }

    /// The radiance along one ray, without sun and dome.
    pub(super) fn look(&self, ray: &Ray) -> [f64; 3] {
        self.direct.see(ray, &[], &[]).radiance
    }

    /// One picture.
    ///
    /// # Errors
    /// [`Error::Usage`] for an empty picture, too many or no samples, or a camera that looks nowhere.
    pub fn render(
        &self,
        camera: &ReferenceCamera,
        width: usize,
        height: usize,
        options: &Options,
    ) -> Result<ReferencePicture> {
        if width == 0 || height == 0 {
            return Err(Error::Usage(format!("a picture of {width}×{height} pixels, expected at least 1×1")));
        }
        let (rays, suns) = (
            options.samples_per_pixel,
            options.sun_samples.max(if self.direct.stage.world.dome.is_some() { options.sky_samples } else { 0 }),
        );
        if rays == 0 || options.sun_samples == 0 || options.sky_samples == 0 || rays.saturating_mul(suns) > 1 << 16 {
            return Err(Error::Usage(format!(
                "{rays} rays a pixel with {suns} sun samples each, expected 1 to 65536 together"
            )));
        }
        let lens = CameraRays::new(camera, width, height)?;
        let patterns = Patterns::new(options, self.direct.stage.world.dome.is_some());
        let bar = TaskProgress::new("drawing the reference", height as u64);
        let row = |j: usize| {
            let pixels: Vec<Pixel> = (0..width).map(|i| self.pixel(&lens, &patterns, j * width + i, width)).collect();
            bar.advance(1);
            pixels
        };
        let pixels: Vec<Pixel> = (0..height).into_par_iter().flat_map_iter(row).collect();
        let exposure = self.direct.stage.world.exposure;
        let near = |test: &(dyn Fn(&Pixel, &Pixel) -> bool + Sync)| -> Vec<bool> {
            (0..width * height)
                .into_par_iter()
                .map(|k| {
                    let (x, y, r) = (k % width, k / width, options.margin);
                    let columns = x.saturating_sub(r)..=(x + r).min(width - 1);
                    (y.saturating_sub(r)..=(y + r).min(height - 1))
                        .all(|j| columns.clone().all(|i| test(&pixels[k], &pixels[j * width + i])))
                })
                .collect()
        };
        let interior = near(&|a, b| a.surface == b.surface && a.surface != MIXED);
        let steady = near(&|a, b| (a.light | b.light).count_ones() <= 1);
        Ok(ReferencePicture {
            width,
            height,
            hdr: pixels
                .iter()
                .map(|p| [p.mean[0] as f32, p.mean[1] as f32, p.mean[2] as f32, p.coverage as f32])
                .collect(),
            ldr: pixels
                .iter()
                .map(|p| {
                    let [r, g, b] = p.mean.map(|x| tone::quantise(tone::display(x, exposure)));
                    [r, g, b, 255]
                })
                .collect(),
            noise: pixels
                .iter()
                .map(|p| {
                    (0..3).map(|c| p.error[c] * tone::display_slope(p.mean[c], exposure)).fold(0.0, f64::max) as f32
                })
                .collect(),
            interior,
            penumbra: steady.into_iter().map(|s| !s).collect(),
        })
    }

    fn pixel(&self, lens: &CameraRays, patterns: &Patterns, index: usize, width: usize) -> Pixel {
        let (x, y) = ((index % width) as f64, (index / width) as f64);
        let (mut mean, mut square, mut hits) = ([0.0; 3], [0.0; 3], 0u32);
        let (mut surface, mut light) = (None, 0u8);
        let sets = patterns.sets as f64;
        for set in 0..patterns.sets {
            let pattern = patterns.choose(index, set);
            let mut sum = [0.0; 3];
            let lobes = pattern.lobe.len() / pattern.pixel.len();
            for (k, (at, disk)) in pattern.pixel.iter().zip(pattern.disk.chunks_exact(patterns.sun_samples)).enumerate()
            {
                let seen =
                    self.direct.see(&lens.ray(x + at[0], y + at[1]), disk, &pattern.lobe[k * lobes..(k + 1) * lobes]);
                for (s, r) in sum.iter_mut().zip(seen.radiance) {
                    *s += r;
                }
                hits += u32::from(!matches!(seen.surface, 0 | BELOW | DISK));
                light |= seen.light;
                surface = match surface {
                    None => Some(seen.surface),
                    Some(s) if s == seen.surface => surface,
                    Some(_) => Some(MIXED),
                };
            }
            for c in 0..3 {
                let of_set = sum[c] / pattern.pixel.len() as f64;
                mean[c] += of_set / sets;
                square[c] += of_set * of_set / sets;
            }
        }
        let error = [0, 1, 2].map(|c| {
            let spread = (square[c] - mean[c] * mean[c]).max(0.0);
            if sets > 1.0 { (spread / (sets - 1.0)).sqrt() } else { 0.0 }
        });
        let coverage = f64::from(hits) / (sets * patterns.rays_per_set as f64);
        Pixel { mean, error, coverage, surface: surface.unwrap_or(0), light }
    }

    /// The share of the sun's disk that `point` (not on a surface) sees, from `samples` stratified points; `None`
    /// without a sun.
    pub fn sun_visibility(&self, point: DVec3, samples: u32, seed: u64) -> Option<f64> {
        let sun = self.direct.stage.world.sun.as_ref()?;
        let samples = samples.clamp(1, 1 << 16);
        let points = (0..samples).map(|k| disk_point(k, scramble(seed, 0)));
        Some(points.filter(|&p| self.direct.sees_sun(sun, point, p)).count() as f64 / f64::from(samples))
    }
}

/// The result of the rays of one pixel.
struct Pixel {
    mean: [f64; 3],
    error: [f64; 3],
    coverage: f64,
    surface: u32,
    light: u8,
}

/// The surface number of a pixel whose rays met different surfaces.
const MIXED: u32 = u32::MAX;

/// Sample sets that are made once. Drawing them again for every ray would take a fifth of the picture's time.
struct Patterns {
    seed: u64,
    /// Number of sets for each pixel.
    sets: usize,
    rays_per_set: usize,
    sun_samples: usize,
    patterns: Vec<Pattern>,
}

/// One stratified set.
struct Pattern {
    /// Points of the pixel's square.
    pixel: Vec<[f64; 2]>,
    /// Points of the sun's disk, `sun_samples` for each ray.
    disk: Vec<DiskPoint>,
    /// Points of the unit square for half vectors, the same number for each ray; none without a dome.
    lobe: Vec<[f64; 2]>,
}

impl Patterns {
    fn new(options: &Options, dome: bool) -> Patterns {
        let rays = options.samples_per_pixel as usize;
        // Two sets give an error with one degree of freedom for each pixel, and are stratified twice as well as four
        // would be.
        let sets = if rays < 2 { 1 } else { 2 };
        // The number of patterns is limited to keep the table small.
        let count = (1 << 20) / (rays * (1 + options.sun_samples as usize)).max(1);
        let rays_per_set = rays.div_ceil(sets);
        let patterns = (0..count.clamp(16, 1024) as u64)
            .map(|k| {
                let seed = scramble(options.seed, k);
                let pixel = (0..rays_per_set as u32)
                    .map(|i| sample_4d(i, 0, seed))
                    .map(|[u, v, ..]| [f64::from(u), f64::from(v)])
                    .collect();
                let disk = (0..rays_per_set as u32 * options.sun_samples).map(|i| disk_point(i, seed)).collect();
                let lobes = if dome { rays_per_set as u32 * options.sky_samples } else { 0 };
                let lobe =
                    (0..lobes).map(|i| sample_4d(i, 2, seed)).map(|[u, v, ..]| [f64::from(u), f64::from(v)]).collect();
                Pattern { pixel, disk, lobe }
            })
            .collect();
        Patterns { seed: options.seed, sets, rays_per_set, sun_samples: options.sun_samples as usize, patterns }
    }

    /// The pattern for a set of a pixel. The sets of one pixel have different patterns.
    fn choose(&self, pixel: usize, set: usize) -> &Pattern {
        let half = self.patterns.len() / 2;
        &self.patterns[set * half + scramble(!self.seed, (2 * pixel + set) as u64) as usize % half]
    }
}

/// A stratified point of the unit disk.
fn disk_point(index: u32, seed: u32) -> DiskPoint {
    let [u, v, ..] = sample_4d(index, 1, seed);
    let (r, phi) = (f64::from(u).sqrt(), 2.0 * PI * f64::from(v));
    [r * phi.cos(), r * phi.sin()]
}
