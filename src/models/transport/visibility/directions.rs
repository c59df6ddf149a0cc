//! The directions of a light that have a map, and the mixture of maps for a light between them.

use super::entropy::take;
use crate::{Error, Result};
use glam::{DMat3, DVec3};

/// Directions towards a light. Each has a map.
#[derive(Debug, Clone, PartialEq)]
pub struct ShadowDirections {
    kind: Kind,
    list: Vec<DVec3>,
}

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    /// A path along which the light moves. A single direction is the shortest path.
    Arc,
    /// The texels of a cube map whose sine of elevation is at least `lowest`. `slot` gives the place of each texel in
    /// the list.
    Cube { side: usize, lowest: f64, slot: Vec<Option<u32>> },
}

/// The maps around a direction, with their shares, which sum to 1.
pub type MapBlend = Vec<(usize, f64)>;

/// Largest side of a cube map.
const MOST_SIDE: usize = 256;

impl ShadowDirections {
    /// The direction of a light that does not move.
    ///
    /// # Errors
    /// [`Error::Usage`] for a direction that is not finite or has no length.
    pub fn one(direction: DVec3) -> Result<ShadowDirections> {
        ShadowDirections::arc(&[direction])
    }

    /// A light that moves from one direction to the next, such as the sun during a day. The closer the directions are,
    /// the nearer a mixture is to the true map between them.
    ///
    /// # Errors
    /// [`Error::Usage`] for an empty path, or a direction that is not finite or has no length.
    pub fn arc(path: &[DVec3]) -> Result<ShadowDirections> {
        if path.is_empty() || path.iter().any(|d| !d.is_finite() || d.try_normalize().is_none()) {
            return Err(Error::Usage("visibility: expected directions that are finite and not zero".into()));
        }
        Ok(ShadowDirections { kind: Kind::Arc, list: path.iter().map(|d| d.normalize()).collect() })
    }

    /// The centres of the `side` · `side` · 6 texels of a cube map (the source has a side of 32) whose sine of
    /// elevation is at least `lowest`; −1 keeps all. A sun that never sets needs those above minus the width of a texel
    /// (2.2 / `side`).
    ///
    /// # Errors
    /// [`Error::Usage`] for a side of 0 or above 256, or where no texel is kept.
    pub fn cube(side: usize, lowest: f64) -> Result<ShadowDirections> {
        if !(1..=MOST_SIDE).contains(&side) {
            return Err(Error::Usage(format!("visibility: a cube of side {side}, expected 1 to {MOST_SIDE}")));
        }
        let mut list = Vec::new();
        let slot = (0..6 * side * side)
            .map(|cell| {
                let d = centre(cell, side);
                (d.z >= lowest).then(|| {
                    list.push(d);
                    list.len() as u32 - 1
                })
            })
            .collect();
        if list.is_empty() {
            return Err(Error::Usage(format!("visibility: no direction has a sine of elevation of {lowest}")));
        }
        Ok(ShadowDirections { kind: Kind::Cube { side, lowest, slot }, list })
    }

    /// Number of directions.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Always false, because there is at least one direction.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Unit vectors towards the light.
    pub fn list(&self) -> &[DVec3] {
        &self.list
    }

    /// The maps around a light in the direction `light` (of any length above 0), at most three, and their shares. The
    /// shares change continuously as the light moves, and sum to 1. Empty where a cube keeps none of these maps.
    ///
    /// On a path, the light is moved to the nearest point of the path. On a cube map, the texels' centres divide the
    /// sphere into triangles, and the shares belong to the corners of the triangle around the light.
    pub fn blend(&self, light: DVec3) -> MapBlend {
        let light = light.normalize_or(DVec3::Z);
        match &self.kind {
            Kind::Arc => along(&self.list, light),
            Kind::Cube { side, slot, .. } => {
                let around = around(*side, light);
                let mut parts: MapBlend =
                    around.into_iter().filter_map(|(cell, share)| Some((slot[cell]? as usize, share))).collect();
                let all: f64 = parts.iter().map(|(_, share)| share).sum();
                parts.retain(|(_, share)| *share > 0.0);
                parts.iter_mut().for_each(|(_, share)| *share /= all);
                parts
            }
        }
    }

    /// Appends the directions as bytes, for a file.
    pub(super) fn write(&self, out: &mut Vec<u8>) {
        match &self.kind {
            Kind::Arc => {
                out.push(0);
                out.extend((self.list.len() as u32).to_le_bytes());
                out.extend(self.list.iter().flat_map(|d| d.to_array()).flat_map(f64::to_le_bytes));
            }
            Kind::Cube { side, lowest, .. } => {
                out.push(1);
                out.extend((*side as u32).to_le_bytes());
                out.extend(lowest.to_le_bytes());
            }
        }
    }

    /// Reads the bytes of [`ShadowDirections::write`] from the beginning of `bytes`, and removes them.
    pub(super) fn read(bytes: &mut &[u8]) -> std::result::Result<ShadowDirections, String> {
        let [kind] = take(bytes)?;
        let count = u32::from_le_bytes(take(bytes)?) as usize;
        let read = match kind {
            0 if count > bytes.len() / 24 => return Err("it is cut off".into()),
            0 => {
                let mut number = || take(bytes).map(f64::from_le_bytes);
                let list = (0..count).map(|_| Ok(DVec3::new(number()?, number()?, number()?)));
                let list = list.collect::<std::result::Result<Vec<_>, String>>()?;
                // The stored vectors are used unchanged, because normalising them again might change a bit.
                ShadowDirections::arc(&list).map(|arc| ShadowDirections { list, ..arc })
            }
            1 => ShadowDirections::cube(count, f64::from_le_bytes(take(bytes)?)),
            _ => return Err(format!("directions of kind {kind}, expected 0 or 1")),
        };
        read.map_err(|e| e.to_string())
    }
}

/// The two directions of a path that a light is between, or the nearer end.
fn along(path: &[DVec3], light: DVec3) -> MapBlend {
    // A path may cross itself or return along itself. So a direction that the path contains is found first, before any
    // pair.
    if let Some(k) = path.iter().position(|d| d.dot(light) > 1.0 - 1e-12) {
        return vec![(k, 1.0)];
    }
    let mut best = (f64::NEG_INFINITY, vec![(0, 1.0)]);
    for (k, pair) in path.windows(2).enumerate() {
        let (a, b) = (pair[0], pair[1]);
        let angle = a.angle_between(b);
        // On the great circle through a and b, the angle from a to the light's nearest point.
        let across = (b - a * a.dot(b)).normalize_or_zero();
        let t = light.dot(across).atan2(light.dot(a)).clamp(0.0, angle);
        let near = light.dot(a * t.cos() + across * t.sin());
        if near > best.0 {
            let share = if angle > 0.0 { t / angle } else { 0.0 };
            best = (near, vec![(k, 1.0 - share), (k + 1, share)]);
        }
    }
    best.1.retain(|(_, share)| *share > 0.0);
    best.1
}

/// The direction of a place on a face of the cube. The place is in texels, counted from the centre of the first one.
pub(crate) fn on_face(face: usize, [i, j]: [f64; 2], side: usize) -> DVec3 {
    let at = |k: f64| (2.0 * k + 1.0) / side as f64 - 1.0;
    let mut d = DVec3::ZERO;
    d[face / 2] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    d[(face / 2 + 1) % 3] = at(i);
    d[(face / 2 + 2) % 3] = at(j);
    d
}

fn centre(cell: usize, side: usize) -> DVec3 {
    let [i, j] = [cell % side, cell / side % side].map(|k| k as f64);
    on_face(cell / (side * side), [i, j], side).normalize()
}

/// The face that a direction goes through, and the place on it.
pub(crate) fn place(d: DVec3, side: usize) -> (usize, [f64; 2]) {
    let largest = d.abs().max_element();
    let axis = (0..3).find(|k| d[*k].abs() == largest).unwrap_or(2);
    let face = 2 * axis + usize::from(d[axis] < 0.0);
    let texel = |k: usize| 0.5 * (d[k] / largest + 1.0) * side as f64 - 0.5;
    (face, [texel((axis + 1) % 3), texel((axis + 2) % 3)])
}

/// The texel at (i, j) of a face, or one step beside the face. `None` beside a corner of the face, where there is no
/// texel.
fn cell(face: usize, [i, j]: [i64; 2], side: usize) -> Option<usize> {
    let range = 0..side as i64;
    let number = |face: usize, [i, j]: [i64; 2]| face * side * side + (j as usize) * side + i as usize;
    match (range.contains(&i), range.contains(&j)) {
        (true, true) => Some(number(face, [i, j])),
        (false, false) => None,
        _ => {
            let (face, at) = place(on_face(face, [i as f64, j as f64], side), side);
            Some(number(face, at.map(|k| (k.round() as i64).clamp(0, side as i64 - 1))))
        }
    }
}

/// The corners of the triangle around a direction, and their shares.
///
/// Four texels that meet form two triangles, which are divided from the texel with the lowest number. Three texels meet
/// at each corner of the cube. Sides of triangles lie in planes through the cube's centre, so that both triangles of a
/// side give the same shares to its points.
fn around(side: usize, d: DVec3) -> Vec<(usize, f64)> {
    let (face, [x, y]) = place(d, side);
    let (i, j) = (x.floor() as i64, y.floor() as i64);
    let mut best = (f64::NEG_INFINITY, Vec::new());
    // Near the rim of a face, sides are not parallel to the rows, and the direction may be in the next triangle.
    for (i, j) in (-1..=1).flat_map(|dj| (-1..=1).map(move |di| (i + di, j + dj))) {
        let range = -1..side as i64;
        if !(range.contains(&i) && range.contains(&j)) {
            continue;
        }
        let turn = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
        let mut ring: Vec<usize> = turn.into_iter().filter_map(|at| cell(face, at, side)).collect();
        let first = (0..ring.len()).fold(0, |a, b| if ring[b] < ring[a] { b } else { a });
        ring.rotate_left(first);
        for k in 1..ring.len() - 1 {
            let corners = [ring[0], ring[k], ring[k + 1]];
            let basis = DMat3::from_cols_array_2d(&corners.map(|c| centre(c, side).to_array()));
            if basis.determinant() == 0.0 {
                continue;
            }
            let shares = basis.inverse() * d;
            let least = shares.min_element();
            if least > best.0 {
                let shares = shares.max(DVec3::ZERO);
                let all = shares.element_sum();
                best = (least, corners.into_iter().zip((shares / all).to_array()).collect());
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(count: u64) -> impl Iterator<Item = DVec3> {
        let number = |k: u64| crate::seeds::mix(3, k) as f64 / 2f64.powi(63) - 1.0;
        (0..count).map(move |k| DVec3::new(number(3 * k), number(3 * k + 1), number(3 * k + 2)).normalize_or(DVec3::X))
    }

    fn share(blend: &MapBlend, k: usize) -> f64 {
        blend.iter().find(|(n, _)| *n == k).map_or(0.0, |(_, share)| *share)
    }

    /// At a centre only its own map counts. Everywhere, shares are positive, sum to 1, belong to near directions, and
    /// have the light's direction as their mean.
    #[test]
    fn shares_are_those_of_the_nearest_around() {
        for side in [1, 2, 5, 32] {
            let cube = ShadowDirections::cube(side, -1.0).unwrap();
            assert_eq!(cube.len(), 6 * side * side);
            for (k, d) in cube.list().iter().enumerate() {
                assert!((share(&cube.blend(*d), k) - 1.0).abs() < 1e-9, "{side}: {k}");
            }
            for d in random(3000) {
                let blend = cube.blend(d);
                assert!((blend.iter().map(|(_, s)| s).sum::<f64>() - 1.0).abs() < 1e-12);
                assert!(blend.len() <= 3 && blend.iter().all(|(_, s)| *s > 0.0));
                let mixed: DVec3 = blend.iter().map(|(k, s)| cube.list()[*k] * *s).sum();
                assert!(mixed.angle_between(d) < 0.4 / (side * side) as f64 + 1e-7, "{side}: {d}");
            }
        }
    }

    /// A small step changes shares by little, also across sides and across corners of the cube.
    #[test]
    fn shares_change_continuously() {
        let step = 1e-6;
        for side in [1, 4, 32] {
            let cube = ShadowDirections::cube(side, -1.0).unwrap();
            let corners = [[1.0, 1.0, 1.0], [1.0, 1.0, 0.3], [-1.0, 0.2, 1.0]].map(DVec3::from);
            let near = corners.into_iter().flat_map(|c| random(500).map(move |r| c + r * 0.02));
            for (d, r) in random(2000).chain(near).zip(random(5000).skip(7)) {
                let (a, b) = (cube.blend(d), cube.blend(d.normalize() + r * step));
                let change: f64 =
                    a.iter().chain(&b).map(|(k, _)| (share(&a, *k) - share(&b, *k)).abs()).fold(0.0, f64::max);
                assert!(change < 4.0 * side as f64 * step, "{side}: {d} changes by {change}");
            }
        }
    }

    #[test]
    fn a_path_is_followed_and_its_ends_hold() {
        let at = |deg: f64| DVec3::new(deg.to_radians().cos(), 0.0, deg.to_radians().sin());
        let arc = ShadowDirections::arc(&[at(10.0), at(20.0), at(50.0)]).unwrap();
        let close = |a: MapBlend, b: &[(usize, f64)]| {
            assert_eq!(a.len(), b.len());
            assert!(a.iter().zip(b).all(|(x, y)| x.0 == y.0 && (x.1 - y.1).abs() < 1e-12), "{a:?}");
        };
        close(arc.blend(at(13.0)), &[(0, 0.7), (1, 0.3)]);
        close(arc.blend(at(41.0)), &[(1, 0.3), (2, 0.7)]);
        // Directions beside the path, and beyond its ends.
        close(arc.blend(at(35.0) + DVec3::Y * 0.1), &[(1, 0.5), (2, 0.5)]);
        close(arc.blend(at(-70.0)), &[(0, 1.0)]);
        close(arc.blend(at(77.0)), &[(2, 1.0)]);
        close(ShadowDirections::one(at(3.0)).unwrap().blend(DVec3::Z), &[(0, 1.0)]);
        assert!(ShadowDirections::arc(&[]).is_err() && ShadowDirections::one(DVec3::ZERO).is_err());
        assert!(ShadowDirections::one(DVec3::NAN).is_err());
    }

    /// A sun above the horizon has all maps around it if those down to one texel below the horizon are kept.
    #[test]
    fn what_lies_below_may_be_left_out() {
        let side = 16;
        let (whole, upper) =
            (ShadowDirections::cube(side, -1.0).unwrap(), ShadowDirections::cube(side, -2.2 / side as f64).unwrap());
        assert!(upper.len() < whole.len() * 3 / 5);
        for d in random(2000).map(|d| DVec3::new(d.x, d.y, d.z.abs())) {
            let put =
                |of: &ShadowDirections, blend: MapBlend| blend.iter().map(|(k, s)| of.list()[*k] * *s).sum::<DVec3>();
            assert!(put(&whole, whole.blend(d)).distance(put(&upper, upper.blend(d))) < 1e-12);
        }
        assert!(upper.blend(DVec3::NEG_Z).is_empty());
        assert!(ShadowDirections::cube(side, 1.1).is_err() && ShadowDirections::cube(0, -1.0).is_err());
        assert!(ShadowDirections::cube(257, -1.0).is_err());
    }

    /// A day at the equinox follows a great circle, on which the scene's own sun also stands. Each direction of the
    /// path still has its own map.
    #[test]
    fn a_path_that_goes_back_along_itself_has_every_direction_of_its_own() {
        let at = |hour: f64| {
            let angle = (15.0 * (hour - 12.0)).to_radians();
            DVec3::new(angle.sin(), 0.74 * angle.cos(), 0.67 * angle.cos()).normalize()
        };
        let hours = [12.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0];
        let arc = ShadowDirections::arc(&hours.map(at)).unwrap();
        for hour in hours {
            let first = hours.iter().position(|h| *h == hour).unwrap();
            assert_eq!(arc.blend(at(hour)), vec![(first, 1.0)], "{hour}");
        }
    }
}
