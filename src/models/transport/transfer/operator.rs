//! The light that arrives at the anchors of a leaf, as a linear function of the light around the scene.
//!
//! The **rows** of an anchor are numbers from which a shader computes everything that it shows there:
//!
//! ```text
//! front irradiance vector  F₁ = ∫ L(ω) ω dω over directions on the front of the anchor's triangle   (3 rows)
//! back irradiance vector   F₂ = the same over the back                                               (3 rows)
//! harmonics of the light   L_lm = ∫ L(ω) Y_lm(ω) dω, l < N, for gloss                                (N² rows)
//! irradiance               E = ∫ L(ω) n·ω dω over the front, of wood and ground instead of all these (1 row)
//! ```
//! L is the radiance that arrives from the sky where nothing hides it, and from other leaves. Direct light from the
//! sun's disk is not included, because it is sharp and is drawn with shadows. A surface with the mapped normal n
//! collects the irradiance max(0, n·F). This is exact except for directions on the viewed side of the blade that are
//! behind n.
//!
//! A row is a sum over **columns**, which describe the light around. Columns are real harmonics of sky and sun, for a
//! light that moves (Wang et al. 2005, §4, has 25). Or there is a single column, the scene's own light, for a light
//! that does not move; it is not cut to a few bands. Each entry is an integral over paths from the anchor outwards,
//! estimated by Monte Carlo with Owen-scrambled Sobol points.

use super::anchors::{Anchor, normal, position};
use super::occlusion::Hidden;
use crate::path::{PathSampler, PathTracer};
use crate::seeds::{mix, scramble};
use crate::stage::{SideBy, rotation};
use crate::world::ReferenceWorld;
use glam::DVec3;
use mesophyll_sky::harmonics::HarmonicBasis;
use rayon::prelude::*;
use serde::Deserialize;
use std::f64::consts::{PI, TAU};

/// The functions that a light is a sum of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransferColumns {
    /// Harmonics of this many bands, for a light that moves.
    Harmonics(usize),
    /// The scene's own light, without the sun's disk.
    Light,
}

impl TransferColumns {
    /// Number of columns.
    pub fn count(self) -> usize {
        match self {
            TransferColumns::Harmonics(bands) => bands * bands,
            TransferColumns::Light => 1,
        }
    }
}

/// The rows that a surface needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransferRows {
    /// The front's irradiance as one number: wood and ground.
    Front,
    /// The irradiance vectors of both sides: a matte leaf.
    Both,
    /// These and the harmonics of this many bands: a glossy leaf.
    Glossy(usize),
}

impl TransferRows {
    /// Number of rows.
    pub fn count(self) -> usize {
        match self {
            TransferRows::Front => 1,
            TransferRows::Both => 6,
            TransferRows::Glossy(bands) => 6 + bands * bands,
        }
    }
}

/// An instance of the world for which the arriving light is computed.
#[derive(Debug, Clone, Copy)]
pub struct TransferReceiver<'a> {
    /// Index of the instance in the world.
    pub instance: usize,
    /// Anchors of its mesh.
    pub anchors: &'a [Anchor],
    /// The rows of each anchor.
    pub rows: TransferRows,
}

/// How light between surfaces is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TransferMethod {
    /// By paths that are followed through all scatterings.
    #[default]
    Paths,
    /// By one ray each, and an estimate of what surfaces in the way show ([`super::occlusion`]).
    AmbientOcclusion,
}

/// The settings of the computation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransferRequest {
    /// How light between surfaces is found.
    pub method: TransferMethod,
    /// The functions that the light is a sum of.
    pub columns: TransferColumns,
    /// Paths from each anchor, in all directions; at least [`ROUNDS`].
    pub paths: u32,
    /// Seed of the random numbers.
    pub seed: u64,
}

/// Number of independent randomisations of an anchor's paths. Their scatter gives the error.
pub const ROUNDS: u32 = 8;

/// The result for one instance.
#[derive(Debug, Clone, PartialEq)]
pub struct InstanceTransfer {
    /// The entries anchor by anchor, row by row, column by column: red, green and blue of the light by way of other
    /// surfaces, and the share that comes straight from the sky. For [`TransferColumns::Light`] the first three contain
    /// all light.
    pub entries: Vec<[f32; 4]>,
    /// Relative standard error of each anchor's irradiance on both sides together, under an even light all around
    /// (under the scene's own light for [`TransferColumns::Light`]). NaN where no light arrives.
    pub errors: Vec<f32>,
}

/// Computes the light that arrives at one instance. Threads share the anchors. It may end early when a stop is
/// requested, which the caller must check.
pub fn measure(tracer: &PathTracer, receiver: &TransferReceiver, request: &TransferRequest) -> InstanceTransfer {
    let world = tracer.world();
    let (rows, columns) = (receiver.rows.count(), request.columns.count());
    let each: Vec<(Vec<[f32; 4]>, f32)> = receiver
        .anchors
        .par_iter()
        .enumerate()
        .map(|(k, anchor)| {
            if mesophyll_files::progress::stop_requested() {
                return (vec![[0.0; 4]; rows * columns], f32::NAN);
            }
            let seed = mix(mix(request.seed, receiver.instance as u64), k as u64);
            At::new(world, receiver, anchor).measure(tracer, request, seed)
        })
        .collect();
    InstanceTransfer {
        entries: each.iter().flat_map(|e| &e.0).copied().collect(),
        errors: each.iter().map(|e| e.1).collect(),
    }
}

/// An anchor at its place in the world.
struct At {
    /// The points of its neighbourhood, and their normals.
    points: Vec<(DVec3, DVec3)>,
    /// Their mean normal.
    normal: DVec3,
    rows: TransferRows,
}

impl At {
    fn new(world: &ReferenceWorld, receiver: &TransferReceiver, anchor: &Anchor) -> At {
        let placed = &world.instances[receiver.instance];
        let leaf = &world.leaves[placed.leaf];
        let turn = rotation(&placed.transform);
        let points: Vec<(DVec3, DVec3)> = anchor
            .points
            .iter()
            .map(|p| (placed.transform.transform_point3(position(leaf, p)), turn * normal(leaf, p)))
            .map(|(p, n)| (p, n.normalize_or(DVec3::Z)))
            .collect();
        let normal = points.iter().map(|p| p.1).sum::<DVec3>().normalize_or(DVec3::Z);
        At { points, normal, rows: receiver.rows }
    }

    fn measure(&self, tracer: &PathTracer, request: &TransferRequest, seed: u64) -> (Vec<[f32; 4]>, f32) {
        let (rows, columns) = (self.rows.count(), request.columns.count());
        let basis = HarmonicBasis::new(match (request.columns, self.rows) {
            (TransferColumns::Harmonics(bands), TransferRows::Glossy(more)) => bands.max(more),
            (TransferColumns::Harmonics(bands), _) | (TransferColumns::Light, TransferRows::Glossy(bands)) => bands,
            _ => 1,
        });
        let each = request.paths.div_ceil(ROUNDS).max(1);
        // Paths go into the whole sphere, or into the front's half of it.
        let sphere = if self.rows == TransferRows::Front { TAU } else { 2.0 * TAU };
        let weight = sphere / f64::from(each) / f64::from(ROUNDS);
        let mut sum = vec![[0f32; 4]; rows * columns];
        let mut round = sum.clone();
        let mut values = vec![0.0; rows];
        let mut harmonics = vec![0.0; basis.bands().pow(2)];
        let mut arriving = vec![[0f32; 4]; columns];
        let mut levels = [0.0; ROUNDS as usize];
        for (q, level) in levels.iter_mut().enumerate() {
            round.fill([0.0; 4]);
            let mut hidden = Hidden::none(rows);
            for k in 0..each {
                let mut samples = PathSampler::new(scramble(seed, q as u64), k);
                let drawn = samples.next();
                let Some(&(point, normal)) = self.points.get((drawn[2] * self.points.len() as f64) as usize) else {
                    continue;
                };
                let ray = self.direction(normal, drawn);
                let out = tracer.stage.leave(point, normal, ray);
                self.values(ray, normal, weight, &basis, &mut values);
                let arrived = match request.method {
                    TransferMethod::Paths => {
                        arrives(tracer, out, request.columns, &basis, &mut harmonics, &mut arriving, &mut samples)
                    }
                    TransferMethod::AmbientOcclusion => {
                        self.meet_sun(tracer, point, normal, f64::from(each * ROUNDS), &mut hidden);
                        match tracer.stage.nearest(&out) {
                            Some(met) => {
                                let surface = tracer.stage.surface(&met, SideBy::Triangle);
                                let cosine = surface.toward_viewer().dot(self.normal);
                                hidden.add(&values, cosine, surface.rho_d(), surface.rho_t());
                                false
                            }
                            None => {
                                straight(tracer, ray, request.columns, &basis, &mut harmonics, &mut arriving);
                                true
                            }
                        }
                    }
                };
                if !arrived {
                    continue;
                }
                for (row, value) in values.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                    let value = *value as f32;
                    for (to, from) in round[row * columns..][..columns].iter_mut().zip(&arriving) {
                        (0..4).for_each(|c| to[c] += value * from[c]);
                    }
                }
            }
            if request.method == TransferMethod::AmbientOcclusion {
                hidden.close(&mut round, columns, 1.0 / f64::from(ROUNDS), |row| self.irradiance(row));
            }
            *level = self.level(&round, request.columns);
            for (to, from) in sum.iter_mut().zip(&round) {
                (0..4).for_each(|c| to[c] += from[c]);
            }
        }
        let n = f64::from(ROUNDS);
        let mean = levels.iter().sum::<f64>() / n;
        let spread = levels.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / (n - 1.0) / n;
        (sum, if mean > 0.0 { (spread.sqrt() / mean) as f32 } else { f32::NAN })
    }

    /// Writes what light along `ray` adds to each row, times a weight.
    fn values(&self, ray: DVec3, normal: DVec3, weight: f64, basis: &HarmonicBasis, out: &mut [f64]) {
        if self.rows == TransferRows::Front {
            out[0] = weight * ray.dot(normal).max(0.0);
            return;
        }
        let first = if ray.dot(normal) < 0.0 { 3 } else { 0 };
        out[..6].fill(0.0);
        (0..3).for_each(|c| out[first + c] = weight * ray[c]);
        if let TransferRows::Glossy(bands) = self.rows {
            let mut all = [0.0; 49];
            basis.fill(ray.to_array(), &mut all[..basis.bands().pow(2)]);
            (0..bands * bands).for_each(|c| out[6 + c] = weight * all[c]);
        }
    }

    /// Irradiance of front and back from the values of the rows. Wood and ground have no back: it gets what the front
    /// gets.
    fn irradiance(&self, row: &dyn Fn(usize) -> f64) -> [f64; 2] {
        match self.rows {
            TransferRows::Front => [row(0); 2],
            _ => [(0, 1.0), (3, -1.0)]
                .map(|(first, sign)| sign * (0..3).map(|c| row(first + c) * self.normal[c]).sum::<f64>()),
        }
    }

    /// Adds the sun's light at a point of the neighbourhood, of which there are `count`.
    fn meet_sun(&self, tracer: &PathTracer, point: DVec3, normal: DVec3, count: f64, hidden: &mut Hidden) {
        let Some(sun) = &tracer.world().sun else { return };
        let l = sun.direction.normalize_or_zero();
        let cosine = l.dot(normal);
        if tracer.stage.blocked(&tracer.stage.leave(point, normal, l)) {
            return;
        }
        let irradiance = sun.irradiance.map(|e| e * cosine.abs() / count);
        match self.rows {
            TransferRows::Front if cosine < 0.0 => {}
            TransferRows::Front => [false, true].into_iter().for_each(|back| hidden.add_sun(back, irradiance)),
            _ => hidden.add_sun(cosine < 0.0, irradiance),
        }
    }

    /// A direction of the sphere, or of the front's half of it, with uniform density.
    fn direction(&self, normal: DVec3, [u, v, ..]: [f64; 4]) -> DVec3 {
        let z = if self.rows == TransferRows::Front { u } else { 1.0 - 2.0 * u };
        let (a, b) = normal.any_orthonormal_pair();
        let (sin, cos) = (TAU * v).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        (a * (r * cos) + b * (r * sin) + normal * z).normalize()
    }

    /// The irradiance of both sides together, under an even light of radiance 1/π, or under the scene's own light.
    fn level(&self, entries: &[[f32; 4]], columns: TransferColumns) -> f64 {
        // The first harmonic is √(1/4π) everywhere, so light of radiance 1 has the coefficient √(4π).
        let even = if columns == TransferColumns::Light { 1.0 } else { (4.0 * PI).sqrt() / PI };
        let light = |row: usize| {
            let e = entries[row * columns.count()];
            f64::from(e[0] + e[1] + e[2]) / 3.0 + f64::from(e[3])
        };
        let sum = match self.rows {
            TransferRows::Front => light(0),
            _ => (0..3).map(|c| (light(c) - light(3 + c)) * self.normal[c]).sum::<f64>(),
        };
        sum * even
    }
}

/// Writes the light that comes straight from `direction` into `out`, for each column.
fn straight(
    tracer: &PathTracer,
    direction: DVec3,
    columns: TransferColumns,
    basis: &HarmonicBasis,
    harmonics: &mut [f64],
    out: &mut [[f32; 4]],
) {
    match columns {
        TransferColumns::Light => {
            let [r, g, b] = tracer.sky(direction).map(|v| v as f32);
            out[0] = [r, g, b, 0.0];
        }
        TransferColumns::Harmonics(_) => {
            basis.fill(direction.to_array(), harmonics);
            out.iter_mut().zip(harmonics.iter()).for_each(|(to, y)| *to = [0.0, 0.0, 0.0, *y as f32]);
        }
    }
}

/// Writes the light that arrives along a ray into `out`, a colour for each column. Returns false where none arrives.
fn arrives(
    tracer: &PathTracer,
    ray: crate::accelerate::Ray,
    columns: TransferColumns,
    basis: &HarmonicBasis,
    harmonics: &mut [f64],
    out: &mut [[f32; 4]],
    samples: &mut PathSampler,
) -> bool {
    match columns {
        TransferColumns::Light => {
            let [r, g, b] = tracer.arriving(ray, samples).map(|v| v as f32);
            out[0] = [r, g, b, 0.0];
            true
        }
        TransferColumns::Harmonics(_) => {
            let Some(way) = tracer.escape(ray, samples) else { return false };
            basis.fill(way.direction.to_array(), harmonics);
            let [r, g, b] = way.carried.map(|v| v as f32);
            for (to, y) in out.iter_mut().zip(harmonics.iter()) {
                let y = *y as f32;
                *to = if way.straight { [0.0, 0.0, 0.0, y] } else { [r * y, g * y, b * y, 0.0] };
            }
            true
        }
    }
}
