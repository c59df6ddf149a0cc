//! Frames in which the texel's horizon hides a part of the tube. The visible part ends on the horizon; this module
//! finds those ends, the diffuse response D between them, and the derivative that comes from the ends' own motion.

use super::Point;
use super::arc::flat;
use super::light::atan;
use mesophyll_base::lanes::DoubleLanes;
use std::f64::consts::PI;

/// Moves the end that the horizon hides to the place where the horizon cuts the arc, in the lanes of `cut`. Returns
/// those of these lanes that see anything.
#[inline(always)]
pub(super) fn above<L: DoubleLanes>(
    point: &Point,
    a1: L,
    ends: &mut [L; 2],
    end_cos: &mut [L; 2],
    end_sin: &mut [L; 2],
    cut: L::Mask,
) -> L::Mask {
    let (zero, along) = (L::splat(0.0), point.n[1]);
    if along.abs() < 1e-300 {
        return L::both(cut, zero.less(a1));
    }
    let tan = a1.mul(L::splat(-1.0 / along));
    let end = usize::from(along < 0.0);
    let hidden = if end == 0 { ends[0].less(tan) } else { tan.less(ends[1]) };
    let part = L::both(cut, if end == 0 { tan.less(ends[1]) } else { ends[0].less(tan) });
    let moves = L::both(part, hidden);
    let cos = L::splat(1.0).div(tan.fma(tan, L::splat(1.0)).sqrt());
    end_cos[end] = cos.or(moves, end_cos[end]);
    end_sin[end] = tan.mul(cos).or(moves, end_sin[end]);
    ends[end] = tan.or(moves, ends[end]);
    part
}

/// ∫ cos²φ dφ and ∫ sinφ cosφ dφ between the ends.
#[inline(always)]
pub(super) fn diffuse<L: DoubleLanes>(end_cos: &[L; 2], end_sin: &[L; 2], ends: &[L; 2]) -> [L; 2] {
    let (from, to) = (end_sin[0].fma(end_cos[0], atan(ends[0])), end_sin[1].fma(end_cos[1], atan(ends[1])));
    let along = to.sub(from).mul(L::splat(0.5));
    let skew = end_sin[1].mul(end_sin[1]).sub(end_sin[0].mul(end_sin[0])).mul(L::splat(0.5));
    [along, skew]
}

/// The part of ∂S along the change `v` of the normal that comes from the cut's motion: the integrand there, per unit of
/// the arc's scale.
#[inline(always)]
pub(super) fn cut_moves<L: DoubleLanes>(
    point: &Point,
    ggx: bool,
    [sin, cos]: [L; 2],
    v: [f64; 3],
    ends: &[L; 2],
    end_cos: &[L; 2],
    part: L::Mask,
) -> L {
    let (zero, one, along) = (L::splat(0.0), L::splat(1.0), point.n[1]);
    if along.abs() < 1e-300 {
        return zero;
    }
    let end = usize::from(along < 0.0);
    let (t, q) = (ends[end], end_cos[end]);
    // The tube's own ends do not move: n·l is not zero there.
    let facing = flat(point.n, sin, cos).fma(q, L::splat(along).mul(t).mul(q));
    let still = L::splat(1e-9).less(facing.max(zero.sub(facing)));
    let e = one.add(q.mul(flat(point.c, sin, cos).add(t.mul(L::splat(point.c[1])))));
    let sec2 = e.mul(L::splat(2.0 / (point.b * point.b))).max(one);
    let over = L::splat(1.0 / (point.m * point.m));
    let u = sec2.sub(one).mul(over);
    let kernel = if ggx {
        let k = u.add(one).recip();
        k.mul(k)
    } else {
        zero.sub(u).max(L::splat(-690.0)).exp()
    };
    let value = kernel.mul(sec2).mul(sec2).mul(over).mul(L::splat(1.0 / PI)).mul(q).mul(q).mul(q);
    let sign = if end == 0 { -1.0 } else { 1.0 };
    let factor = value.mul(L::splat(sign / (2.0 * point.b) / -along));
    let moved = factor.mul(flat(v, sin, cos).add(t.mul(L::splat(v[1]))));
    zero.or(still, moved).or(part, zero)
}
