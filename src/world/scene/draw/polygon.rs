//! Polygons with few corners. An outline loses corners by segment collapse: an edge becomes one corner, placed so that
//! the area stays (Kronenfeld, Stanislawski, Buttenfield & Brockmeyer 2020, "Simplification of polylines by segment
//! collapse: minimizing areal displacement while preserving area"). A search then brings the corners nearer to the
//! outline.

use glam::{DVec2, DVec3};

/// Corners of the outline that the search looks at.
const OUTLINE: usize = 32;

/// The polygon with this many corners and this area that is nearest to an outline, as far as the search finds it.
/// `None` where no edge of the outline can be collapsed.
pub fn few(outline: &[DVec2], corners: usize, area: f64) -> Option<Vec<DVec2>> {
    Some(closest(collapsed(outline, corners)?, &collapsed(outline, OUTLINE)?, area))
}

/// Area of a polygon, above 0 where it runs counter-clockwise.
pub fn signed(ring: &[DVec2]) -> f64 {
    (0..ring.len()).map(|k| 0.5 * ring[k].perp_dot(ring[(k + 1) % ring.len()])).sum()
}

/// The outline with this many corners and the same area. `None` where it has no more corners than that and fewer than
/// three, or where no edge can be collapsed.
fn collapsed(outline: &[DVec2], corners: usize) -> Option<Vec<DVec2>> {
    let mut ring = outline.to_vec();
    ring.dedup();
    while ring.len() > corners {
        let n = ring.len();
        let at = |k: usize, by: usize| ring[(k + by) % n];
        let tries = (0..n).filter_map(|k| Some((k, collapse([at(k, 0), at(k, 1), at(k, 2), at(k, 3)])?)));
        let (k, (place, _)) = tries.min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
        let gone = (k + 2) % n;
        ring[(k + 1) % n] = place;
        ring.remove(gone);
    }
    (ring.len() >= 3).then_some(ring)
}

/// The corner E that takes the place of the edge from B to C in A, B, C, D with the area unchanged, and the area that
/// changes sides. E lies on the line A B or on C D, whichever moves less.
fn collapse([a, b, c, d]: [DVec2; 4]) -> Option<(DVec2, f64)> {
    let base = d - a;
    let long = base.length();
    if long < 1e-12 {
        return None;
    }
    // Heights over A D; E has the height at which the triangle A E D has the area of A, B, C, D.
    let height = |p: DVec2| base.perp_dot(p - a) / long;
    let enclosed = (b - a).perp_dot(c - a) + (c - a).perp_dot(d - a);
    let wanted = -enclosed / long;
    let on = |from: DVec2, to: DVec2| {
        let (h0, h1) = (height(from), height(to));
        ((h1 - h0).abs() > 1e-9 * long).then(|| from + (wanted - h0) / (h1 - h0) * (to - from))
    };
    let moved = |e: DVec2, first: bool| {
        let (from, to) = if first { (e, d) } else { (a, e) };
        let turn = (to - from).perp_dot(c - b);
        let x = if turn.abs() < 1e-15 { b } else { b + (b - from).perp_dot(to - from) / turn * (c - b) };
        let triangle = |p: DVec2, q: DVec2, r: DVec2| 0.5 * (q - p).perp_dot(r - p).abs();
        match first {
            true => triangle(b, e, x) + triangle(x, c, d),
            false => triangle(c, e, x) + triangle(x, b, a),
        }
    };
    let places = [(on(a, b), true), (on(d, c), false)];
    let found = places.into_iter().filter_map(|(e, first)| Some((e?, moved(e?, first))));
    found.filter(|f| f.0.is_finite() && f.1.is_finite()).min_by(|p, q| p.1.total_cmp(&q.1))
}

/// The polygon with this area that is nearest to an outline, by a search with steps from a tenth to a four-hundredth of
/// the area's side.
fn closest(polygon: Vec<DVec2>, outline: &[DVec2], area: f64) -> Vec<DVec2> {
    let scaled = |polygon: &[DVec2]| -> Vec<DVec2> {
        let middle = polygon.iter().sum::<DVec2>() / polygon.len() as f64;
        let by = (area / signed(polygon).max(1e-9 * area)).sqrt();
        polygon.iter().map(|p| middle + by * (*p - middle)).collect()
    };
    let off = |polygon: &[DVec2]| {
        let rim = |a: &[DVec2], b: &[DVec2]| farthest(a, b).max(farthest(b, a));
        rim(polygon, outline)
    };
    let mut best = scaled(&polygon);
    let mut least = off(&best);
    let mut step = 0.1 * area.sqrt();
    while step > 0.0025 * area.sqrt() {
        let before = least;
        for k in 0..best.len() {
            for by in [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y] {
                let mut tried = best.clone();
                tried[k] += step * by;
                let tried = scaled(&tried);
                let far = off(&tried);
                if far < least {
                    (best, least) = (tried, far);
                }
            }
        }
        if least >= 0.999 * before {
            step *= 0.5;
        }
    }
    best
}

/// The largest distance of points on the rim of `a` from the rim of `b`.
fn farthest(a: &[DVec2], b: &[DVec2]) -> f64 {
    let edge = |ring: &[DVec2], k: usize| [ring[k], ring[(k + 1) % ring.len()]];
    let points = (0..a.len()).flat_map(|k| {
        let [from, to] = edge(a, k);
        [0.0, 0.25, 0.5, 0.75].map(|t| from.lerp(to, t))
    });
    let near = |p: DVec2| (0..b.len()).map(move |k| beside(p.extend(0.0), edge(b, k).map(|q| q.extend(0.0))));
    points.map(|p| near(p).fold(f64::MAX, f64::min)).fold(0.0, f64::max)
}

/// The triangles of a simple polygon, by cutting the ear with the shortest new edge, so that no triangle is needlessly
/// long; `None` where it crosses itself.
pub fn ears(polygon: &[DVec2]) -> Option<Vec<u32>> {
    let mut left: Vec<usize> = (0..polygon.len()).collect();
    let mut out = Vec::new();
    let mut area = 0.0;
    while left.len() >= 3 {
        let n = left.len();
        let corner = |i: usize| [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
        let twice = |[a, b, c]: [usize; 3]| (polygon[b] - polygon[a]).perp_dot(polygon[c] - polygon[a]);
        let ear = |i: &usize| {
            let [a, b, c] = corner(*i);
            let holds = |p: usize| [[a, b, p], [b, c, p], [c, a, p]].into_iter().all(|t| twice(t) >= 0.0);
            twice([a, b, c]) > 0.0 && left.iter().all(|p| [a, b, c].contains(p) || !holds(*p))
        };
        let across = |i: &usize| {
            let [a, _, c] = corner(*i);
            polygon[a].distance_squared(polygon[c])
        };
        let i = (0..n).filter(ear).min_by(|i, j| across(i).total_cmp(&across(j)))?;
        area += 0.5 * twice(corner(i));
        out.extend(corner(i).map(|k| k as u32));
        left.remove(i);
    }
    ((area / signed(polygon) - 1.0).abs() < 1e-9).then_some(out)
}

/// Distance of a point from a segment.
pub fn beside(p: DVec3, [a, b]: [DVec3; 2]) -> f64 {
    let t = ((p - a).dot(b - a) / a.distance_squared(b).max(1e-300)).clamp(0.0, 1.0);
    p.distance(a.lerp(b, t))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A star with five points, which is not convex.
    fn star() -> Vec<DVec2> {
        let point = |k: u32| (3.0 + f64::from(k % 2)) * DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / 10.0);
        (0..10).map(point).collect()
    }

    #[test]
    fn collapsing_keeps_the_area_and_the_number_asked_for() {
        for corners in [8, 6, 5, 4] {
            let found = collapsed(&star(), corners).expect("corners");
            assert_eq!(found.len(), corners);
            assert!((signed(&found) / signed(&star()) - 1.0).abs() < 1e-9, "{corners}");
            let scaled = few(&star(), corners, 7.0).expect("corners");
            assert!((signed(&scaled) - 7.0).abs() < 1e-9);
        }
    }

    #[test]
    fn ears_fill_a_polygon_and_one_that_crosses_itself_has_none() {
        let triangles = ears(&star()).expect("triangles");
        assert_eq!(triangles.len(), 3 * 8);
        let area: f64 = triangles.chunks(3).map(|t| signed(&[0, 1, 2].map(|k| star()[t[k] as usize]))).sum();
        assert!((area - signed(&star())).abs() < 1e-9);
        let crossed = [DVec2::ZERO, DVec2::new(2.0, 2.0), DVec2::new(2.0, 0.0), DVec2::new(0.0, 2.5)];
        assert!(ears(&crossed).is_none());
    }
}
