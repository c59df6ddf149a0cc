//! What the scene shows with the present numbers: pictures and reflectance factors, their derivatives, and their noise.

use crate::Result;
use crate::photographs::{PixelUse, ReadingKind, ScenePhotograph};
use crate::quantity::UnknownKind;
use crate::unknowns::SceneUnknowns;
use mesophyll_transport::path::slopes::{DerivativePicture, DerivativeTracer, RadianceParameter};
use mesophyll_transport::path::{Canopy, MOST_PATHS, PathSettings, PathTracer};
use mesophyll_transport::world::ReferenceWorld;

/// Rounds of each of the two pictures with derivatives, from whose scatter the noise of a pixel is estimated; the
/// picture that residuals are of has twice as many.
const ROUNDS: u32 = 16;
/// A pixel's own noise is estimated from its rounds, and from as many rounds as this with the mean noise of its
/// neighbours: a bright path that none of its rounds found may have been found there.
const PRIOR: f64 = 2.0;
/// No reading counts as better than this share of itself: no camera is, and our own numbers are not much.
const LEAST: f64 = 1e-3;
/// Paths of a direction of a canopy, for each path of a pixel.
const A_DIRECTION: u32 = 256;

/// The scene under one of the suns that its pictures were taken under.
pub struct LitScene<'a> {
    sun_deg: Option<[f64; 2]>,
    tracer: PathTracer<'a>,
    /// What it is differentiated by, each with the index of its unknown; the same list under every sun.
    pub slopes: Vec<(usize, RadianceParameter)>,
}

/// The worlds with the present numbers under every sun of the shots.
pub fn worlds(numbers: &SceneUnknowns, shots: &[ScenePhotograph]) -> Result<Vec<(Option<[f64; 2]>, ReferenceWorld)>> {
    let mut suns: Vec<Option<[f64; 2]>> = Vec::new();
    for shot in shots {
        if !suns.contains(&shot.sun_deg) {
            suns.push(shot.sun_deg);
        }
    }
    suns.into_iter().map(|sun| Ok((sun, numbers.world(sun)?))).collect()
}

impl<'a> LitScene<'a> {
    /// The scene under every sun.
    pub fn all(numbers: &SceneUnknowns, worlds: &'a [(Option<[f64; 2]>, ReferenceWorld)]) -> Result<Vec<LitScene<'a>>> {
        let one = |(sun_deg, world): &'a (Option<[f64; 2]>, ReferenceWorld)| {
            let tracer = PathTracer::new(world, PathSettings::default())?;
            Ok(LitScene { sun_deg: *sun_deg, tracer, slopes: numbers.slopes(*sun_deg)? })
        };
        worlds.iter().map(one).collect()
    }
}

/// Pictures of the shots that `wanted` chooses, with derivatives where they are asked for, from rounds of `each` paths
/// a pixel.
pub fn draw(
    lit: &[LitScene],
    shots: &[ScenePhotograph],
    wanted: impl Fn(&ScenePhotograph) -> bool,
    sloped: bool,
    [rounds, each]: [u32; 2],
    seed: u64,
) -> Result<Vec<DerivativePicture>> {
    let mut out = vec![DerivativePicture::default(); shots.len()];
    for scene in lit {
        let of: Vec<RadianceParameter> = scene.slopes.iter().filter(|_| sloped).map(|(_, of)| of.clone()).collect();
        let slopes = DerivativeTracer::new(&scene.tracer, &of);
        for (k, shot) in shots.iter().enumerate().filter(|(_, s)| s.sun_deg == scene.sun_deg && wanted(s)) {
            out[k] = shot_of(scene.tracer.world(), &slopes, &of, shot, [rounds, each], seed ^ (k as u64) << 40)?;
        }
    }
    Ok(out)
}

/// A picture, or reflectance factors.
fn shot_of(
    world: &ReferenceWorld,
    slopes: &DerivativeTracer,
    of: &[RadianceParameter],
    shot: &ScenePhotograph,
    [rounds, each]: [u32; 2],
    seed: u64,
) -> Result<DerivativePicture> {
    match &shot.by {
        ReadingKind::Camera(camera) => slopes.picture(camera, shot.size, [rounds, each], seed),
        ReadingKind::Directions(toward) => {
            let canopy = Canopy::new(world, seed).map_err(crate::Error::Missed)?;
            let each = each.saturating_mul(A_DIRECTION).min(MOST_PATHS);
            DerivativeTracer::new(canopy.tracer(), of).factors(&canopy, toward, [rounds, each], seed)
        }
    }
}

/// How readings of a shot depend on the numbers, by two pictures of their own paths.
pub struct ShotSlopes<'a> {
    /// The numbers.
    pub numbers: &'a SceneUnknowns,
    /// The shot.
    pub shot: &'a ScenePhotograph,
    /// What the pictures are differentiated by, each with the index of its unknown.
    pub of: &'a [(usize, RadianceParameter)],
    /// The pictures.
    pub pictures: [&'a DerivativePicture; 2],
}

impl ShotSlopes<'_> {
    /// Puts the derivatives of channel `c` of pixel `k` into `row`: the place of a number, and its derivative by either
    /// picture. `first` has the place of each unknown's first number.
    pub fn row(&self, first: &[usize], k: usize, c: usize, row: &mut Vec<(usize, f64, f64)>) {
        let factor = exposure(self.numbers, self.shot);
        row.clear();
        for (j, (q, _)) in self.of.iter().enumerate() {
            let number = first[*q] + if self.numbers.list[*q].at.len() > 1 { c } else { 0 };
            let [p, q] = self.pictures.map(|sheet| factor * sheet.slopes[k * self.of.len() + j][c]);
            if p != 0.0 || q != 0.0 {
                row.push((number, p, q));
            }
        }
        if let Some(q) = exposure_of(self.numbers, self.shot) {
            let [p, u] = self.pictures.map(|sheet| sheet.mean[k][c]);
            row.push((first[q], p, u));
        }
    }
}

/// Whether any pixel of a shot is fitted.
pub fn is_fitted(shot: &ScenePhotograph) -> bool {
    shot.uses.contains(&PixelUse::Fitted)
}

/// The factor of a shot.
pub fn exposure(numbers: &SceneUnknowns, shot: &ScenePhotograph) -> f64 {
    exposure_of(numbers, shot).map_or(1.0, |k| numbers.list[k].at[0])
}

/// Index of the unknown that is the factor of a shot.
pub fn exposure_of(numbers: &SceneUnknowns, shot: &ScenePhotograph) -> Option<usize> {
    let name = shot.exposure.as_ref()?;
    numbers.list.iter().position(|q| matches!(&q.kind, UnknownKind::Exposure(own) if own == name))
}

/// Rounds and paths a round of half as many paths as these.
pub fn rounds(paths: u32) -> [u32; 2] {
    let half = (paths / 2).max(4);
    let rounds = half.min(ROUNDS);
    [rounds, half.div_ceil(rounds)]
}

/// Variances of the readings of a shot, and those of a picture of twice as many rounds as each of two others has, by
/// which both are judged.
pub fn variances(
    shot: &ScenePhotograph,
    [one, two]: [&DerivativePicture; 2],
    rounds: u32,
    factor: f64,
) -> Vec<[[f64; 3]; 2]> {
    let [w, h] = shot.size;
    let both = |k: usize| [0, 1, 2].map(|c| 0.25 * (one.variance[k][c] + two.variance[k][c]));
    let around = |k: usize| {
        let (x, y) = (k % w, k / w);
        let (mut sum, mut n) = ([0.0; 3], 0.0);
        for j in y.saturating_sub(1)..=(y + 1).min(h - 1) {
            for of in (x.saturating_sub(1)..=(x + 1).min(w - 1)).map(|i| both(j * w + i)) {
                (0..3).for_each(|c| sum[c] += of[c]);
                n += 1.0;
            }
        }
        sum.map(|v| v / n)
    };
    // An error that was estimated from a pixel's own scatter is small where the reading happens to be. Neighbours do
    // not know the reading, and have half of the say.
    let stated = |k: usize| {
        let Some(error) = &shot.error else { return [0.0; 3] };
        let (x, y) = (k % w, k / w);
        let (mut sum, mut n) = ([0.0; 3], 0.0);
        for j in y.saturating_sub(1)..=(y + 1).min(h - 1) {
            for i in x.saturating_sub(1)..=(x + 1).min(w - 1) {
                (0..3).for_each(|c| sum[c] += error[j * w + i][c].powi(2));
                n += 1.0;
            }
        }
        let pooled = matches!(shot.by, ReadingKind::Camera(_));
        let own = error[k].map(|e| e * e);
        if pooled { [0, 1, 2].map(|c| 0.5 * (own[c] + sum[c] / n)) } else { own }
    };
    let mean = |k: usize| [0, 1, 2].map(|c| 0.5 * (one.mean[k][c] + two.mean[k][c]));
    let all = shot.seen.len().max(1) as f64;
    let whole = [0, 1, 2].map(|c| (0..shot.seen.len()).map(|k| mean(k)[c]).sum::<f64>() / all);
    // The mean of an inverse estimate is larger than the inverse of its mean.
    let own_rounds = 2.0 * f64::from(rounds - 1);
    let freedom = own_rounds + PRIOR;
    let wider = freedom / (freedom - 2.0) * factor * factor;
    (0..shot.seen.len())
        .map(|k| {
            let (mean, own, near) = (mean(k), both(k), around(k));
            let own = [0, 1, 2].map(|c| (own_rounds * own[c] + PRIOR * near[c]) / freedom * wider);
            // What is dark has at least a hundredth of the noise of the picture's mean.
            let of = |c: usize| {
                let noise = shot.noise * factor * mean[c].max(0.01 * whole[c]);
                let least = LEAST * factor * mean[c].max(0.01 * whole[c]);
                (stated(k)[c] + noise.powi(2) + shot.floor.powi(2)).max(least.powi(2))
            };
            [[0, 1, 2].map(of), own]
        })
        .collect()
}
