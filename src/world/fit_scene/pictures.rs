//! What the scene shows with the present numbers: pictures and reflectance factors, their derivatives, and their noise.

use crate::Result;
use crate::area;
use crate::photographs::{PixelUse, ReadingKind, ScenePhotograph};
use crate::quantity::UnknownKind;
use crate::unknowns::SceneUnknowns;
use mesophyll_transport::path::slopes::{DerivativePicture, DerivativeTracer, RadianceParameter};
use mesophyll_transport::path::{Canopy, MOST_PATHS, PathSettings, PathTracer, SurfaceBands};
use mesophyll_transport::world::ReferenceWorld;
use std::ops::Range;

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

/// Draws of the discs of differences come after those of what is shown.
const SIDES: u64 = 1000;

/// The world with the present numbers under one of the suns that the pictures were taken under.
pub struct LitWorld {
    sun_deg: Option<[f64; 2]>,
    world: ReferenceWorld,
    /// Worlds with fewer and with more discs.
    areas: Vec<AreaDifference<ReferenceWorld>>,
}

/// The two sides of a difference that is the derivative by an area.
struct AreaDifference<T> {
    /// Index of the unknown.
    unknown: usize,
    /// One over the difference of the areas.
    over: f64,
    /// For each of the two pictures with derivatives a draw of its own, with fewer discs and with more.
    sides: [[T; 2]; 2],
}

/// The scene under one of the suns that its pictures were taken under.
pub struct LitScene<'a> {
    sun_deg: Option<[f64; 2]>,
    tracer: PathTracer<'a>,
    areas: Vec<AreaDifference<PathTracer<'a>>>,
    /// Where rays from above begin at least (mm).
    top: f64,
    /// What everything scatters in each band, where bands are drawn and not three channels.
    surfaces: Option<Vec<SurfaceBands>>,
    /// What it is differentiated by, each with the index of its unknown; the same list under every sun.
    pub slopes: Vec<(usize, RadianceParameter)>,
}

impl LitWorld {
    /// The worlds under every sun of the shots, one for each of these draws of discs; and where derivatives are asked
    /// for, those of their differences, whose discs are by draws of their own.
    ///
    /// # Errors
    /// Those of a physical sky that its model refuses.
    pub fn all(
        numbers: &SceneUnknowns,
        shots: &[ScenePhotograph],
        draws: Range<u64>,
        sloped: bool,
    ) -> Result<Vec<LitWorld>> {
        let mut suns: Vec<Option<[f64; 2]>> = Vec::new();
        for shot in shots {
            if !suns.contains(&shot.sun_deg) {
                suns.push(shot.sun_deg);
            }
        }
        let one = |(sun_deg, draw): (Option<[f64; 2]>, u64)| {
            let stated = numbers.world(sun_deg)?;
            let difference = |unknown| {
                let beside: [f64; 2] = numbers.beside(unknown);
                let side = |half: u64, area| numbers.counted(&stated, SIDES + 2 * draw + half, Some((unknown, area)));
                let sides = [0, 1].map(|half| beside.map(|area| side(half, area)));
                AreaDifference { unknown, over: 1.0 / (beside[1] - beside[0]), sides }
            };
            let areas = numbers.areas().filter(|_| sloped).map(|(unknown, _)| difference(unknown)).collect();
            Ok(LitWorld { sun_deg, world: numbers.counted(&stated, draw, None), areas })
        };
        suns.into_iter().flat_map(|sun| draws.clone().map(move |draw| (sun, draw))).map(one).collect()
    }
}

impl<'a> LitScene<'a> {
    /// The scene under every sun.
    pub fn all(numbers: &SceneUnknowns, worlds: &'a [LitWorld]) -> Result<Vec<LitScene<'a>>> {
        let traced = |world: &'a ReferenceWorld| PathTracer::new(world, PathSettings::default());
        let pair = |[low, high]: &'a [ReferenceWorld; 2]| Ok::<_, crate::Error>([traced(low)?, traced(high)?]);
        let one = |LitWorld { sun_deg, world, areas }: &'a LitWorld| {
            let difference = |of: &'a AreaDifference<ReferenceWorld>| {
                let sides = [pair(&of.sides[0])?, pair(&of.sides[1])?];
                Ok(AreaDifference { unknown: of.unknown, over: of.over, sides })
            };
            Ok(LitScene {
                sun_deg: *sun_deg,
                tracer: traced(world)?,
                areas: areas.iter().map(difference).collect::<Result<_>>()?,
                top: numbers.top(),
                surfaces: numbers.surfaces(),
                slopes: numbers.slopes(*sun_deg)?,
            })
        };
        worlds.iter().map(one).collect()
    }

    /// The unknown of each derivative of a picture.
    pub fn by(&self) -> Vec<usize> {
        let paths = self.slopes.iter().map(|(unknown, _)| *unknown);
        paths.chain(self.areas.iter().map(|difference| difference.unknown)).collect()
    }
}

/// Pictures of the shots that `wanted` chooses, from rounds of `each` paths a pixel (all draws of discs together), with
/// derivatives where they are asked for: as the first or as the second of the two that have them.
pub fn draw(
    lit: &[LitScene],
    shots: &[ScenePhotograph],
    wanted: impl Fn(&ScenePhotograph) -> bool,
    sloped: Option<usize>,
    [rounds, each]: [u32; 2],
    seed: u64,
) -> Result<Vec<DerivativePicture>> {
    let mut out = vec![DerivativePicture::default(); shots.len()];
    for (k, shot) in shots.iter().enumerate().filter(|(_, shot)| wanted(shot)) {
        let scenes: Vec<&LitScene> = lit.iter().filter(|scene| scene.sun_deg == shot.sun_deg).collect();
        let rounds = rounds / scenes.len().max(1) as u32;
        let mut pictures = Vec::with_capacity(scenes.len());
        for (number, scene) in scenes.into_iter().enumerate() {
            let (paths, seed) = ([rounds, each], seed ^ (k as u64) << 40 ^ (number as u64) << 54);
            let of: Vec<RadianceParameter> =
                scene.slopes.iter().filter(|_| sloped.is_some()).map(|(_, of)| of.clone()).collect();
            let mut picture = shot_of(scene, &scene.tracer, &of, shot, paths, seed)?;
            for (difference, half) in scene.areas.iter().zip(sloped.iter().cycle()) {
                let side = |tracer| shot_of(scene, tracer, &[], shot, paths, seed);
                let [low, high] = &difference.sides[*half];
                area::differ(&mut picture, [&side(low)?, &side(high)?], difference.over);
            }
            pictures.push(picture);
        }
        out[k] = area::averaged(pictures);
    }
    Ok(out)
}

/// A picture, or reflectance factors.
fn shot_of(
    scene: &LitScene,
    tracer: &PathTracer,
    of: &[RadianceParameter],
    shot: &ScenePhotograph,
    [rounds, each]: [u32; 2],
    seed: u64,
) -> Result<DerivativePicture> {
    match &shot.by {
        ReadingKind::Camera(camera) => {
            DerivativeTracer::new(tracer, of).picture(camera, shot.size, [rounds, each], seed)
        }
        ReadingKind::Directions(toward) => {
            let canopy = Canopy::new(tracer.world(), seed).map_err(crate::Error::Missed)?.from_above(scene.top);
            let paths = [rounds, each.saturating_mul(A_DIRECTION).min(MOST_PATHS)];
            match &scene.surfaces {
                Some(surfaces) => canopy.factors_of_bands(toward, surfaces, of, paths, seed),
                None => DerivativeTracer::new(canopy.tracer(), of).factors(&canopy, toward, paths, seed),
            }
        }
    }
}

/// How readings of a shot depend on the numbers, by two pictures of their own paths.
pub struct ShotSlopes<'a> {
    /// The numbers.
    pub numbers: &'a SceneUnknowns,
    /// The shot.
    pub shot: &'a ScenePhotograph,
    /// The unknown of each derivative.
    pub of: &'a [usize],
    /// The pictures.
    pub pictures: [&'a DerivativePicture; 2],
}

impl ShotSlopes<'_> {
    /// Puts the derivatives of channel `c` of pixel `k` into `row`: the place of a number, and its derivative by either
    /// picture. `first` has the place of each unknown's first number.
    pub fn row(&self, first: &[usize], k: usize, c: usize, row: &mut Vec<(usize, f64, f64)>) {
        let factor = exposure(self.numbers, self.shot);
        row.clear();
        for (j, q) in self.of.iter().enumerate() {
            let number = first[*q] + if self.numbers.list[*q].at.len() > 1 { c } else { 0 };
            let [p, q] = self.pictures.map(|sheet| factor * sheet.slope(k, j, c));
            if p != 0.0 || q != 0.0 {
                row.push((number, p, q));
            }
        }
        if let Some(q) = exposure_of(self.numbers, self.shot) {
            let [p, u] = self.pictures.map(|sheet| sheet.mean[k * self.shot.channels + c]);
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

/// Rounds and paths a round of half as many paths as these, that so many draws of discs share: each has as many rounds,
/// and two at least, which tell a variance.
pub fn rounds(paths: u32, draws: u64) -> [u32; 2] {
    let half = (paths / 2).max(4);
    let all = half.min(ROUNDS);
    let rounds = if draws > 1 { (all / draws as u32).max(2) * draws as u32 } else { all };
    [rounds, half.div_ceil(rounds)]
}

/// For each reading of a shot its variance, and that of a picture of twice as many rounds as each of two others has, by
/// which both are judged.
pub fn variances(
    shot: &ScenePhotograph,
    [one, two]: [&DerivativePicture; 2],
    rounds: u32,
    factor: f64,
) -> Vec<[f64; 2]> {
    let ([w, h], n, places) = (shot.size, shot.channels, shot.uses.len());
    let both = |i: usize| 0.25 * (one.variance[i] + two.variance[i]);
    // The mean over a place and those beside it.
    let around = |k: usize, c: usize, of: &dyn Fn(usize) -> f64| {
        let (x, y) = (k % w, k / w);
        let (mut sum, mut count) = (0.0, 0.0);
        for j in y.saturating_sub(1)..=(y + 1).min(h - 1) {
            for i in x.saturating_sub(1)..=(x + 1).min(w - 1) {
                sum += of((j * w + i) * n + c);
                count += 1.0;
            }
        }
        sum / count
    };
    // An error that was estimated from a pixel's own scatter is small where the reading happens to be. Neighbours do
    // not know the reading, and have half of the say.
    let pooled = matches!(shot.by, ReadingKind::Camera(_));
    let stated = |k: usize, c: usize| {
        let Some(error) = &shot.error else { return 0.0 };
        let own = error[k * n + c].powi(2);
        if pooled { 0.5 * (own + around(k, c, &|i| error[i].powi(2))) } else { own }
    };
    let mean = |i: usize| 0.5 * (one.mean[i] + two.mean[i]);
    let whole: Vec<f64> =
        (0..n).map(|c| (0..places).map(|k| mean(k * n + c)).sum::<f64>() / places.max(1) as f64).collect();
    // The mean of an inverse estimate is larger than the inverse of its mean.
    let own_rounds = 2.0 * f64::from(rounds - 1);
    let freedom = own_rounds + PRIOR;
    let wider = freedom / (freedom - 2.0) * factor * factor;
    let of = |i: usize| {
        let (k, c) = (i / n, i % n);
        let own = (own_rounds * both(i) + PRIOR * around(k, c, &both)) / freedom * wider;
        // What is dark has at least a hundredth of the noise of the picture's mean.
        let shown = factor * mean(i).max(0.01 * whole[c]);
        let measured = stated(k, c) + (shot.noise * shown).powi(2) + shot.floor.powi(2);
        [measured.max((LEAST * shown).powi(2)), own]
    };
    (0..places * n).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture that residuals are of has twice as many rounds of each draw as those that its noise is found by.
    #[test]
    fn draws_share_the_rounds_evenly() {
        for (paths, draws) in (0..9).flat_map(|k| (2..=8).map(move |draws| (4u32 << k, draws))) {
            let [half, each] = rounds(paths, draws);
            let share = |rounds: u32| rounds / draws as u32;
            assert!(share(half) >= 2 && share(2 * half) == 2 * share(half), "{paths} {draws}: {half}");
            assert!(2 * half * each >= paths, "{paths} {draws}: {half} x {each}");
        }
        assert_eq!(rounds(16, 1), [8, 1]);
    }
}
