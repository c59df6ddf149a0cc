//! Measures the error of slices: the same rays go through the slices and through the blades, and the results are
//! compared.

use crate::grass::blades::LawnMeadow;
use crate::grass::march::{LawnSlices, SliceCrossing};
use crate::grass::sheet::CHANNELS;
use glam::DVec3;
use mesophyll_transport::rays::Ray;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Elevations of the view over the ground, in degrees, from grazing to straight down.
pub const ELEVATIONS: [f64; 8] = [5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0];
/// Azimuths of the rays, in degrees: along the slices, across them, and between.
pub const AZIMUTHS: [f64; 8] = [0.0, 20.0, 45.0, 110.0, 155.0, 180.0, 225.0, 290.0];
/// The sun of the sunlit colours: zenith angle and azimuth (degrees).
pub const SUN: [f64; 2] = [45.0, 65.0];

/// Means over the rays of one direction.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LawnAppearance {
    /// Share of the rays that blades stop.
    pub coverage: f64,
    /// Mean of ρd over the rays, for the sides that are seen; it is 0 where nothing is seen. This is the colour under
    /// an even light, without shadows.
    pub colour: [f64; 3],
    /// π times the mean radiance by light straight from the sun, for an irradiance of 1 on a surface that faces the
    /// sun. Shadows are included, and the ground is black.
    pub sunlit: [f64; 3],
}

/// The comparison for one direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LawnComparison {
    /// Index in [`ELEVATIONS`].
    pub elevation: usize,
    /// Index in [`AZIMUTHS`].
    pub azimuth: usize,
    /// What the blades show.
    pub blades: LawnAppearance,
    /// What the slices show.
    pub slices: LawnAppearance,
    /// Opacity after the first 4 and after the first 16 slices of a ray, as shares of the opacity after all slices.
    pub first: [f64; 2],
}

/// The rays that the comparison uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawnRays {
    /// Number of points of entry along each side of the rectangle.
    pub side: usize,
    /// Level of detail of the sheets.
    pub level: f64,
    /// Whether the colours under the sun are computed too, which takes several times as long.
    pub sunlit: bool,
}

/// The unit vector towards a direction with this elevation over the ground and this azimuth (degrees).
pub fn towards(elevation_deg: f64, azimuth_deg: f64) -> DVec3 {
    let ((se, ce), (sa, ca)) = (elevation_deg.to_radians().sin_cos(), azimuth_deg.to_radians().sin_cos());
    DVec3::new(ce * ca, ce * sa, se)
}

/// What the blades show in every direction of [`ELEVATIONS`] and [`AZIMUTHS`]. All azimuths of an elevation follow each
/// other.
pub fn blades(meadow: &LawnMeadow, rays: LawnRays) -> Vec<LawnAppearance> {
    directions()
        .map(|(e, a)| look(meadow.period, meadow.height, rays, towards(e, a), |o, d| of_blades(meadow, rays, o, d)))
        .collect()
}

/// Compares the slices with the result of [`blades`].
pub fn judged(slices: &LawnSlices, truth: &[LawnAppearance], rays: LawnRays) -> Vec<LawnComparison> {
    directions()
        .zip(truth)
        .enumerate()
        .map(|(k, ((e, a), truth))| {
            let gathered = |steps: usize, sunlit: bool| {
                let rays = LawnRays { sunlit, ..rays };
                look(slices.period, slices.height, rays, towards(e, a), |o, d| of_slices(slices, rays, steps, o, d))
            };
            let all = gathered(usize::MAX, rays.sunlit);
            let first = [4, 16].map(|steps| gathered(steps, false).coverage / all.coverage.max(f64::MIN_POSITIVE));
            let (elevation, azimuth) = (k / AZIMUTHS.len(), k % AZIMUTHS.len());
            LawnComparison { elevation, azimuth, blades: *truth, slices: all, first }
        })
        .collect()
}

/// Share of the rays from one direction that blades stop. `to` points to the eye.
pub fn coverage_of_blades(meadow: &LawnMeadow, rays: LawnRays, to: DVec3) -> f64 {
    let ground = meadow.height / to.z;
    let one = |o: DVec3, d: DVec3| f64::from(u8::from(meadow.blocked(&Ray::new(o, d), ground)));
    look(meadow.period, meadow.height, rays, to, |o, d| LawnAppearance {
        coverage: one(o, d),
        ..LawnAppearance::default()
    })
    .coverage
}

/// Share of the light from one direction that slices stop.
pub fn coverage_of_slices(slices: &LawnSlices, rays: LawnRays, to: DVec3) -> f64 {
    let one = |o: DVec3, d: DVec3| slices.march(o, d, usize::MAX, rays.level, |_, _| [0.0; 3]).opacity;
    look(slices.period, slices.height, rays, to, |o, d| LawnAppearance {
        coverage: one(o, d),
        ..LawnAppearance::default()
    })
    .coverage
}

fn directions() -> impl Iterator<Item = (f64, f64)> {
    ELEVATIONS.into_iter().flat_map(|e| AZIMUTHS.into_iter().map(move |a| (e, a)))
}

/// The mean over points of entry on the carrier's surface. `to` points to the eye.
fn look(
    period: [f64; 2],
    height: f64,
    rays: LawnRays,
    to: DVec3,
    one: impl Fn(DVec3, DVec3) -> LawnAppearance + Sync,
) -> LawnAppearance {
    let n = rays.side;
    let row = |j: usize| {
        let mut sum = LawnAppearance::default();
        for i in 0..n {
            // Each square of a grid has a point at a place of its own (Weyl's sequences), so that the points cannot
            // form a pattern together with the slices.
            let stray = |k: f64| ((j * n + i) as f64 * k).fract();
            let share = |k: usize, stray: f64| (k as f64 + stray) / n as f64 - 0.5;
            let [x, y] = [share(i, stray(0.754_877_666_246_693)), share(j, stray(0.569_840_290_998_053))];
            let seen = one(DVec3::new(x * period[0], y * period[1], height), -to);
            sum.coverage += seen.coverage;
            (0..3).for_each(|c| {
                sum.colour[c] += seen.colour[c];
                sum.sunlit[c] += seen.sunlit[c];
            });
        }
        sum
    };
    let rows: Vec<LawnAppearance> = (0..n).into_par_iter().map(row).collect();
    let mean = |of: &dyn Fn(&LawnAppearance) -> f64| rows.iter().map(of).sum::<f64>() / (n * n) as f64;
    LawnAppearance {
        coverage: mean(&|r| r.coverage),
        colour: [0, 1, 2].map(|c: usize| mean(&|r| r.colour[c])),
        sunlit: [0, 1, 2].map(|c: usize| mean(&|r| r.sunlit[c])),
    }
}

pub(crate) fn of_blades(meadow: &LawnMeadow, rays: LawnRays, origin: DVec3, d: DVec3) -> LawnAppearance {
    let ground = -origin.z / d.z;
    let Some(met) = meadow.nearest(&Ray::new(origin, d), ground) else { return LawnAppearance::default() };
    let [seen, _] = met.rho_d;
    let mut out = LawnAppearance { coverage: 1.0, colour: seen, sunlit: [0.0; 3] };
    if rays.sunlit {
        let sun = towards(90.0 - SUN[0], SUN[1]);
        let cos = met.normal.dot(sun);
        // The ray begins slightly off the blade, so that it does not hit this blade again.
        let place = origin + d * met.t + sun * 1e-6 * meadow.height;
        let shadow = meadow.blocked(&Ray::new(place, sun), ((meadow.height - place.z) / sun.z).max(0.0));
        let rho = if cos > 0.0 { seen } else { met.rho_t };
        out.sunlit = rho.map(|r| if shadow { 0.0 } else { r * cos.abs() });
    }
    out
}

pub(crate) fn of_slices(slices: &LawnSlices, rays: LawnRays, steps: usize, origin: DVec3, d: DVec3) -> LawnAppearance {
    let sun = towards(90.0 - SUN[0], SUN[1]);
    let mut sunlit = [0.0; 3];
    let mut left = 1.0;
    let gathered = slices.march(origin, d, steps, rays.level, |crossing, texel| {
        if rays.sunlit {
            let lit = lit(slices, crossing, texel, d, sun, rays.level);
            (0..3).for_each(|c| sunlit[c] += left * lit[c]);
            left *= 1.0 - texel[0];
        }
        seen(texel, d)
    });
    LawnAppearance { coverage: gathered.opacity, colour: gathered.colour, sunlit }
}

/// Whether a ray along `d` sees the side of the blades that the picture shows. The blades' normals decide, not the
/// slice's normal.
fn first(texel: &[f64; CHANNELS], d: DVec3) -> bool {
    DVec3::new(texel[10], texel[11], texel[12]).dot(d) < 0.0
}

/// ρd of the side of a slice that a ray sees, times the opacity.
pub fn seen(texel: &[f64; CHANNELS], d: DVec3) -> [f64; 3] {
    let at = if first(texel, d) { 1 } else { 4 };
    [texel[at], texel[at + 1], texel[at + 2]]
}

/// Radiance along −`d` that a slice adds under a sun with an irradiance of π on a surface that faces it. The slice
/// reflects where the side that is seen faces the sun, and transmits elsewhere. Other slices dim the sunlight on its
/// way. `d` and `sun` are directions in the lawn as the wind leans it.
pub fn lit(
    slices: &LawnSlices,
    crossing: &SliceCrossing,
    texel: &[f64; CHANNELS],
    d: DVec3,
    sun: DVec3,
    level: f64,
) -> [f64; 3] {
    let own = crossing.unleant(d);
    let side = if first(texel, own) { 1.0 } else { -1.0 };
    let normal = crossing.turned(DVec3::new(texel[10], texel[11], texel[12]) * side).normalize_or_zero();
    let cos = normal.dot(sun);
    let rho = if cos > 0.0 { seen(texel, own) } else { [texel[7], texel[8], texel[9]] };
    let arrives = slices.arriving(crossing, texel, own, crossing.unleant(sun), level);
    rho.map(|r| r * cos.abs() * arrives)
}
