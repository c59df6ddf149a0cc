//! The tube's position as a texel sees it, for all frames of a pass at once and without trigonometry. The diffuse
//! response D, which has a closed form, is here as well.

#![allow(clippy::needless_range_loop)] // Loops by index: closures would not take the intrinsics along.

use super::{PassEvaluator, TubeGeometry};
use mesophyll_base::lanes::{DoubleLanes, PAD};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_8, PI};

#[inline(always)]
pub(super) fn light<L: DoubleLanes>(pass: &PassEvaluator, texel_mm: [f64; 2], lit: &mut TubeGeometry) {
    let texel = pass.travel.local([texel_mm[0], texel_mm[1], 0.0]);
    let tube = pass.model.tube;
    let (h, one) = (L::splat(tube.height_mm), L::splat(1.0));
    let mut x = [0.0; PAD];
    for k in (0..lit.sin.len()).step_by(L::N) {
        for (j, slot) in x[..L::N].iter_mut().enumerate() {
            *slot = pass.positions.get(k + j).map_or(0.0, |p| p - texel[0]);
        }
        let x = L::load(&x);
        let near = one.div(x.fma(x, h.mul(h)).sqrt());
        let (sin, cos) = (x.mul(near), h.mul(near));
        sin.store(&mut lit.sin[k..]);
        cos.store(&mut lit.cos[k..]);
        // asin r = r (1 + r²/6 + 3 r⁴/40 + 15 r⁶/336 + …); r is small
        let r = near.mul(L::splat(tube.radius_mm));
        let r2 = r.mul(r);
        let series = [105.0 / 3456.0, 15.0 / 336.0, 3.0 / 40.0, 1.0 / 6.0, 1.0];
        let mut asin = L::splat(series[0]);
        for c in &series[1..] {
            asin = asin.fma(r2, L::splat(*c));
        }
        r.mul(asin).store(&mut lit.beta[k..]);
        cos.mul(asin).store(&mut lit.scale[k..]);
        let half = 0.5 * tube.length_mm;
        let mut along = L::splat(0.0);
        let mut skew = L::splat(0.0);
        for (end, at) in [-half - texel[1], half - texel[1]].into_iter().enumerate() {
            let t = near.mul(L::splat(at));
            let q = one.div(t.fma(t, one).sqrt());
            let s = t.mul(q);
            t.store(&mut lit.ends[end][k..]);
            q.store(&mut lit.end_cos[end][k..]);
            s.store(&mut lit.end_sin[end][k..]);
            let part = s.fma(q, atan(t));
            if end == 0 {
                (along, skew) = (L::splat(0.0).sub(part), L::splat(0.0).sub(s.mul(s)));
            } else {
                (along, skew) = (along.add(part), skew.add(s.mul(s)));
            }
        }
        // (2/π) · ½ · height/distance. Averaged across the radius, the direction vector has the length sin β/β; `scale`
        // holds the inverse of that.
        let factor = cos.mul(L::splat(1.0 / PI));
        factor.mul(along).store(&mut lit.along[k..]);
        factor.mul(asin).mul(skew).store(&mut lit.skew[k..]);
    }
}

/// atan to 1e-12: the argument is reduced twice, to |y| ≤ tan(π/8), and then the series is used.
#[inline(always)]
pub(super) fn atan<L: DoubleLanes>(x: L) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let a = x.max(zero.sub(x));
    let big = one.less(a);
    let z = one.div(a.max(L::splat(1e-300))).or(big, a);
    let c = L::splat(std::f64::consts::SQRT_2 - 1.0);
    let y = z.sub(c).div(z.fma(c, one));
    let y2 = y.mul(y);
    let mut p = L::splat(-1.0 / 27.0);
    for k in (0..13).rev() {
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        p = p.fma(y2, L::splat(sign / f64::from(2 * k + 1)));
    }
    let angle = y.fma(p, L::splat(FRAC_PI_8));
    let angle = L::splat(FRAC_PI_2).sub(angle).or(big, angle);
    zero.sub(angle).or(x.less(zero), angle)
}
