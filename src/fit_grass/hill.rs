//! A lawn on a hill. Blades stand upright on it, so that a hill is a shear: every point of the lawn is as far over its
//! level ground as over the hill. Upright slices are crossed where they are crossed over level ground, at another
//! height. So their crossings stay closed forms, on any height field; only the ground and the level slice are searched
//! for.
//!
//! Limits: a slice is sheared along its length as the hill rises, and blades are not. The slices' light is that of a
//! level lawn, and the sun's rays through the lawn are sheared by the slope of the place that they come from.

use crate::march::{Across, Crossing, Gathered, Slices};
use crate::sheet::CHANNELS;
use glam::{DVec2, DVec3};

/// A hill over level ground, or a hollow, in the shape of a Gaussian. Lengths are in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hill {
    /// Place of its top (x, y).
    pub middle: DVec2,
    /// Height of its top over the level ground; less than 0 in a hollow.
    pub height: f64,
    /// Distance from the middle at which it is steepest, the standard deviation of the Gaussian.
    pub radius: f64,
}

/// The longest piece of a ray (mm) in which a root is looked for.
const PIECE: f64 = 2.0;

impl Hill {
    /// Height of the hill over the level ground at a place.
    pub fn rise(&self, at: DVec2) -> f64 {
        self.height * (-0.5 * (at - self.middle).length_squared() / self.radius.powi(2)).exp()
    }

    /// Slope of the hill at a place, along x and y.
    pub fn slope(&self, at: DVec2) -> DVec2 {
        (self.middle - at) * (self.rise(at) / self.radius.powi(2))
    }

    /// The largest slope anywhere.
    pub fn steepest(&self) -> f64 {
        self.height.abs() / self.radius * (-0.5f64).exp()
    }

    /// A direction at a place, relative to the ground there.
    pub fn sheared(&self, d: DVec3, at: DVec2) -> DVec3 {
        d - DVec3::Z * self.slope(at).dot(d.truncate())
    }
}

impl Slices {
    /// Follows a ray through a lawn on a hill, as [`Slices::march`] does over level ground, up to the distance `reach`.
    /// The origin may lie over the lawn. Also returns where the ray reaches the ground. A crossing's place is at its
    /// height over the ground.
    pub fn march_on(
        &self,
        hill: &Hill,
        origin: DVec3,
        d: DVec3,
        reach: f64,
        mut colour: impl FnMut(&Crossing, &[f64; CHANNELS]) -> [f64; 3],
    ) -> (Gathered, Option<f64>) {
        let mut out = Gathered::default();
        let at = |t: f64| {
            let p = origin + d * t;
            p.with_z(p.z - hill.rise(p.truncate()))
        };
        let high = |t: f64| at(t).z;
        let root = |mut a: f64, mut b: f64, over: f64| {
            for _ in 0..50 {
                let half = 0.5 * (a + b);
                *(if (high(half) > over) == (high(a) > over) { &mut a } else { &mut b }) = half;
            }
            0.5 * (a + b)
        };
        let mut gather = |t: f64, across: Across, index: i64, out: &mut Gathered| {
            let crossing = Crossing { t, across, index, place: at(t), lean: DVec2::ZERO };
            let falls = hill.sheared(d, crossing.place.truncate()).z;
            let texel = self.texel(&crossing, self.shares(d, falls), 0.0);
            let left = 1.0 - out.opacity;
            let added = colour(&crossing, &texel);
            (0..3).for_each(|c| out.colour[c] += left * added[c]);
            out.opacity += left * texel[0];
            out.steps += 1;
            if out.opacity >= 0.5 {
                out.depth.get_or_insert(t);
            }
        };
        // Over level ground, a level ray crosses the upright slices at the same distances.
        let mut upright = self.crossings(origin.with_z(0.5 * self.height), d.with_z(0.0), None);
        let mut last = 0.0;
        while last < reach && out.opacity < 1.0 - 1e-4 {
            let next = upright.next();
            let to = next.map_or(reach, |c| c.t.min(reach));
            let pieces = ((to - last) / PIECE).ceil().max(1.0);
            for k in 0..pieces as usize {
                let [a, b] = [k, k + 1].map(|k| last + (to - last) * k as f64 / pieces);
                let half = 0.5 * self.height;
                if self.level.is_some() && (high(a) > half) != (high(b) > half) {
                    gather(root(a, b, half), Across::Z, 0, &mut out);
                }
                if high(b) < 0.0 {
                    return (out, Some(root(a, b, 0.0)));
                }
            }
            if let Some(c) = next.filter(|c| c.t < reach && high(c.t) <= self.height) {
                gather(c.t, c.across, c.index, &mut out);
            }
            last = to;
        }
        (out, None)
    }
}
