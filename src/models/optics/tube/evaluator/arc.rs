//! One thin tube's integrand at a node, several frames at a time.
//!
//! These are free functions instead of closures: only `#[inline(always)]` functions carry the intrinsics into the
//! caller that was compiled for them.

use mesophyll_base::lanes::DoubleLanes;

/// Running sums over nodes.
#[derive(Clone, Copy)]
pub(super) struct Sums<L> {
    pub value: L,
    pub value_m: L,
    pub x: [L; 3],
    /// `masked` is Σ of the masked value where the light's side masks, over n·l at t = 0. `facing` is the same for the
    /// viewer's side.
    pub masked: L,
    pub facing: L,
}

/// The polynomials of one arc in t.
#[derive(Clone, Copy)]
pub(super) struct Arc<L> {
    pub e: [L; 3],
    pub m: [L; 3],
    pub q: [L; 3],
    pub over: L,
    /// n² − 1 where Fresnel's reflectance of index n multiplies the lobe, otherwise 0.
    pub fresnel: f64,
}

#[inline(always)]
pub(super) fn poly<L: DoubleLanes>(p: &[L; 3], even: bool, t: L, t2: L) -> L {
    let high = p[2].fma(t2, p[0]);
    if even { high } else { p[1].fma(t, high) }
}

/// v · (sin, ·, cos) for the part of v in the plane of travel.
#[inline(always)]
pub(super) fn flat<L: DoubleLanes>(v: [f64; 3], sin: L, cos: L) -> L {
    L::splat(v[0]).fma(sin, L::splat(v[2]).mul(cos))
}

/// The point of the tube in the direction (cos, sin), or the nearest end of the tube.
#[inline(always)]
pub(super) fn clamp<L: DoubleLanes>(cp: L, sp: L, ends: &[L; 2], end_cos: &[L; 2], end_sin: &[L; 2]) -> (L, L) {
    let behind = cp.less(L::splat(1e-6));
    let side = L::splat(0.0).less(sp);
    let below = sp.less(ends[0].mul(cp));
    let above = ends[1].mul(cp).less(sp);
    let cos = end_cos[1].or(above, end_cos[0].or(below, cp));
    let sin = end_sin[1].or(above, end_sin[0].or(below, sp));
    (end_cos[1].or(side, end_cos[0]).or(behind, cos), end_sin[1].or(side, end_sin[0]).or(behind, sin))
}

/// Tangent of half the angle from (cp, sp) to an end.
#[inline(always)]
pub(super) fn limit<L: DoubleLanes>(cp: L, sp: L, end_cos: L, end_sin: L) -> L {
    end_sin.mul(cp).sub(end_cos.mul(sp)).div(L::splat(1.0).add(end_cos.mul(cp)).add(end_sin.mul(sp)))
}

/// tan of half an angle, x (15 − x²)/(15 − 6 x²). It is unlimited beyond 1.4 rad, and where `bounded` is not set.
#[inline(always)]
pub(super) fn half_tan<L: DoubleLanes>(angle: L, bounded: L::Mask) -> L {
    let s = L::splat;
    let x = angle.mul(s(0.5));
    let x2 = x.mul(x);
    let below = s(15.0).sub(s(6.0).mul(x2));
    let near = L::both(s(3.0).less(below), bounded);
    x.mul(s(15.0).sub(x2)).div(below.max(s(1e-9))).or(near, s(1e9))
}

impl<L: DoubleLanes> Arc<L> {
    /// Adds the integrand at `t` times `weight`. `even` says that the odd coefficients are zero.
    #[inline(always)]
    pub fn node(&self, ggx: bool, even: bool, t: L, weight: L, sums: &mut Sums<L>) {
        let (one, two) = (L::splat(1.0), L::splat(2.0));
        let t2 = t.mul(t);
        let (e, m, q) = (poly(&self.e, even, t, t2), poly(&self.m, even, t, t2), poly(&self.q, even, t, t2));
        let inverse = m.mul(m).recip();
        let ei = e.mul(inverse);
        let sec2 = two.mul(ei).mul(t2.add(one));
        let tau = sec2.sub(one);
        let u = tau.mul(self.over);
        let mut shape = ei.mul(ei).mul(q).mul(weight);
        if self.fresnel > 0.0 {
            shape = shape.mul(self.reflectance(e, t2));
        }
        let (value, fall) = if ggx {
            let k = u.add(one).recip();
            (shape.mul(k).mul(k), two.mul(self.over).mul(k))
        } else {
            (shape.mul(L::splat(0.0).sub(u).exp()), self.over)
        };
        let lean = two.mul(sec2).fma(fall, L::splat(-4.0));
        let x = value.mul(lean).mul(m).mul(inverse);
        sums.value = sums.value.add(value);
        sums.value_m = value.mul(fall).fma(tau, sums.value_m);
        sums.x[0] = sums.x[0].add(x);
        if !even {
            sums.x[1] = x.fma(t, sums.x[1]);
        }
        sums.x[2] = x.fma(t2, sums.x[2]);
    }

    /// Fresnel's reflectance for unpolarised light at cos² = E/2, `e` = E (1 + t²).
    #[inline(always)]
    fn reflectance(&self, e: L, t2: L) -> L {
        let one = L::splat(1.0);
        let cos2 = L::splat(0.5).mul(e).mul(t2.add(one).recip()).max(L::splat(0.0)).min(one);
        let (c, g) = (cos2.sqrt(), cos2.add(L::splat(self.fresnel)).sqrt());
        let (d, s) = (g.sub(c), g.add(c));
        let (r, t) = (d.div(s), c.mul(s).sub(one).div(c.mul(d).add(one)));
        L::splat(0.5).mul(r).mul(r).mul(t.fma(t, one))
    }

    /// What masking takes away at `t` of a symmetric arc: the integrand times G − 1, where the smallest branch of G is
    /// the light's (`light`: 2 (n·l) M/E) or the viewer's (2 (n·c) M/E). `a` = n·l at t = 0, `b` = n·c.
    #[inline(always)]
    pub fn shadow(&self, light: bool, a: L, b: L, t: L, weight: L, sums: &mut Sums<L>) {
        let (zero, one, two) = (L::splat(0.0), L::splat(1.0), L::splat(2.0));
        let t2 = t.mul(t);
        let (e, m, q) = (poly(&self.e, true, t, t2), poly(&self.m, true, t, t2), poly(&self.q, true, t, t2));
        let inverse = m.mul(m).recip();
        let ei = e.mul(inverse);
        let sec2 = two.mul(ei).mul(t2.add(one));
        let tau = sec2.sub(one);
        let shape = ei.mul(ei).mul(q).mul(weight).mul(self.reflectance(e, t2));
        let value = shape.mul(zero.sub(tau.mul(self.over)).exp());
        let cos = if light { a.mul(one.sub(t2)).mul(t2.add(one).recip()) } else { b };
        let seen = value.mul(two.mul(cos).mul(m).div(e));
        let net = seen.sub(value);
        let lean = two.mul(sec2).fma(self.over, L::splat(-4.0));
        // G grows with M, and with n·l or n·c.
        let x = net.fma(lean, seen).mul(m).mul(inverse);
        sums.value = sums.value.add(net);
        sums.value_m = net.mul(self.over).fma(tau, sums.value_m);
        sums.x[0] = sums.x[0].add(x);
        sums.x[2] = x.fma(t2, sums.x[2]);
        if light {
            sums.masked = sums.masked.add(seen.div(a));
        } else {
            sums.facing = sums.facing.add(seen);
        }
    }
}
