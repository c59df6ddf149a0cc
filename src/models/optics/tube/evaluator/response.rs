//! The diffuse response D, the glossy response S and their derivatives for all frames of a pass: the loop over frames
//! and over the tube's radius.

#![allow(clippy::needless_range_loop)] // Loops by index: closures would not take the intrinsics along.

use super::arc::{Arc, Sums, clamp, flat, limit};
use super::horizon::{above, cut_moves, diffuse};
use super::rules::{Frame, bell, long_tail, shadows};
use super::{COLUMNS, PassEvaluator, Point, TubeGeometry};
use crate::gloss::dot;
use mesophyll_base::lanes::DoubleLanes;
use std::f64::consts::PI;

/// Fills the columns of all frames.
#[inline(always)]
pub(super) fn respond<L: DoubleLanes>(
    pass: &PassEvaluator,
    lit: &TubeGeometry,
    point: &Point,
    across: &[(f64, f64)],
    symmetric: bool,
    columns: &mut [&mut [f64]; COLUMNS],
) {
    let ggx = pass.model.lobe.is_long_tailed();
    let fresnel = pass.model.lobe.index().map_or(0.0, |index| index * index - 1.0);
    let s = L::splat;
    let (zero, one) = (s(0.0), s(1.0));
    let (n, c) = (point.n, point.c);
    let m2 = point.m * point.m;
    let over = s(1.0 / m2);
    let prefactor = 8.0 / (2.0 * point.b * PI * m2);
    // Where the horizon cuts, D is summed over the nodes too.
    let rough: &[(f64, f64)] = if across.len() < 3 { &pass.across[3] } else { across };
    for k in (0..lit.sin.len()).step_by(L::N) {
        let (sin, cos, beta) = (L::load(&lit.sin[k..]), L::load(&lit.cos[k..]), L::load(&lit.beta[k..]));
        let ends = [L::load(&lit.ends[0][k..]), L::load(&lit.ends[1][k..])];
        let a = s(n[0]).mul(sin).add(s(n[2]).mul(cos));
        // The smallest and largest cosine along the tube decide whether a frame is lit, dark or cut by the horizon.
        let (low, high) = (ends[0].mul(s(n[1])), ends[1].mul(s(n[1])));
        let (low, high) = (a.add(low.min(high)), a.add(low.max(high)));
        let bright = beta.less(low);
        let dark = high.less(zero.sub(beta));
        let cut = zero.less(zero.or(bright, zero.or(dark, one)));
        let horizon = L::any(cut);
        // D and its changes
        let (along, skew) = (L::load(&lit.along[k..]), L::load(&lit.skew[k..]));
        along.mul(flat(n, sin, cos)).add(skew.mul(s(n[1]))).or(bright, zero).store(&mut columns[0][k..]);
        for j in 0..point.changes {
            let v = point.change[j];
            along.mul(flat(v, sin, cos)).add(skew.mul(s(v[1]))).or(bright, zero).store(&mut columns[3 + 2 * j][k..]);
        }
        let end_cos = [L::load(&lit.end_cos[0][k..]), L::load(&lit.end_cos[1][k..])];
        let end_sin = [L::load(&lit.end_sin[0][k..]), L::load(&lit.end_sin[1][k..])];
        let mut total = zero;
        let mut total_m = zero;
        let mut total_n = [zero; 2];
        if horizon || L::any(bright) {
            for &(node, weight) in if horizon { rough } else { across } {
                // Direction turned by δ = β·node within the plane of travel.
                let d = beta.mul(s(node));
                let d2 = d.mul(d);
                let cd = d2.fma(s(-1.0 / 720.0), s(1.0 / 24.0)).fma(d2, s(-0.5)).fma(d2, one);
                let sd = d2.fma(s(-1.0 / 5040.0), s(1.0 / 120.0)).fma(d2, s(-1.0 / 6.0)).fma(d2, one).mul(d);
                let (sj, cj) = (sin.mul(cd).add(cos.mul(sd)), cos.mul(cd).sub(sin.mul(sd)));
                let (a1, c1) = (flat(n, sj, cj), flat(c, sj, cj));
                let (mut ends, mut end_cos, mut end_sin, mut seen) = (ends, end_cos, end_sin, bright);
                if horizon {
                    let share = L::load(&lit.scale[k..]).mul(s(0.5 * weight));
                    let part = above(point, a1, &mut ends, &mut end_cos, &mut end_sin, cut);
                    let sums = diffuse(&end_cos, &end_sin, &ends);
                    for (column, v) in
                        [(0, n), (3, point.change[0]), (5, point.change[1])].into_iter().take(1 + point.changes)
                    {
                        let d = share.mul(s(2.0 / PI)).mul(sums[0].mul(flat(v, sj, cj)).add(sums[1].mul(s(v[1]))));
                        L::load(&columns[column][k..]).add(d.or(part, zero)).store(&mut columns[column][k..]);
                    }
                    for j in 0..point.changes {
                        let moved = cut_moves(point, ggx, [sj, cj], point.change[j], &ends, &end_cos, part);
                        total_n[j] = moved.mul(share).or(part, zero).add(total_n[j]);
                    }
                    seen = zero.less(one.or(bright, one.or(part, zero)));
                }
                let (mut cp, mut sp) = (one, zero);
                if !symmetric {
                    let r1 = s(2.0 * point.b).mul(a1).sub(c1);
                    let r2 = s(2.0 * point.b * n[1] - c[1]);
                    let length = one.div(r1.fma(r1, r2.mul(r2)).max(s(1e-60)).sqrt());
                    (cp, sp) = clamp(r1.mul(length), r2.mul(length), &ends, &end_cos, &end_sin);
                }
                let (mut tau, mut slope, mut bend) = (zero, zero, one);
                let mut falling = seen;
                for step in 0..3 {
                    let (e, m) =
                        (one.add(c1.mul(cp)).add(s(c[1]).mul(sp)), s(point.b).add(a1.mul(cp)).add(s(n[1]).mul(sp)));
                    let (e1, m1) = (s(c[1]).mul(cp).sub(c1.mul(sp)), s(n[1]).mul(cp).sub(a1.mul(sp)));
                    let f = e1.mul(m).sub(s(2.0).mul(e).mul(m1));
                    let f1 = s(2.0).mul(e).mul(m.sub(s(point.b))).sub(e1.mul(m1)).sub(e.sub(one).mul(m));
                    if step > 0 {
                        let im = m.recip();
                        let im3 = im.mul(im).mul(im);
                        tau = s(2.0).mul(e).mul(im).mul(im).sub(one).max(zero);
                        slope = s(2.0).mul(f).mul(im3);
                        falling = zero.less(f1);
                        bend = f1.mul(im3).sub(s(1.5).mul(slope).mul(m1).mul(im)).max(s(1e-3));
                        // Where the range is far from the smallest tan²α, the parabola of the window is a poor guide.
                        // One more step is taken where this can be detected.
                        let off = s(0.25 * m2).mul(bend).less(slope.mul(slope));
                        if step == 2 || symmetric || !L::any(L::both(seen, off)) {
                            break;
                        }
                    }
                    if !symmetric {
                        let convex = zero.less(f1);
                        let newton = zero.sub(f).div(one.or(f1.less(s(1e-9)), f1));
                        let blind = s(-0.2).or(zero.less(f), s(0.2));
                        let h = newton.or(convex, blind).max(s(-0.5)).min(s(0.5)).mul(s(0.5));
                        let h2 = h.mul(h);
                        let k1 = h2.add(one).recip();
                        let (ch, sh) = (one.sub(h2).mul(k1), h.add(h).mul(k1));
                        (cp, sp) =
                            clamp(cp.mul(ch).sub(sp.mul(sh)), sp.mul(ch).add(cp.mul(sh)), &ends, &end_cos, &end_sin);
                    }
                }
                let worth = L::both(seen, if ggx { seen } else { tau.less(s(20.0 * m2)) });
                if !L::any(worth) {
                    continue;
                }
                let (from, to) = (limit(cp, sp, end_cos[0], end_sin[0]), limit(cp, sp, end_cos[1], end_sin[1]));
                let (p1n, p2n) = (a1.mul(cp).add(s(n[1]).mul(sp)), s(n[1]).mul(cp).sub(a1.mul(sp)));
                let (p1c, p2c) = (c1.mul(cp).add(s(c[1]).mul(sp)), s(c[1]).mul(cp).sub(c1.mul(sp)));
                let arc = Arc {
                    e: [one.add(p1c), p2c.add(p2c), one.sub(p1c)],
                    m: [s(point.b).add(p1n), p2n.add(p2n), s(point.b).sub(p1n)],
                    q: [cp, s(-2.0).mul(sp), zero.sub(cp)],
                    over,
                    fresnel,
                };
                let mut sums = Sums { value: zero, value_m: zero, x: [zero; 3], masked: zero, facing: zero };
                if ggx {
                    let w = s(m2).add(tau).div(bend).sqrt().mul(s(0.5));
                    let skew = to.add(from);
                    let even = symmetric && L::all(skew.max(zero.sub(skew)).less(s(1e-12)));
                    long_tail(&pass.nodes, &arc, w, from, to, even, &mut sums);
                } else {
                    let frame = Frame { from, to, slope, bend, falling, symmetric, m: point.m };
                    bell(&pass.nodes, &arc, &frame, &mut sums);
                    if fresnel > 0.0 {
                        shadows(&pass.nodes, &arc, &frame, [a1, s(point.b), c1], &mut sums);
                    }
                }
                let factor = L::load(&lit.scale[k..]).mul(s(prefactor * 0.5 * weight)).or(worth, zero);
                let value = sums.value;
                total = factor.mul(value).or(worth, zero).add(total);
                total_m = factor.mul(s(2.0 / point.m)).mul(sums.value_m.sub(value)).or(worth, zero).add(total_m);
                for j in 0..point.changes {
                    let v = point.change[j];
                    let (v1, vc) = (flat(v, sj, cj), s(dot(v, c)));
                    let (p1v, p2v) = (v1.mul(cp).add(s(v[1]).mul(sp)), s(v[1]).mul(cp).sub(v1.mul(sp)));
                    let turned =
                        p1v.mul(sums.x[0].sub(sums.x[2]).add(sums.masked)).add(p2v.mul(sums.x[1].add(sums.x[1])));
                    let camera = vc.mul(sums.x[0].add(sums.x[2]).add(sums.facing.sub(value).mul(s(1.0 / point.b))));
                    total_n[j] = factor.mul(turned.add(camera)).or(worth, zero).add(total_n[j]);
                }
            }
        }
        total.store(&mut columns[1][k..]);
        total_m.store(&mut columns[2][k..]);
        for j in 0..point.changes {
            total_n[j].store(&mut columns[4 + 2 * j][k..]);
        }
    }
}
