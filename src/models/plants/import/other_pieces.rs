//! Pieces that are no tube: whether a place lies on one or within it.

use crate::form::nearest;
use glam::DVec3;
use std::f64::consts::TAU;

/// The largest number of triangles in a group.
const GROUP: usize = 64;
/// From this many radii of a group on, its triangles count as one small piece of surface. Then the solid angle of the
/// group is off by about a hundredth of itself.
const FAR: f64 = 4.0;

/// A piece, as groups of triangles that lie near each other.
pub(super) struct Refused {
    groups: Vec<Group>,
}

struct Group {
    triangles: Vec<[DVec3; 3]>,
    low: DVec3,
    high: DVec3,
    /// The vector area.
    area: DVec3,
}

impl Refused {
    pub fn new(triangles: Vec<[DVec3; 3]>) -> Refused {
        let (mut groups, mut rest) = (Vec::new(), vec![triangles]);
        while let Some(mut triangles) = rest.pop() {
            let empty = (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY));
            let (low, high) = triangles.iter().flatten().fold(empty, |(a, b), p| (a.min(*p), b.max(*p)));
            if triangles.len() > GROUP {
                // Halves along the longest side.
                let axis = (high - low).max_position();
                let place = |t: &[DVec3; 3]| t[0][axis] + t[1][axis] + t[2][axis];
                let half = triangles.len() / 2;
                triangles.select_nth_unstable_by(half, |a, b| place(a).total_cmp(&place(b)));
                rest.push(triangles.split_off(half));
                rest.push(triangles);
                continue;
            }
            let area = triangles.iter().map(|[a, b, c]| 0.5 * (*b - *a).cross(*c - *a)).sum();
            groups.push(Group { triangles, low, high, area });
        }
        Refused { groups }
    }

    /// How far a place is from the surface, if it is no farther than `reach`; 0 within the piece.
    pub fn within(&self, place: DVec3, reach: f64) -> Option<f64> {
        let near = self.groups.iter().filter(|group| group.outside(place) <= reach);
        let gaps = near.flat_map(|group| &group.triangles).map(|corners| beside(*corners, place));
        let gap = gaps.min_by(f64::total_cmp).filter(|gap| *gap <= reach);
        // A closed surface covers the whole sphere around a place within it, an open tube most of it.
        gap.or_else(|| (self.covered(place).abs() > TAU).then_some(0.0))
    }

    /// The signed solid angle that the piece covers, as seen from a place; 0 outside its box.
    fn covered(&self, place: DVec3) -> f64 {
        let low = self.groups.iter().fold(place, |low, group| low.min(group.low));
        let high = self.groups.iter().fold(place, |high, group| high.max(group.high));
        if (low.cmpeq(place) | high.cmpeq(place)).any() {
            return 0.0;
        }
        self.groups.iter().map(|group| group.covered(place)).sum()
    }
}

impl Group {
    /// How far a place is from the group's box.
    fn outside(&self, place: DVec3) -> f64 {
        (self.low - place).max(place - self.high).max(DVec3::ZERO).length()
    }

    fn covered(&self, place: DVec3) -> f64 {
        let to = 0.5 * (self.low + self.high) - place;
        let far = to.length();
        if far > FAR * 0.5 * self.low.distance(self.high) {
            return self.area.dot(to) / far.powi(3);
        }
        self.triangles.iter().map(|corners| solid_angle(*corners, place)).sum()
    }
}

/// The signed solid angle that a triangle covers, as seen from a place (Van Oosterom and Strackee 1983).
fn solid_angle(corners: [DVec3; 3], place: DVec3) -> f64 {
    let [a, b, c] = corners.map(|p| p - place);
    let [x, y, z] = [a, b, c].map(|v| v.length());
    2.0 * a.dot(b.cross(c)).atan2(x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y)
}

/// The distance of a place from a triangle.
fn beside([a, b, c]: [DVec3; 3], place: DVec3) -> f64 {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let inside = |p: DVec3, q: DVec3| (q - p).cross(place - p).dot(normal) >= 0.0;
    if normal != DVec3::ZERO && inside(a, b) && inside(b, c) && inside(c, a) {
        return (place - a).dot(normal).abs();
    }
    nearest(&[a, b, c, a], place).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form::tube;

    /// A tube with many triangles: places on its surface, within it, before its open ends, and beside it.
    #[test]
    fn places_on_a_piece_and_within_it_are_told_from_others() {
        for rings in [2, 60] {
            let mesh = tube(&[DVec3::ZERO, DVec3::Z * 1000.0], [40.0, 20.0], 24, rings);
            let triangles: Vec<[DVec3; 3]> =
                mesh.indices.chunks_exact(3).map(|t| [0, 1, 2].map(|k| mesh.positions[t[k] as usize])).collect();
            let piece = Refused::new(triangles.clone());
            assert_eq!(piece.groups.iter().map(|g| g.triangles.len()).sum::<usize>(), triangles.len());
            assert!(piece.groups.iter().all(|g| g.triangles.len() <= GROUP));
            for (place, within) in [
                (DVec3::new(0.0, 0.0, 500.0), Some(0.0)),
                (DVec3::new(5.0, -3.0, 80.0), Some(0.0)),
                (DVec3::new(33.0, 0.0, 500.0), Some(3.0)),
                (DVec3::new(60.0, 0.0, 500.0), None),
                (DVec3::new(0.0, 0.0, -30.0), None),
                (DVec3::new(0.0, 0.0, 1040.0), None),
            ] {
                let found = piece.within(place, 5.0);
                assert!(
                    match (found, within) {
                        (Some(a), Some(b)) => (a - b).abs() < 0.5,
                        (a, b) => a == b,
                    },
                    "{place}: {found:?}"
                );
                let exact: f64 = triangles.iter().map(|t| solid_angle(*t, place)).sum();
                let low = piece.groups.iter().map(|g| g.covered(place)).sum::<f64>();
                assert!((exact - low).abs() < 0.02 * 2.0 * TAU, "{place}: {exact} {low}");
            }
        }
    }
}
