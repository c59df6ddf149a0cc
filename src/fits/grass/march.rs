//! Follows a ray through the slices. A closed form gives where it crosses each of them, closest first (H9 §2.3.1, Eq.
//! 2.1–2.3).
//!
//! Slices stand across x and across y at even steps, and a level slice may lie at half the height. Each slice shows all
//! blades of its slab. A ray at an angle to both axes crosses slices of both kinds, so it meets every blade twice: the
//! optical depth of upright blades would be |cos φ| + |sin φ| times the true one. A ray from above crosses hardly any
//! slice. So [`LawnSlices::weights`] says which share of a slice's opacity counts for a ray. With it the optical depth
//! is that of the blades in every direction in which slices can reach it.

use crate::grass::blades::{STEPS, shown};
use crate::grass::irregularity::{SHIFTS, shifted};
use crate::grass::sheet::{BYTES, CHANNELS, SliceAtlas};
use glam::{DVec2, DVec3};

/// Below this share of light that is left, a ray counts as stopped.
const OPAQUE: f64 = 1e-4;

/// A meadow as slices. Lengths are in mm. The rectangle lies around the origin, and the ground is at z = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct LawnSlices {
    /// The rectangle that repeats.
    pub period: [f64; 2],
    /// Height of the carrier over the ground.
    pub height: f64,
    /// Number of slices across x, and the same number across y.
    pub count: usize,
    /// The projection that the weights are computed from: the blades' own
    /// ([`crate::grass::blades::LawnMeadow::projection`]), or one that was fitted to the blades
    /// ([`crate::grass::weights`]).
    pub projection: [f64; STEPS + 1],
    /// The blades' own projection along the ground and from above, which is what slices show.
    pub shown: [f64; 2],
    /// Mean opacity of upright slices at a height of k/[`STEPS`] of the carrier's height, and the mean opacity of the
    /// level slice.
    pub cover: ([f64; STEPS + 1], f64),
    /// The upright slices: first those across x, then those across y.
    pub upright: SliceAtlas,
    /// The level slice at half the height, which is one cell.
    pub level: Option<SliceAtlas>,
    /// Whether opacities are weighted by direction. If not, each slice counts in full.
    pub weighted: bool,
    /// The seed of an irregular lawn, whose rectangles are moved as [`shifted`] says. With `None`, all are alike.
    pub irregular: Option<u32>,
}

/// The axis that a slice stands across.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SliceAxis {
    /// An upright slice across x.
    X,
    /// An upright slice across y.
    Y,
    /// A level slice.
    Z,
}

/// Where a ray crosses a slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SliceCrossing {
    /// Distance in lengths of the ray's direction.
    pub t: f64,
    /// The kind of slice.
    pub across: SliceAxis,
    /// Number of the slice. The rectangle around the origin begins at 0, and the count goes on without end in both
    /// directions.
    pub index: i64,
    /// Place of the crossing in the lawn as it stands without wind.
    pub place: DVec3,
    /// How the wind leans the lawn there: the displacement of a blade's point along x and y, divided by its height.
    pub lean: DVec2,
}

impl SliceCrossing {
    /// The same direction in the lawn without wind.
    pub fn unleant(&self, d: DVec3) -> DVec3 {
        unleant(d, self.lean)
    }

    /// A normal of the lawn without wind (of any length), as the wind turns it.
    pub fn turned(&self, normal: DVec3) -> DVec3 {
        normal - DVec3::Z * self.lean.dot(normal.truncate())
    }
}

/// A point or a direction of the leaning lawn, transformed to the lawn without wind.
pub fn unleant(v: DVec3, lean: DVec2) -> DVec3 {
    v - (lean * v.z).extend(0.0)
}

/// What a ray gathered on its way.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LawnRadiance {
    /// Share of the light that is stopped.
    pub opacity: f64,
    /// Sum of the requested colour, each weighted by the share of light that still arrives from there.
    pub colour: [f64; 3],
    /// Distance where the opacity passed one half, in lengths of the direction; `None` where it never did.
    pub depth: Option<f64>,
    /// How many slices were crossed.
    pub steps: usize,
}

impl LawnSlices {
    /// The shares of opacity that count for a ray along `d`: for upright slices, and for the level one.
    ///
    /// Let u be the area of blades in a unit of volume, and P(|Ω_z|) the share of it that a direction Ω sees. Then
    /// blades have the optical depth u P for each unit of length. Upright slices have u P(0) (|Ω_x| + |Ω_y|), and the
    /// level one u P(1) |Ω_z| in the mean over the height. Upright slices count in full, or by a smaller share where
    /// they would give too much. The level slice adds what they lack. These are shares of the optical depth;
    /// [`LawnSlices::share`] converts them to shares of the opacity.
    pub fn weights(&self, d: DVec3) -> [f64; 2] {
        if !self.weighted {
            return [1.0, 1.0];
        }
        let d = d.normalize_or_zero();
        self.shares(d, d.z)
    }

    /// The same for a unit vector `d` over ground that is not level. `falls` is how fast the ray's height over the
    /// ground changes. The level slice lies as the ground does and is crossed so much more or less often.
    pub fn shares(&self, d: DVec3, falls: f64) -> [f64; 2] {
        if !self.weighted {
            return [1.0, 1.0];
        }
        let wanted = shown(&self.projection, d.z);
        let upright = self.shown[0] * (d.x.abs() + d.y.abs());
        let level = self.shown[1] * falls.abs();
        // Slices that show nothing get the share 0. It would be 0/0 otherwise.
        let share = |of: f64, all: f64| match of {
            of if of <= 0.0 => 0.0,
            of if of < all => of / all,
            _ => 1.0,
        };
        let w = share(wanted, upright);
        [w, share(wanted - w * upright, level)]
    }

    fn cover(&self, across: SliceAxis, height: f64) -> f64 {
        if across == SliceAxis::Z { self.cover.1 } else { shown(&self.cover.0, height) }
    }

    /// The share of its opacity that a slice has where the share `weight` of its optical depth counts. Blades are
    /// opaque, so a single texel has an infinite optical depth, of which no share can be taken. The mean opacity a of a
    /// row of texels gives a finite one: (1 − a)^w = 1 − c a, and all texels of the row get the share c.
    fn share(&self, across: SliceAxis, height: f64, weight: f64) -> f64 {
        let cover = self.cover(across, height);
        if cover > 0.0 { (1.0 - (1.0 - cover).powf(weight)) / cover } else { weight }
    }

    /// The slices that a ray crosses between the ground and the carrier, closest first. The origin lies within the
    /// layer. Where it lies on a slice, `from` names this slice, and the crossings begin after it.
    pub fn crossings(&self, origin: DVec3, d: DVec3, from: Option<(SliceAxis, i64)>) -> SliceCrossings<'_> {
        let axis = |k: usize, across: SliceAxis| {
            let step = self.period[k] / self.count as f64;
            // The plane with the number j lies (j + 1/2) steps from the rectangle's edge.
            let x = (origin[k] + 0.5 * self.period[k]) / step - 0.5;
            let next = if d[k] > 0.0 { x.floor() + 1.0 } else { x.ceil() - 1.0 };
            match from {
                Some((on, index)) if on == across => index + d[k].signum() as i64,
                _ => next as i64,
            }
        };
        let end = match d.z {
            z if z < 0.0 => -origin.z / z,
            z if z > 0.0 => (self.height - origin.z) / z,
            _ => f64::INFINITY,
        };
        let half = (0.5 * self.height - origin.z) / d.z;
        let on_it = matches!(from, Some((SliceAxis::Z, _)));
        let level = (self.level.is_some() && half > 0.0 && half.is_finite() && !on_it).then_some(half);
        SliceCrossings { slices: self, origin, d, next: [axis(0, SliceAxis::X), axis(1, SliceAxis::Y)], level, end }
    }

    /// The texel of a slice where a ray crosses it. Its opacity, the first number, is weighted as `weights` says, and
    /// the other numbers with it. `level` is the sheets' level of detail.
    pub fn texel(&self, crossing: &SliceCrossing, weights: [f64; 2], level: f64) -> [f64; CHANNELS] {
        let mut share = [0, 1].map(|k| crossing.place[k] / self.period[k] + 0.5);
        let height = crossing.place.z / self.height;
        let mut index = crossing.index;
        if let Some(seed) = self.irregular {
            // A slice is in the rectangle that its number says, and in the one where it is crossed along its length.
            let mut rectangle = share.map(|s| s.floor() as i64);
            if crossing.across != SliceAxis::Z {
                rectangle[crossing.across as usize] = index.div_euclid(self.count as i64);
            }
            let moved = shifted(seed, rectangle);
            (0..2).for_each(|k| share[k] += moved[k] as f64 / SHIFTS as f64);
            let across = moved.get(crossing.across as usize).copied().unwrap_or_default();
            index += (across * self.count / SHIFTS) as i64;
        }
        let cell = index.rem_euclid(self.count as i64) as usize;
        let (found, weight) = match (crossing.across, &self.level) {
            (SliceAxis::X, _) => (self.upright.at(cell, [share[1], height], level), weights[0]),
            (SliceAxis::Y, _) => (self.upright.at(self.count + cell, [share[0], height], level), weights[0]),
            (SliceAxis::Z, Some(sheet)) => (sheet.at(0, [share[0], share[1].rem_euclid(1.0)], level), weights[1]),
            (SliceAxis::Z, None) => ([0.0; CHANNELS], 0.0),
        };
        if weight == 1.0 {
            return found;
        }
        let share = self.share(crossing.across, height, weight);
        found.map(|v| v * share)
    }

    /// Follows a ray from `origin` along the unit vector `d` over at most `steps` slices, front to back. `colour` gets
    /// a crossing and its texel, and returns the colour times the opacity.
    pub fn march(
        &self,
        origin: DVec3,
        d: DVec3,
        steps: usize,
        level: f64,
        colour: impl FnMut(&SliceCrossing, &[f64; CHANNELS]) -> [f64; 3],
    ) -> LawnRadiance {
        self.march_leaning(origin, d, steps, level, |_| DVec2::ZERO, colour)
    }

    /// Does the same in a lawn that the wind leans. A point at the height z is moved by z times `lean`, where `lean` is
    /// evaluated at the point's moved place (x, y). The whole ray is sheared by the lean at its origin. At each slice,
    /// the difference between the lean there and this one shifts the look-up along the slice (H9 §2.3.2). So a wind
    /// that is the same everywhere is exact, and gusts are right as long as they are much wider than the ray's way
    /// through the lawn.
    pub fn march_leaning(
        &self,
        origin: DVec3,
        d: DVec3,
        steps: usize,
        level: f64,
        lean: impl Fn(DVec2) -> DVec2,
        mut colour: impl FnMut(&SliceCrossing, &[f64; CHANNELS]) -> [f64; 3],
    ) -> LawnRadiance {
        let first = lean(origin.truncate());
        let (from, along) = (unleant(origin, first), unleant(d, first));
        let weights = self.weights(along);
        let mut out = LawnRadiance::default();
        for mut crossing in self.crossings(from, along, None).take(steps) {
            crossing.lean = lean((origin + d * crossing.t).truncate());
            let shift = (crossing.lean - first) * crossing.place.z;
            (0..2).filter(|k| *k != crossing.across as usize).for_each(|k| crossing.place[k] -= shift[k]);
            let texel = self.texel(&crossing, weights, level);
            out.steps += 1;
            if texel[0] > 0.0 {
                let left = 1.0 - out.opacity;
                let added = colour(&crossing, &texel);
                (0..3).for_each(|c| out.colour[c] += left * added[c]);
                out.opacity += left * texel[0];
                if out.opacity >= 0.5 {
                    out.depth.get_or_insert(crossing.t);
                }
                if out.opacity > 1.0 - OPAQUE {
                    break;
                }
            }
        }
        out
    }

    /// Share of the light from `to` (unit vector) that arrives at the part of a slice that a ray along `d` sees. It is
    /// 0 for light from the horizon or from below, because the ground is in the way.
    ///
    /// The blade is not on the slice, but somewhere in its slab: a picture shows the blades that are nearest to the
    /// eye. The other slices are crossed from the blade's place. In an upright slab, no blades stand between this blade
    /// and the side that the ray sees. Behind it, blades are in the way of light from behind, and their number is the
    /// mean of the slab. The slab of the level slice is the whole layer. There the space before the blade is known to
    /// be empty towards the eye only. Towards another direction it holds the mean number of blades.
    pub fn arriving(&self, crossing: &SliceCrossing, texel: &[f64; CHANNELS], d: DVec3, to: DVec3, level: f64) -> f64 {
        self.arriving_past(crossing, texel, [d, to], self.weights(to), level)
    }

    /// The same for directions of any length (along the ray, and to the light) relative to the lawn's ground. `weights`
    /// are the shares of the slices that count on the way to the light.
    pub(crate) fn arriving_past(
        &self,
        crossing: &SliceCrossing,
        texel: &[f64; CHANNELS],
        [d, to]: [DVec3; 2],
        weights: [f64; 2],
        level: f64,
    ) -> f64 {
        if to.z <= 0.0 {
            return 0.0;
        }
        let axis = crossing.across as usize;
        let [thick, weight] = match crossing.across {
            SliceAxis::Z => [self.height, weights[1]],
            _ => [self.period[axis] / self.count as f64, weights[0]],
        };
        // Distance to the side that is seen, as a share of the slab. Pictures are taken from the first side.
        let behind = if texel[0] > 0.0 { 1.0 - texel[13] / texel[0] } else { 0.5 };
        let mut place = crossing.place;
        place[axis] -= d[axis].signum() * (0.5 - behind) * thick;
        let mut left = 1.0;
        let passed = match crossing.across {
            _ if d[axis] * to[axis] > 0.0 => 1.0 - behind,
            SliceAxis::Z => behind,
            _ => 0.0,
        };
        if passed > 0.0 {
            let height = place.z / self.height;
            left -= self.cover(crossing.across, height) * self.share(crossing.across, height, weight * passed);
        }
        left * self.passing(place, to, Some((crossing.across, crossing.index)), weights, level)
    }

    /// Share of the light from `to` that passes the slices between a place and the upper side of the lawn.
    pub(crate) fn passing(
        &self,
        place: DVec3,
        to: DVec3,
        from: Option<(SliceAxis, i64)>,
        weights: [f64; 2],
        level: f64,
    ) -> f64 {
        let mut left = 1.0;
        for other in self.crossings(place, to, from) {
            left *= 1.0 - self.texel(&other, weights, level)[0];
            if left < OPAQUE {
                break;
            }
        }
        left
    }

    /// The mean opacities of the sheets, as [`LawnSlices::cover`] holds them.
    pub fn covers(upright: &SliceAtlas, level: Option<&SliceAtlas>) -> ([f64; STEPS + 1], f64) {
        let mean = |sheet: &SliceAtlas, v: f64| {
            let w = sheet.cell[0];
            let at = |k: usize| sheet.at(k / w, [((k % w) as f64 + 0.5) / w as f64, v], 0.0)[0];
            (0..w * sheet.cells).map(at).sum::<f64>() / (w * sheet.cells) as f64
        };
        let height = |k: usize| k as f64 / STEPS as f64;
        let rows = level.map_or(1, |sheet| sheet.cell[1]);
        let all = |sheet: &SliceAtlas| (0..rows).map(|r| mean(sheet, (r as f64 + 0.5) / rows as f64)).sum::<f64>();
        (std::array::from_fn(|k| mean(upright, height(k))), level.map_or(0.0, all) / rows as f64)
    }

    /// Bytes of all sheets on a graphics adapter, with four layers of four half floats each.
    pub fn bytes(&self) -> usize {
        BYTES * (self.upright.texels() + self.level.as_ref().map_or(0, SliceAtlas::texels))
    }
}

/// See [`LawnSlices::crossings`].
#[derive(Debug, Clone)]
pub struct SliceCrossings<'a> {
    slices: &'a LawnSlices,
    origin: DVec3,
    d: DVec3,
    next: [i64; 2],
    level: Option<f64>,
    end: f64,
}

impl Iterator for SliceCrossings<'_> {
    type Item = SliceCrossing;

    fn next(&mut self) -> Option<SliceCrossing> {
        let s = self.slices;
        let along = |k: usize| {
            let step = s.period[k] / s.count as f64;
            let plane = (self.next[k] as f64 + 0.5) * step - 0.5 * s.period[k];
            if self.d[k] == 0.0 { f64::INFINITY } else { ((plane - self.origin[k]) / self.d[k]).max(0.0) }
        };
        let [x, y] = [along(0), along(1)];
        let z = self.level.unwrap_or(f64::INFINITY);
        let (t, across) = if z < x.min(y) {
            (z, SliceAxis::Z)
        } else if x <= y {
            (x, SliceAxis::X)
        } else {
            (y, SliceAxis::Y)
        };
        if !(t < self.end && t.is_finite()) {
            return None;
        }
        let index = match across {
            SliceAxis::Z => {
                self.level = None;
                0
            }
            _ => {
                let k = usize::from(across == SliceAxis::Y);
                let now = self.next[k];
                self.next[k] += self.d[k].signum() as i64;
                now
            }
        };
        Some(SliceCrossing { t, across, index, place: self.origin + self.d * t, lean: DVec2::ZERO })
    }
}
