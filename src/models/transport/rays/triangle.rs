//! Intersection of rays and triangles: the f64 test that decides, and packets of eight triangles in f32, which show for
//! which of them the f64 test is necessary.

use crate::rays::arena::{EMPTY, Line, Row};
use crate::rays::frame::Frame;
use crate::rays::ray::Ray;
use crate::rays::traversal::Local;
use glam::DVec3;
use mesophyll_base::lanes::{SingleLanes, WIDTH};

/// The three corners of a triangle.
pub(crate) type Triangle = [[f64; 3]; 3];

/// A ray prepared for the f64 test: its longest axis becomes z, and a shear of x and y makes it run along z.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sheared {
    axes: [usize; 3],
    shear: [f64; 3],
    origin: [f64; 3],
}

impl Sheared {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Sheared {
        let (o, d) = (ray.origin.to_array(), ray.direction.to_array());
        let [x, y, z] = [d[0].abs(), d[1].abs(), d[2].abs()];
        let axes = if x > y && x > z {
            [1, 2, 0]
        } else if y > z {
            [2, 0, 1]
        } else {
            [0, 1, 2]
        };
        let steep = 1.0 / d[axes[2]];
        Sheared {
            axes,
            shear: [d[axes[0]] * steep, d[axes[1]] * steep, steep],
            origin: [o[axes[0]], o[axes[1]], o[axes[2]]],
        }
    }

    /// A corner in the sheared coordinates: two distances across the ray, and one along it.
    #[inline(always)]
    fn corner(&self, p: &[f64; 3]) -> (f64, f64, f64) {
        let along = |k: usize| p[self.axes[k]] - self.origin[k];
        let z = along(2);
        (along(0) - self.shear[0] * z, along(1) - self.shear[1] * z, z)
    }

    /// (t, b1, b2) of the hit at (1−b1−b2)·p0 + b1·p1 + b2·p2, from either side; t may be negative. This is the method
    /// of Woop, Benthin & Wald 2013 ("Watertight ray/triangle intersection"), in f64. A ray through the common edge of
    /// two triangles hits at least one of them, because both compute the sign for the edge from the same numbers. A
    /// triangle seen exactly edge-on is not hit.
    #[inline(always)]
    pub fn meet(&self, triangle: &Triangle) -> Option<(f64, f64, f64)> {
        let [(ax, ay, az), (bx, by, bz), (cx, cy, cz)] =
            [self.corner(&triangle[0]), self.corner(&triangle[1]), self.corner(&triangle[2])];
        let (u, v, w) = (area(cx, cy, bx, by), area(ax, ay, cx, cy), area(bx, by, ax, ay));
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let inverse = 1.0 / det;
        let t = (u * az + v * bz + w * cz) * inverse * self.shear[2];
        // NaN arises for a triangle without an area whose products overflow. It is no hit.
        t.is_finite().then_some((t, v * inverse, w * inverse))
    }
}

/// x1·y2 − y1·x2, always with the right sign. Where rounding could change the sign, the products are computed exactly
/// (Dekker 1971, by fused multiply–add). Otherwise a triangle seen edge-on could be hit outside its corners.
#[inline(always)]
fn area(x1: f64, y1: f64, x2: f64, y2: f64) -> f64 {
    let (a, b) = (x1 * y2, y1 * x2);
    let difference = a - b;
    if difference.abs() > 4e-16 * (a.abs() + b.abs()) {
        difference
    } else {
        difference + (x1.mul_add(y2, -a) - y1.mul_add(x2, -b))
    }
}

/// Number of lines of a packet. Its rows hold a corner (x, y, z), two edges, and the triangles' numbers.
pub(crate) const PACKET: usize = 5;

/// The bit that marks the number of a solid triangle in a packet: all its points count as hits, without asking the
/// caller.
pub(crate) const SOLID: u32 = 1 << 31;

/// Appends a packet of up to eight triangles. `ids` holds their indices in `triangles`, with the bit [`SOLID`] where it
/// applies.
pub(crate) fn pack(frame: &Frame, triangles: &[Triangle], ids: &[u32], lines: &mut Vec<Line>) -> u32 {
    let at = lines.len();
    lines.resize(at + PACKET, EMPTY);
    let mut set = |row: usize, lane: usize, bits: u32| lines[at + row / 2].0[row % 2][lane] = bits;
    for lane in 0..WIDTH {
        // The edges of a free lane are NaN, so that no comparison with them holds.
        let Some(&id) = ids.get(lane) else {
            (3..9).for_each(|row| set(row, lane, f32::NAN.to_bits()));
            continue;
        };
        let [a, b, c] = triangles[(id & !SOLID) as usize].map(|p| frame.point(DVec3::from(p)));
        let edges = [b - a, c - a];
        for axis in 0..3 {
            set(axis, lane, (a[axis] as f32).to_bits());
            set(3 + axis, lane, (edges[0][axis] as f32).to_bits());
            set(6 + axis, lane, (edges[1][axis] as f32).to_bits());
        }
        set(9, lane, id);
    }
    at as u32
}

/// Half the distance between neighbouring f32 near 1.
const U: f32 = 1.0 / (1 << 24) as f32;

/// How much rounding can change the results of the packet test, for one ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tolerance {
    /// Of the edge functions, a length of the triangle's edges.
    edge: f32,
    /// The same, a length of the edges and of the way to the triangle.
    reach: f32,
}

impl Tolerance {
    /// Of no ray.
    pub const NONE: Tolerance = Tolerance { edge: 0.0, reach: 0.0 };

    /// For a ray whose origin has components of at most `reach` in the tree's frame, with an error of `error`.
    #[inline(always)]
    pub fn new(reach: f32, error: f32) -> Self {
        Tolerance { edge: 128.0 * U * (1.0 + reach) + error, reach: 1.0 + reach + error / U }
    }
}

/// Results of the f32 test of a packet. Each has one bit or one lane for each triangle.
pub(crate) struct Candidates<'a, L> {
    /// The triangles that the f64 test may accept with 0 < t ≤ limit.
    pub lanes: u32,
    /// Those of them that it will certainly accept with t > 0.
    pub sure: u32,
    /// Those of the certain ones that it will accept with t < limit.
    pub within: u32,
    /// An upper bound for the s of each certain hit.
    pub farthest: L,
    /// The triangles' numbers, with the bit [`SOLID`] where it applies.
    pub ids: &'a Row,
}

/// The triangles of a packet that the f64 test may accept, by the method of Möller & Trumbore 1997 without its
/// division, in f32.
///
/// Every triangle that the f64 test accepts with 0 < t ≤ limit passes. Let u = 2⁻²⁴, E the largest component of the
/// triangle's edges, and R the largest of the ray's origin. Corners and the direction have components of at most 1. The
/// rounding of the input and of every step changes an edge function U or V by at most 54 u (1+R) E, the determinant D
/// by 48 u E², and T, which is t·D, by 54 u (1+R) E². The tolerances here are larger: 128 u (1+R+E) E for the edge
/// functions and their sum, 64 u (1+R) E² for T > 0, and 64 u (1+R+limit) E² for T ≤ limit·D. If |D| is at most 64 u
/// E², its sign is not certain. The triangle is then seen edge-on, and only the f64 test checks t. The term 1e-30 keeps
/// the bounds valid where products underflow.
///
/// By the same bounds, a triangle is certainly hit if its edge functions and T exceed their tolerances. Its s is then
/// at most (T + 64 u (1+R) E²)/(D − 64 u E²).
///
/// `limit` is rounded up, at most to x (1 + 1e-6) + 1e-7, where x is the s of the limit on t (`Local::s`). To be
/// certain that a hit lies before the limit, it is compared with limit (1 − 32 u) − 8 u. This is less than x by at
/// least 13 u x + 6 u, so the tolerances only have to allow for the rounding of T and D.
#[inline(always)]
pub(crate) fn candidates<'a, L: SingleLanes>(
    local: &Local,
    limit: L,
    lines: &'a [Line; PACKET],
) -> Option<Candidates<'a, L>> {
    let (corner, first, second) = (rows::<L>(lines, 0), rows::<L>(lines, 3), rows::<L>(lines, 6));
    let size = longest(first).max(longest(second)).mul(L::splat(1.0 + 2.0 * U));
    let zero = L::splat(0.0);
    let direction = splat::<L>(local.direction);
    let p = cross(direction, second);
    let det = dot(first, p);
    let sign = det.sign();
    let det = det.flip(sign);
    let [x, y, z] = splat::<L>(local.origin);
    let from = [x.sub(corner[0]), y.sub(corner[1]), z.sub(corner[2])];
    let b1 = dot(from, p).flip(sign);
    let q = cross(from, first);
    let b2 = dot(direction, q).flip(sign);
    let b0 = det.sub(b1).sub(b2);
    let tiny = L::splat(1e-30);
    let tolerance = size.fma(size.fma(L::splat(128.0 * U), L::splat(local.tolerance.edge)), tiny);
    let least = b0.min(b1).min(b2);
    let inside = L::bits(zero.at_most(least.add(tolerance)));
    let t = dot(second, q).flip(sign);
    let unit = size.mul(size).mul(L::splat(64.0 * U));
    let slack = unit.fma(L::splat(local.tolerance.reach), tiny);
    let ahead = L::bits(zero.at_most(t.add(slack)));
    let slack_at_limit = unit.fma(L::splat(local.tolerance.reach).add(limit), tiny);
    let at_limit = limit.mul(det);
    let near = L::bits(t.at_most(at_limit.add(slack_at_limit)));
    let thin = L::bits(det.at_most(unit));
    let lanes = inside & (thin | (ahead & near));
    let sure = lanes & !thin & L::bits(tolerance.at_most(least)) & L::bits(slack.at_most(t));
    let below = limit.mul(L::splat(1.0 - 32.0 * U)).sub(L::splat(8.0 * U));
    let within = sure & L::bits(t.add(slack_at_limit).at_most(below.mul(det)));
    // The factor allows for three roundings, and for as many more.
    let farthest = t.add(slack).div(det.sub(unit)).mul(L::splat(1.0 + 8.0 * U));
    (lanes != 0).then_some(Candidates { lanes, sure, within, farthest, ids: &lines[4].0[1] })
}

// Functions instead of closures, so that the compiler uses the instruction set of the caller.
#[inline(always)]
fn row<L: SingleLanes>(lines: &[Line; PACKET], k: usize) -> L {
    L::from_bits(&lines[k / 2].0[k % 2])
}

#[inline(always)]
fn splat<L: SingleLanes>([x, y, z]: [f32; 3]) -> [L; 3] {
    [L::splat(x), L::splat(y), L::splat(z)]
}

#[inline(always)]
fn rows<L: SingleLanes>(lines: &[Line; PACKET], k: usize) -> [L; 3] {
    [row(lines, k), row(lines, k + 1), row(lines, k + 2)]
}

#[inline(always)]
fn longest<L: SingleLanes>([x, y, z]: [L; 3]) -> L {
    x.abs().max(y.abs()).max(z.abs())
}

#[inline(always)]
fn cross<L: SingleLanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[1].fms(b[2], a[2].mul(b[1])), a[2].fms(b[0], a[0].mul(b[2])), a[0].fms(b[1], a[1].mul(b[0]))]
}

#[inline(always)]
fn dot<L: SingleLanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0].fma(b[0], a[1].fma(b[1], a[2].mul(b[2])))
}
