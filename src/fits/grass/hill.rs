//! A lawn on a hill. Blades stand upright on it, so that a hill is a shear: every point of the lawn is as far over its
//! level ground as over the hill. Upright slices are crossed where they are crossed over level ground, at another
//! height. So their crossings stay closed forms, on any height field; only the ground and the level slice are searched
//! for.
//!
//! Limits: a slice is sheared along its length as the hill rises, and blades are not. The slices' light is that of a
//! level lawn, and the sun's rays through the lawn are sheared by the slope of the place that they come from.

use crate::grass::march::{LawnRadiance, LawnSlices, SliceAxis, SliceCrossing};
use crate::grass::sheet::CHANNELS;
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

impl LawnSlices {
    /// Follows a ray through a lawn on a hill, as [`LawnSlices::march`] does over level ground, up to the distance
    /// `reach`. The origin may lie over the lawn. Also returns where the ray reaches the ground. A crossing's place is
    /// at its height over the ground.
    pub fn march_on(
        &self,
        hill: &Hill,
        origin: DVec3,
        d: DVec3,
        reach: f64,
        mut colour: impl FnMut(&SliceCrossing, &[f64; CHANNELS]) -> [f64; 3],
    ) -> (LawnRadiance, Option<f64>) {
        let mut out = LawnRadiance::default();
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
        let mut gather = |t: f64, across: SliceAxis, index: i64, out: &mut LawnRadiance| {
            let crossing = SliceCrossing { t, across, index, place: at(t), lean: DVec2::ZERO };
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
                    gather(root(a, b, half), SliceAxis::Z, 0, &mut out);
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

    /// Share of the light from `to` that arrives at the part of a slice that a ray along `d` sees, on a hill. Both are
    /// unit vectors. As [`LawnSlices::arriving`], which is for level ground; the slope hides a light behind it.
    ///
    /// A hill lifts every blade and turns none, so that a unit of the ray's length has the optical depth of the ray's
    /// own direction. The ray leaves the lawn earlier or later, as it rises over the ground.
    pub fn arriving_on(
        &self,
        hill: &Hill,
        crossing: &SliceCrossing,
        texel: &[f64; CHANNELS],
        d: DVec3,
        to: DVec3,
    ) -> f64 {
        let own = [d, to].map(|v| hill.sheared(v, crossing.place.truncate()));
        self.arriving_past(crossing, texel, own, self.shares(to, own[1].z), 0.0)
    }

    /// Share of the light from `to` (unit vector) that arrives on a hill's ground at a place.
    pub fn on_ground(&self, hill: &Hill, at: DVec2, to: DVec3) -> f64 {
        let own = hill.sheared(to, at);
        if own.z <= 0.0 { 0.0 } else { self.passing(at.extend(0.0), own, None, self.shares(to, own.z), 0.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grass::blades::STEPS;
    use crate::grass::judge::towards;
    use crate::grass::sheet::{CellEdges, SliceAtlas};
    use crate::grass::tests::{options, thin};
    use crate::grass::{baked, weights};
    use glam::DMat4;
    use mesophyll_files::mesh::LeafMesh;
    use mesophyll_transport::rays::{InstanceForest, Ray, TriangleTree};

    /// The share of the sun's light that reaches the ground of a steep slope, by rays past the blades themselves,
    /// each of which stands upright on the hill with its foot. No slice and no shear is in this computation. The
    /// slope is 0.6 at the distance of the radius from the top, where it also changes least. The limit is the error
    /// that docs/evidence/grass.md states for the coverage in the worst direction (0.034), and four standard errors of
    /// the rays.
    #[test]
    fn the_sun_reaches_the_ground_of_a_slope_as_rays_past_blades_say() {
        let (plant, meadow) = thin();
        let mut slices = baked(&meadow, &options());
        weights::fit(&meadow, &mut slices, 16).unwrap();
        let radius = 1500.0;
        let hill = Hill { middle: DVec2::new(-radius, 0.0), height: 0.6 * 0.5f64.exp() * radius, radius };
        let rise = |at: DVec2| hill.height * (-((at.x + radius).powi(2) + at.y * at.y) / (2.0 * radius * radius)).exp();
        // Blades up to 360 mm along x and 300 mm along y from the origin, where the hill falls by 0.6 along x.
        let mut all = LeafMesh::default();
        for (i, j) in (-6..=6).flat_map(|i| (-6..=6).map(move |j| (i, j))) {
            let at = DVec2::new(60.0 * f64::from(i), 50.0 * f64::from(j));
            for leaf in &plant.leaves {
                let mesh = &plant.blades[leaf.blade].mesh;
                let foot = leaf.transform.transform_point3(mesh.positions[0]).truncate() + at;
                all.append(mesh, DMat4::from_translation(at.extend(rise(foot))) * leaf.transform);
            }
        }
        let forest =
            InstanceForest::new(vec![TriangleTree::new(&all.positions, &all.indices)], &[(0, DMat4::IDENTITY)]);
        let side = 64;
        let places: Vec<DVec2> = (0..side * side)
            .map(|k| {
                let stray = |a: f64| (f64::from(k) * a).fract();
                let x = (f64::from(k % side) + stray(0.754_877_666_246_693)) / f64::from(side) - 0.5;
                let y = (f64::from(k / side) + stray(0.569_840_290_998_053)) / f64::from(side) - 0.5;
                DVec2::new(120.0 * x, 100.0 * y)
            })
            .collect();
        let mut shadows = 0;
        for [elevation, azimuth] in
            [[45.0, 0.0], [45.0, 90.0], [45.0, 180.0], [60.0, 180.0], [60.0, 30.0], [75.0, 200.0]]
        {
            let sun = towards(elevation, azimuth);
            // A ray is over all blades where it is higher over the ground than the highest of them.
            let clear = |at: DVec2| {
                let limit = 1.2 * meadow.height / hill.sheared(sun, at).z;
                assert!(limit * sun.truncate().length() < 240.0, "blades end too near");
                let ray = Ray::new(at.extend(rise(at) + 1e-6), sun);
                !forest.blocked_within(&ray, limit, |_, _, _| true)
            };
            let n = places.len() as f64;
            let right = places.iter().filter(|at| clear(**at)).count() as f64 / n;
            let found = places.iter().map(|at| slices.on_ground(&hill, *at, sun)).sum::<f64>() / n;
            let limit = 0.034 + 4.0 * (right * (1.0 - right) / n).sqrt();
            println!("{elevation}°, azimuth {azimuth}°: blades {right:.3}, slices {found:.3}, limit {limit:.3}");
            assert!((found - right).abs() < limit, "{elevation}° {azimuth}°: {found}, expected {right} within {limit}");
            shadows += usize::from((0.1..0.9).contains(&right));
        }
        assert!(shadows >= 5, "{shadows} directions with light and shadow");
    }

    /// Light that arrives at a blade of the level slice, in closed form. The blade stands at a quarter of the height,
    /// and nothing but the level slice has blades. A unit of length along Ω has the optical depth u P(|Ω_z|), where
    /// the whole height has u h P(1) = −ln(1 − a) from above. The sun's ray is (3/4) h over its rise over the ground
    /// in the lawn. The ray of the eye rises, but less than the slope before it, so that it sees the lawn from above.
    #[test]
    fn light_passes_a_level_slice_of_a_slope_by_its_closed_form() {
        let hill = Hill { middle: DVec2::new(-100.0, 0.0), height: -0.6 * 0.5f64.exp() * 100.0, radius: 100.0 };
        let (opacity, low) = (0.6, 0.25);
        let mut texel = [0.0; CHANNELS];
        (texel[0], texel[13]) = (opacity, low * opacity);
        let mut slices = baked(&thin().1, &options());
        slices.upright = SliceAtlas::new([64, 32], 16, CellEdges::Upright, |_, _, _| [0.0; CHANNELS]);
        slices.level = Some(SliceAtlas::new([64, 64], 1, CellEdges::Level, |_, _, _| texel.map(|v| v as f32)));
        slices.cover = LawnSlices::covers(&slices.upright, slices.level.as_ref());
        slices.projection = std::array::from_fn(|k| 0.4 - 0.2 * k as f64 / STEPS as f64);
        slices.shown = [0.0, 0.3];
        let place = DVec3::new(0.0, 0.0, 0.5 * slices.height);
        assert!((hill.slope(DVec2::ZERO) - DVec2::new(0.6, 0.0)).length() < 1e-12);
        let crossing = SliceCrossing { t: 0.0, across: SliceAxis::Z, index: 0, place, lean: DVec2::ZERO };
        for [elevation, azimuth] in [[45.0, 0.0], [45.0, 180.0], [70.0, 90.0], [50.0, 140.0]] {
            let sun = towards(elevation, azimuth);
            let rises = sun.z - 0.6 * sun.x;
            let length = (1.0 - low) / rises;
            let depth = -(1.0 - opacity).ln() / 0.3 * (0.4 - 0.2 * sun.z) * length;
            let eye = DVec3::new(1.0, 0.0, 0.2).normalize();
            let found = slices.arriving_on(&hill, &crossing, &texel, eye, sun);
            // A slice cannot have more than its whole depth.
            let right = (-depth).exp().max((1.0 - opacity).powf(1.0 - low));
            println!("{elevation}°, azimuth {azimuth}°: {found:.4}, expected {right:.4}");
            assert!((found - right).abs() < 1e-6, "{elevation}° {azimuth}°: {found}, expected {right}");
        }
    }
}
