//! What the scene shows with the present numbers: pictures and reflectance factors, their derivatives, and their noise.

use crate::Result;
use crate::photographs::{PixelUse, ReadingKind, ScenePhotograph};
use crate::quantity::UnknownKind;
use crate::unknowns::SceneUnknowns;
use mesophyll_transport::path::slopes::{DerivativePicture, DerivativeTracer, RadianceParameter};
use mesophyll_transport::path::{Canopy, MOST_PATHS, PathTracer};
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

/// Pictures and derivatives of the shots that `wanted` chooses, from rounds of `each` paths a pixel.
pub fn draw(
    tracer: &PathTracer,
    shots: &[ScenePhotograph],
    wanted: impl Fn(&ScenePhotograph) -> bool,
    of: &[RadianceParameter],
    [rounds, each]: [u32; 2],
    seed: u64,
) -> Result<Vec<DerivativePicture>> {
    let slopes = DerivativeTracer::new(tracer, of);
    let one = |(k, shot): (usize, &ScenePhotograph)| match wanted(shot) {
        true => shot_of(tracer.world(), &slopes, of, shot, [rounds, each], seed ^ (k as u64) << 40),
        false => Ok(DerivativePicture::default()),
    };
    shots.iter().enumerate().map(one).collect()
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
