//! A ray through the slices, in closed form: where it meets each, closest first (H9 §2.3.1, Eq. 2.1–2.3).
//!
//! Slices stand across x and across y, a step apart, and a level one may lie at half the height. Each shows all blades
//! of its slab. A ray at an angle to both axes crosses slices of both kinds, so that it meets every blade twice: the
//! optical depth of upright blades would be |cos φ| + |sin φ| times what it is. A ray from above meets hardly any slice
//! at all. [`Slices::weights`] says what share of a slice's opacity counts for a ray, so that the optical depth is that
//! of the blades in every direction in which slices can have it.

use crate::blades::{STEPS, shown};
use crate::sheet::{BYTES, CHANNELS, Sheet};
use glam::{DVec2, DVec3};

/// Below this a ray counts as stopped.
const OPAQUE: f64 = 1e-4;

/// A meadow as slices. Lengths are in mm; the rectangle lies around the origin, the ground is z = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Slices {
    /// The rectangle that repeats.
    pub period: [f64; 2],
    /// Of the carrier over the ground.
    pub height: f64,
    /// Slices across x, and as many across y.
    pub count: usize,
    /// What the weights are made from: the blades' ([`crate::blades::Meadow::projection`]), or fitted to them
    /// ([`crate::weights`]).
    pub projection: [f64; STEPS + 1],
    /// The blades' own projection along the ground, and from above: what slices show.
    pub shown: [f64; 2],
    /// Mean opacity of upright slices at a height of k/[`STEPS`] of the carrier's, and of the level one.
    pub cover: ([f64; STEPS + 1], f64),
    /// First those across x, then those across y.
    pub upright: Sheet,
    /// The level slice at half the height, one cell.
    pub level: Option<Sheet>,
    /// Whether opacities are weighted by direction; without, each slice counts in full.
    pub weighted: bool,
}

/// What a slice is across.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Across {
    /// Upright.
    X,
    /// Upright.
    Y,
    /// Level.
    Z,
}

/// Where a ray crosses a slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Distance in lengths of the ray's direction.
    pub t: f64,
    /// Which kind of slice.
    pub across: Across,
    /// Which one, counted without end from the rectangle around the origin.
    pub index: i64,
    /// Where, in the lawn as it stands without wind.
    pub place: DVec3,
    /// How the wind leans the lawn there: the way of a blade's point along x and y over its height.
    pub lean: DVec2,
}

impl Crossing {
    /// A direction as the lawn without wind has it.
    pub fn unleant(&self, d: DVec3) -> DVec3 {
        unleant(d, self.lean)
    }

    /// A normal of the lawn without wind (of any length) as the wind turns it.
    pub fn turned(&self, normal: DVec3) -> DVec3 {
        normal - DVec3::Z * self.lean.dot(normal.truncate())
    }
}

/// A point or a direction of the leaning lawn as the lawn without wind has it.
pub fn unleant(v: DVec3, lean: DVec2) -> DVec3 {
    v - (lean * v.z).extend(0.0)
}

/// What a ray gathered.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gathered {
    /// Share of the light that is stopped.
    pub opacity: f64,
    /// Sum of what was asked for, times the share that was seen.
    pub colour: [f64; 3],
    /// Where the opacity passed one half, if it did (lengths of the direction).
    pub depth: Option<f64>,
    /// How many slices were crossed.
    pub steps: usize,
}

impl Slices {
    /// Shares of the opacity of upright slices, and of the level one, that count for a ray along `d`.
    ///
    /// Blades of the area u a volume, of which a direction sees the share P(|Ω_z|), have the optical depth u P a
    /// length. Upright slices have u P(0) (|Ω_x| + |Ω_y|), the level one u P(1) |Ω_z| in the mean over the height.
    /// Upright slices count in full, or as far as they would have too much; the level one adds what they lack. These
    /// are shares of the optical depth; [`Slices::share`] has those of the opacity.
    pub fn weights(&self, d: DVec3) -> [f64; 2] {
        if !self.weighted {
            return [1.0, 1.0];
        }
        let d = d.normalize_or_zero();
        let wanted = shown(&self.projection, d.z);
        let upright = self.shown[0] * (d.x.abs() + d.y.abs());
        let level = self.shown[1] * d.z.abs();
        // Nothing is wanted of slices that show nothing (0 of 0).
        let share = |of: f64, all: f64| match of {
            of if of <= 0.0 => 0.0,
            of if of < all => of / all,
            _ => 1.0,
        };
        let w = share(wanted, upright);
        [w, share(wanted - w * upright, level)]
    }

    fn cover(&self, across: Across, height: f64) -> f64 {
        if across == Across::Z { self.cover.1 } else { shown(&self.cover.0, height) }
    }

    /// What share of its opacity a slice has where a share `weight` of its optical depth counts. Blades are opaque:
    /// none of their texels can have a share of an optical depth that is infinite. The mean over a row of texels can,
    /// (1 − a)^w = 1 − c a, and c is the share of all of them.
    fn share(&self, across: Across, height: f64, weight: f64) -> f64 {
        let cover = self.cover(across, height);
        if cover > 0.0 { (1.0 - (1.0 - cover).powf(weight)) / cover } else { weight }
    }

    /// The slices that a ray crosses between the ground and the carrier, closest first. It begins after `from`, where
    /// it is on a slice; the origin is within the layer.
    pub fn crossings(&self, origin: DVec3, d: DVec3, from: Option<(Across, i64)>) -> Crossings<'_> {
        let axis = |k: usize, across: Across| {
            let step = self.period[k] / self.count as f64;
            // The plane of number j is at (j + 1/2) steps from the rectangle's edge.
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
        let on_it = matches!(from, Some((Across::Z, _)));
        let level = (self.level.is_some() && half > 0.0 && half.is_finite() && !on_it).then_some(half);
        Crossings { slices: self, origin, d, next: [axis(0, Across::X), axis(1, Across::Y)], level, end }
    }

    /// What a slice says where a ray crosses it, seen along `d`; the first is the opacity as it counts. `level` is that
    /// of the sheets.
    pub fn texel(&self, crossing: &Crossing, weights: [f64; 2], level: f64) -> [f64; CHANNELS] {
        let share = |k: usize| crossing.place[k] / self.period[k] + 0.5;
        let height = crossing.place.z / self.height;
        let cell = crossing.index.rem_euclid(self.count as i64) as usize;
        let (found, weight) = match (crossing.across, &self.level) {
            (Across::X, _) => (self.upright.at(cell, [share(1), height], level), weights[0]),
            (Across::Y, _) => (self.upright.at(self.count + cell, [share(0), height], level), weights[0]),
            (Across::Z, Some(sheet)) => (sheet.at(0, [share(0), share(1).rem_euclid(1.0)], level), weights[1]),
            (Across::Z, None) => ([0.0; CHANNELS], 0.0),
        };
        if weight == 1.0 {
            return found;
        }
        let share = self.share(crossing.across, height, weight);
        found.map(|v| v * share)
    }

    /// Follows a ray from `origin` along the unit vector `d` over at most `steps` slices, front to back. `colour` takes
    /// a crossing and its texel, and gives the colour times the opacity.
    pub fn march(
        &self,
        origin: DVec3,
        d: DVec3,
        steps: usize,
        level: f64,
        colour: impl FnMut(&Crossing, &[f64; CHANNELS]) -> [f64; 3],
    ) -> Gathered {
        self.march_leaning(origin, d, steps, level, |_| DVec2::ZERO, colour)
    }

    /// The same through a lawn that the wind leans: a point at the height z is z times `lean` from where it would be, by
    /// the place (x, y) where it is. The shear of where the ray begins is taken from the ray, for all of the way; what the
    /// shear at a slice differs from it is taken from the look-up, along the slice (H9 §2.3.2). So a wind that is the same
    /// everywhere is exact, and gusts are right as long as they are much wider than the way of a ray in the lawn.
    pub fn march_leaning(
        &self,
        origin: DVec3,
        d: DVec3,
        steps: usize,
        level: f64,
        lean: impl Fn(DVec2) -> DVec2,
        mut colour: impl FnMut(&Crossing, &[f64; CHANNELS]) -> [f64; 3],
    ) -> Gathered {
        let first = lean(origin.truncate());
        let (from, along) = (unleant(origin, first), unleant(d, first));
        let weights = self.weights(along);
        let mut out = Gathered::default();
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

    /// Share of the light from `to` (unit) that arrives at what a ray along `d` sees of a slice: none from the horizon or
    /// from below it, where the ground is in the way.
    ///
    /// The blade is off the slice, somewhere in its slab: a picture shows those that are nearest to the eye. Other
    /// slices are crossed from there. Of an upright slab, blades between it and the side that the ray sees are none;
    /// those behind it are in the way of light from behind, as many as stand in a slab in the mean. The slab of the
    /// level slice is the whole layer: what stands before the blade is none towards the eye only. Towards another
    /// direction it is what stands there in the mean.
    pub fn arriving(&self, crossing: &Crossing, texel: &[f64; CHANNELS], d: DVec3, to: DVec3, level: f64) -> f64 {
        if to.z <= 0.0 {
            return 0.0;
        }
        let weights = self.weights(to);
        let axis = crossing.across as usize;
        let [thick, weight] = match crossing.across {
            Across::Z => [self.height, weights[1]],
            _ => [self.period[axis] / self.count as f64, weights[0]],
        };
        // Distance to the side that is seen, as a share of the slab; pictures are taken from the first side.
        let behind = if texel[0] > 0.0 { 1.0 - texel[13] / texel[0] } else { 0.5 };
        let mut place = crossing.place;
        place[axis] -= d[axis].signum() * (0.5 - behind) * thick;
        let mut left = 1.0;
        let passed = match crossing.across {
            _ if d[axis] * to[axis] > 0.0 => 1.0 - behind,
            Across::Z => behind,
            _ => 0.0,
        };
        if passed > 0.0 {
            let height = place.z / self.height;
            left -= self.cover(crossing.across, height) * self.share(crossing.across, height, weight * passed);
        }
        for other in self.crossings(place, to, Some((crossing.across, crossing.index))) {
            left *= 1.0 - self.texel(&other, weights, level)[0];
            if left < OPAQUE {
                break;
            }
        }
        left
    }

    /// Mean opacities of the sheets, for [`Slices::cover`].
    pub fn covers(upright: &Sheet, level: Option<&Sheet>) -> ([f64; STEPS + 1], f64) {
        let mean = |sheet: &Sheet, v: f64| {
            let w = sheet.cell[0];
            let at = |k: usize| sheet.at(k / w, [((k % w) as f64 + 0.5) / w as f64, v], 0.0)[0];
            (0..w * sheet.cells).map(at).sum::<f64>() / (w * sheet.cells) as f64
        };
        let height = |k: usize| k as f64 / STEPS as f64;
        let rows = level.map_or(1, |sheet| sheet.cell[1]);
        let all = |sheet: &Sheet| (0..rows).map(|r| mean(sheet, (r as f64 + 0.5) / rows as f64)).sum::<f64>();
        (std::array::from_fn(|k| mean(upright, height(k))), level.map_or(0.0, all) / rows as f64)
    }

    /// Bytes of all sheets on a graphics adapter: four layers of four half floats.
    pub fn bytes(&self) -> usize {
        BYTES * (self.upright.texels() + self.level.as_ref().map_or(0, Sheet::texels))
    }
}

/// See [`Slices::crossings`].
#[derive(Debug, Clone)]
pub struct Crossings<'a> {
    slices: &'a Slices,
    origin: DVec3,
    d: DVec3,
    next: [i64; 2],
    level: Option<f64>,
    end: f64,
}

impl Iterator for Crossings<'_> {
    type Item = Crossing;

    fn next(&mut self) -> Option<Crossing> {
        let s = self.slices;
        let along = |k: usize| {
            let step = s.period[k] / s.count as f64;
            let plane = (self.next[k] as f64 + 0.5) * step - 0.5 * s.period[k];
            if self.d[k] == 0.0 { f64::INFINITY } else { ((plane - self.origin[k]) / self.d[k]).max(0.0) }
        };
        let [x, y] = [along(0), along(1)];
        let z = self.level.unwrap_or(f64::INFINITY);
        let (t, across) = if z < x.min(y) {
            (z, Across::Z)
        } else if x <= y {
            (x, Across::X)
        } else {
            (y, Across::Y)
        };
        if !(t < self.end && t.is_finite()) {
            return None;
        }
        let index = match across {
            Across::Z => {
                self.level = None;
                0
            }
            _ => {
                let k = usize::from(across == Across::Y);
                let now = self.next[k];
                self.next[k] += self.d[k].signum() as i64;
                now
            }
        };
        Some(Crossing { t, across, index, place: self.origin + self.d * t, lean: DVec2::ZERO })
    }
}
