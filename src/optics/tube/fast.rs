//! The tube integral for all frames of a pass at once, vectorised over frames: the same formulas as [`super::arc`], the same
//! node sets, without its trigonometry. [`super::Model`] is the reference it is tested against. Frames that the texel's horizon cuts
//! get ends of their own for every node across the radius. Cook–Torrance, whose G has kinks to split at, is left to the reference.

#![allow(clippy::needless_range_loop)] // see the note on closures below

use super::lanes::{Lanes, Level, PAD, padded};
use super::quadrature::gauss_legendre;
use super::{Model, Travel};
use crate::dispatch_lanes;
use crate::optics::gloss::{Lobe, dot};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_8, PI};

/// What a pass shows of one texel for one normal and slope: columns of D, S, ∂S/∂m, then ∂D and ∂S along one or two changes of
/// the normal. Padded with zeros to whole vectors.
pub const COLUMNS: usize = 7;

/// Positions of the tube over one texel, a column each, padded.
#[derive(Debug, Clone, Default)]
pub struct Lit {
    texel: [f64; 2],
    /// sin θ, cos θ; tangents, sines and cosines of the ends; asin(radius/distance); height/distance · (β/sin β).
    sin: Vec<f64>,
    cos: Vec<f64>,
    ends: [Vec<f64>; 2],
    end_sin: [Vec<f64>; 2],
    end_cos: [Vec<f64>; 2],
    beta: Vec<f64>,
    scale: Vec<f64>,
    /// D = n · (along · sin θ, skew, along · cos θ).
    along: Vec<f64>,
    skew: Vec<f64>,
}

/// A pass of a device, ready for many texels.
#[derive(Debug, Clone)]
pub struct Pass {
    model: Model,
    travel: Travel,
    positions: Vec<f64>,
    level: Level,
    /// Nodes across the radius, by count.
    across: Vec<Vec<(f64, f64)>>,
    nodes: Nodes,
}

/// Node tables; bell nodes are whole numbers, Gauss nodes lie in [−1, 1].
#[derive(Debug, Clone)]
struct Nodes {
    bell: Vec<(f64, f64)>,
    half_bell: Vec<(f64, f64)>,
    /// Gauss–Legendre on [−1, 1] and on [0, 1], by order up to `along` a half.
    gauss: Vec<Vec<(f64, f64)>>,
    half_gauss: Vec<Vec<(f64, f64)>>,
    along: f64,
    step: f64,
    reach: f64,
}

/// Normal, its changes and the slope, in the pass's frame.
#[derive(Debug, Clone, Copy)]
struct Point {
    n: [f64; 3],
    change: [[f64; 3]; 2],
    changes: usize,
    c: [f64; 3],
    b: f64,
    m: f64,
}

/// Order `n` on [0, 1], weights for half of that.
fn halved(n: usize) -> Vec<(f64, f64)> {
    gauss_legendre(n.max(1)).into_iter().map(|(x, w)| (0.5 * (1.0 + x), w)).collect()
}

impl Nodes {
    /// Nodes for a stretch of so many widths e^(−x²) (3 + 1.6 L hold 2e-6 of a bell; three more for what is not one).
    #[inline(always)]
    fn over(&self, widths: f64) -> &[(f64, f64)] {
        let n = ((5.0 + 1.6 * widths) * self.along / 8.0 + 1.5) as usize;
        &self.gauss[n.clamp(2, self.gauss.len() - 1)]
    }
    /// The same where the bell's top is at the stretch's lower end.
    #[inline(always)]
    fn over_half(&self, widths: f64) -> &[(f64, f64)] {
        let n = ((3.5 + 1.5 * widths) * self.along / 8.0 + 1.5) as usize;
        &self.half_gauss[n.clamp(2, self.half_gauss.len() - 1)]
    }
}

impl Pass {
    pub fn new(model: &Model, travel: Travel, positions_mm: &[f64], along: usize, level: Level) -> Pass {
        let rule = super::arc::Rule::new(along);
        let full = |k: i32| (f64::from(k), 1.0);
        let half = |k: i32| (f64::from(k), if k == 0 { 1.0 } else { 2.0 });
        let radius = model.tube.radius_mm;
        Pass {
            model: model.clone(),
            travel,
            positions: positions_mm.to_vec(),
            level,
            across: (0..=8).map(|k| if radius > 0.0 { gauss_legendre(k.max(1)) } else { gauss_legendre(1) }).collect(),
            nodes: Nodes {
                bell: (-rule.bell..=rule.bell).map(full).collect(),
                half_bell: (0..=rule.bell).map(half).collect(),
                gauss: (0..=2 * along.max(1)).map(|n| gauss_legendre(n.max(1))).collect(),
                half_gauss: (0..=along.max(1)).map(halved).collect(),
                along: along.max(1) as f64,
                step: rule.step,
                reach: rule.step * f64::from(rule.bell + 1),
            },
        }
    }

    pub fn frames(&self) -> usize {
        self.positions.len()
    }

    /// Length of the columns.
    pub fn padded(&self) -> usize {
        padded(self.positions.len())
    }

    pub fn positions(&self) -> &[f64] {
        &self.positions
    }

    /// Looks at the tube from `texel_mm`.
    pub fn light(&self, texel_mm: [f64; 2], lit: &mut Lit) {
        let n = self.padded();
        if lit.sin.len() == n && lit.texel == texel_mm {
            return;
        }
        lit.texel = texel_mm;
        for list in [&mut lit.sin, &mut lit.cos, &mut lit.beta, &mut lit.scale, &mut lit.along, &mut lit.skew] {
            list.resize(n, 0.0);
        }
        for list in lit.ends.iter_mut().chain(&mut lit.end_sin).chain(&mut lit.end_cos) {
            list.resize(n, 0.0);
        }
        let pass = self;
        dispatch_lanes!(self.level, light(pass: &Pass, texel_mm: [f64; 2], lit: &mut Lit));
    }

    /// Nodes across the radius for slope `m`: the mean of a bell of width σ over ±β needs few where β/σ is small.
    fn across(&self, m: f64) -> &[(f64, f64)] {
        let camera = self.travel.local(self.model.camera);
        // A lobe's width across the tube is about √2 m; the tube is widest where it is nearest.
        let near = if self.travel == Travel::X { camera[2].max(0.3) } else { 1.0 };
        // A long tail has a sharper top.
        let sharp = if self.model.lobe == Lobe::Ggx { 2.0 } else { 1.2 };
        let x = sharp * near * self.model.tube.radius_mm / self.model.tube.height_mm / (std::f64::consts::SQRT_2 * m);
        let count = match x {
            x if x < 1e-4 => 1,
            x if x < 0.15 => 2,
            x if x < 0.47 => 3,
            x if x < 0.85 => 4,
            x if x < 1.3 => 5,
            x if x < 1.8 => 6,
            _ => 8,
        };
        &self.across[count]
    }

    /// Fills `columns` (each at least [`Pass::padded`] long) for a unit normal `n`, its changes (none to two) and slope `m`.
    pub fn respond(&self, lit: &mut Lit, n: [f64; 3], changes: &[[f64; 3]], m: f64, columns: &mut [&mut [f64]; COLUMNS]) {
        let local = |v: &[f64; 3]| self.travel.local(*v);
        let point = Point {
            n: local(&n),
            change: std::array::from_fn(|k| changes.get(k).map_or([0.0; 3], local)),
            changes: changes.len().min(2),
            c: local(&self.model.camera),
            b: dot(n, self.model.camera),
            m,
        };
        if point.b <= 0.0 {
            for column in columns.iter_mut() {
                column[..self.padded()].fill(0.0);
            }
            return;
        }
        if !matches!(self.model.lobe, Lobe::CookTorrance { .. }) {
            let (pass, point, across) = (self, &point, self.across(m));
            let symmetric = point.n[1] == 0.0 && point.c[1] == 0.0 && point.change.iter().all(|v| v[1] == 0.0);
            dispatch_lanes!(self.level, respond(pass: &Pass, lit: &Lit, point: &Point, across: &[(f64, f64)], symmetric: bool, columns: &mut [&mut [f64]; COLUMNS]));
        } else {
            for (k, &light) in self.positions.iter().enumerate() {
                let r = self.model.response(self.travel, light, lit.texel, n, m);
                (columns[0][k], columns[1][k], columns[2][k]) = (r.d, r.s, r.s_m);
                for (j, change) in changes.iter().enumerate().take(2) {
                    (columns[3 + 2 * j][k], columns[4 + 2 * j][k]) = (dot(r.d_n, *change), dot(r.s_n, *change));
                }
            }
        }
        for column in columns.iter_mut() {
            column[self.positions.len()..self.padded()].fill(0.0);
        }
    }
}

#[inline(always)]
fn light<L: Lanes>(pass: &Pass, texel_mm: [f64; 2], lit: &mut Lit) {
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
        // (2/π) · ½ · height/distance; across the radius the mean of the direction is sin β/β long, which `scale` holds inverted
        let factor = cos.mul(L::splat(1.0 / PI));
        factor.mul(along).store(&mut lit.along[k..]);
        factor.mul(asin).mul(skew).store(&mut lit.skew[k..]);
    }
}

/// atan to 1e-12: twice reduced, to |y| ≤ tan(π/8), then its series.
#[inline(always)]
fn atan<L: Lanes>(x: L) -> L {
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

/// Running sums over nodes.
#[derive(Clone, Copy)]
struct Sums<L> {
    value: L,
    value_m: L,
    x: [L; 3],
}

/// The polynomials of one arc in t.
#[derive(Clone, Copy)]
struct Arc<L> {
    e: [L; 3],
    m: [L; 3],
    q: [L; 3],
    over: L,
}

// Free functions instead of closures from here on: only `#[inline(always)]` takes the intrinsics along into the caller that was
// compiled for them.

#[inline(always)]
fn poly<L: Lanes>(p: &[L; 3], even: bool, t: L, t2: L) -> L {
    let high = p[2].fma(t2, p[0]);
    if even { high } else { p[1].fma(t, high) }
}

/// v · (sin, ·, cos) for the part of v in the plane of travel.
#[inline(always)]
fn flat<L: Lanes>(v: [f64; 3], sin: L, cos: L) -> L {
    L::splat(v[0]).fma(sin, L::splat(v[2]).mul(cos))
}

/// The point of the tube in direction (cos, sin), or the end that lies nearest.
#[inline(always)]
fn clamp<L: Lanes>(cp: L, sp: L, ends: &[L; 2], end_cos: &[L; 2], end_sin: &[L; 2]) -> (L, L) {
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
fn limit<L: Lanes>(cp: L, sp: L, end_cos: L, end_sin: L) -> L {
    end_sin.mul(cp).sub(end_cos.mul(sp)).div(L::splat(1.0).add(end_cos.mul(cp)).add(end_sin.mul(sp)))
}

/// tan of half an angle, x (15 − x²)/(15 − 6 x²); unlimited beyond 1.4 rad, or where `bounded` is not set.
#[inline(always)]
fn half_tan<L: Lanes>(angle: L, bounded: L::Mask) -> L {
    let s = L::splat;
    let x = angle.mul(s(0.5));
    let x2 = x.mul(x);
    let below = s(15.0).sub(s(6.0).mul(x2));
    let near = L::both(s(3.0).less(below), bounded);
    x.mul(s(15.0).sub(x2)).div(below.max(s(1e-9))).or(near, s(1e9))
}

/// Moves the end that the horizon hides to where it cuts the arc, in the lanes of `cut`; the lanes of these that see anything.
#[inline(always)]
fn above<L: Lanes>(point: &Point, a1: L, ends: &mut [L; 2], end_cos: &mut [L; 2], end_sin: &mut [L; 2], cut: L::Mask) -> L::Mask {
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
fn diffuse<L: Lanes>(end_cos: &[L; 2], end_sin: &[L; 2], ends: &[L; 2]) -> [L; 2] {
    let (from, to) = (end_sin[0].fma(end_cos[0], atan(ends[0])), end_sin[1].fma(end_cos[1], atan(ends[1])));
    let along = to.sub(from).mul(L::splat(0.5));
    let skew = end_sin[1].mul(end_sin[1]).sub(end_sin[0].mul(end_sin[0])).mul(L::splat(0.5));
    [along, skew]
}

/// ∂S along the change `v` of the normal from the cut's own motion: the integrand there, per unit of the arc's scale.
#[inline(always)]
fn cut_moves<L: Lanes>(point: &Point, ggx: bool, [sin, cos]: [L; 2], v: [f64; 3], ends: &[L; 2], end_cos: &[L; 2], part: L::Mask) -> L {
    let (zero, one, along) = (L::splat(0.0), L::splat(1.0), point.n[1]);
    if along.abs() < 1e-300 {
        return zero;
    }
    let end = usize::from(along < 0.0);
    let (t, q) = (ends[end], end_cos[end]);
    // An end that is the tube's own does not move: n·l is not zero there.
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

impl<L: Lanes> Arc<L> {
    /// Adds the integrand at `t` times `weight`; `even`: the odd coefficients are zero.
    #[inline(always)]
    fn node(&self, ggx: bool, even: bool, t: L, weight: L, sums: &mut Sums<L>) {
        let (one, two) = (L::splat(1.0), L::splat(2.0));
        let t2 = t.mul(t);
        let (e, m, q) = (poly(&self.e, even, t, t2), poly(&self.m, even, t, t2), poly(&self.q, even, t, t2));
        let inverse = m.mul(m).recip();
        let ei = e.mul(inverse);
        let sec2 = two.mul(ei).mul(t2.add(one));
        let tau = sec2.sub(one);
        let u = tau.mul(self.over);
        let shape = ei.mul(ei).mul(q).mul(weight);
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
}

#[inline(always)]
fn respond<L: Lanes>(pass: &Pass, lit: &Lit, point: &Point, across: &[(f64, f64)], symmetric: bool, columns: &mut [&mut [f64]; COLUMNS]) {
    let ggx = pass.model.lobe == Lobe::Ggx;
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
        // The least and greatest cosine along the tube decide between lit, dark and cut.
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
                    for (column, v) in [(0, n), (3, point.change[0]), (5, point.change[1])].into_iter().take(1 + point.changes) {
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
                    let (e, m) = (one.add(c1.mul(cp)).add(s(c[1]).mul(sp)), s(point.b).add(a1.mul(cp)).add(s(n[1]).mul(sp)));
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
                        // Far from the least tan²α the window's parabola misleads: one more step, where it can be told.
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
                        (cp, sp) = clamp(cp.mul(ch).sub(sp.mul(sh)), sp.mul(ch).add(cp.mul(sh)), &ends, &end_cos, &end_sin);
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
                };
                let mut sums = Sums { value: zero, value_m: zero, x: [zero; 3] };
                if ggx {
                    let w = s(m2).add(tau).div(bend).sqrt().mul(s(0.5));
                    let skew = to.add(from);
                    let even = symmetric && L::all(skew.max(zero.sub(skew)).less(s(1e-12)));
                    long_tail(&pass.nodes, &arc, w, from, to, even, &mut sums);
                } else {
                    let frame = Frame { from, to, slope, bend, falling, symmetric, m: point.m };
                    bell(&pass.nodes, &arc, &frame, &mut sums);
                }
                let factor = L::load(&lit.scale[k..]).mul(s(prefactor * 0.5 * weight)).or(worth, zero);
                let value = sums.value;
                total = factor.mul(value).or(worth, zero).add(total);
                total_m = factor.mul(s(2.0 / point.m)).mul(sums.value_m.sub(value)).or(worth, zero).add(total_m);
                for j in 0..point.changes {
                    let v = point.change[j];
                    let (v1, vc) = (flat(v, sj, cj), s(dot(v, c)));
                    let (p1v, p2v) = (v1.mul(cp).add(s(v[1]).mul(sp)), s(v[1]).mul(cp).sub(v1.mul(sp)));
                    let turned = p1v.mul(sums.x[0].sub(sums.x[2])).add(p2v.mul(sums.x[1].add(sums.x[1])));
                    let camera = vc.mul(sums.x[0].add(sums.x[2]).sub(value.mul(s(1.0 / point.b))));
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

/// What the choice of nodes looks at.
struct Frame<L: Lanes> {
    from: L,
    to: L,
    slope: L,
    bend: L,
    falling: L::Mask,
    symmetric: bool,
    m: f64,
}

/// Beckmann: the trapezoid where the bell fits between the ends, Gauss nodes on what is left of it elsewhere.
#[inline(always)]
fn bell<L: Lanes>(nodes: &Nodes, arc: &Arc<L>, frame: &Frame<L>, sums: &mut Sums<L>) {
    let s = L::splat;
    let zero = s(0.0);
    let root = frame.bend.sqrt();
    let width = s(0.5 * frame.m).div(root);
    let reach = width.mul(s(nodes.reach));
    let steep = frame.slope.max(zero.sub(frame.slope));
    let fits = L::both(frame.from.less(zero.sub(reach)), reach.less(frame.to));
    let fits = L::both(L::both(fits, frame.falling), steep.less(s(0.5 * frame.m).mul(root)));
    let step = width.mul(s(nodes.step));
    if L::all(fits) {
        if frame.symmetric {
            for &(x, w) in &nodes.half_bell {
                arc.node(false, true, step.mul(s(x)), step.mul(s(w)), sums);
            }
        } else {
            for &(x, w) in &nodes.bell {
                arc.node(false, false, step.mul(s(x)), step.mul(s(w)), sums);
            }
        }
        return;
    }
    // Window: slope·φ + bend·φ² = (4.2 m)² on either side, in t see `half_tan`.
    let far = 4.2 * 4.2 * frame.m * frame.m;
    let root = frame.slope.fma(frame.slope, frame.bend.mul(s(4.0 * far))).sqrt();
    let lo = frame.from.max(zero.sub(half_tan(s(2.0 * far).div(root.sub(frame.slope)), frame.falling)));
    let hi = frame.to.min(half_tan(s(2.0 * far).div(root.add(frame.slope)), frame.falling));
    if frame.symmetric {
        // Even in t: the two halves, or one of them twice.
        let equal = hi.add(lo).max(zero.sub(hi.add(lo))).less(s(1e-12));
        let both = L::all(equal);
        let ends = [hi, zero.sub(lo)];
        for side in 0..if both { 1 } else { 2 } {
            let (end, half) = (ends[side], ends[side].mul(s(if both { 1.0 } else { 0.5 })));
            for &(x, w) in nodes.over_half(end.div(width).most()) {
                arc.node(false, true, end.mul(s(x)), half.mul(s(w)), sums);
            }
        }
        return;
    }
    let (mid, half) = (lo.add(hi).mul(s(0.5)), hi.sub(lo).mul(s(0.5)));
    let gauss = nodes.over(zero.or(fits, half.add(half).div(width)).most());
    if !L::any(fits) {
        for &(x, w) in gauss {
            arc.node(false, false, half.fma(s(x), mid), half.mul(s(w)), sums);
        }
        return;
    }
    // Some lanes take one rule, some the other: walk both tables side by side.
    let (mid, half) = (zero.or(fits, mid), step.or(fits, half));
    for k in 0..gauss.len().max(nodes.bell.len()) {
        let b = if k < nodes.bell.len() { nodes.bell[k] } else { (0.0, 0.0) };
        let g = if k < gauss.len() { gauss[k] } else { (0.0, 0.0) };
        let (x, w) = (s(b.0).or(fits, s(g.0)), s(b.1).or(fits, s(g.1)));
        arc.node(false, false, half.fma(x, mid), half.mul(w), sums);
    }
}

/// GGX: t = w·2y/(1 − y²) takes the Lorentzian's tail, Gauss nodes in y; the poles of the integrand are at ±i. `even`: only the
/// half [0, y] of a symmetric range, twice.
#[inline(always)]
fn long_tail<L: Lanes>(nodes: &Nodes, arc: &Arc<L>, w: L, from: L, to: L, even: bool, sums: &mut Sums<L>) {
    let s = L::splat;
    let one = s(1.0);
    let (lo, hi) = (from.div(w.add(w.fma(w, from.mul(from)).sqrt())), to.div(w.add(w.fma(w, to.mul(to)).sqrt())));
    let (mid, half) = if even { (s(0.0), hi) } else { (lo.add(hi).mul(s(0.5)), hi.sub(lo).mul(s(0.5))) };
    let w2 = w.add(w);
    // As a stretch of a bell of seven widths from −1 to 1.
    let list = if even { nodes.over_half(4.0 * half.most()) } else { nodes.over(8.0 * half.most()) };
    for &(x, weight) in list {
        let y = half.fma(s(x), mid);
        let y2 = y.mul(y);
        let inverse = one.sub(y2).recip();
        let t = w2.mul(y).mul(inverse);
        let dt = w2.mul(one.add(y2)).mul(inverse).mul(inverse);
        arc.node(true, even, t, half.mul(s(weight)).mul(dt), sums);
    }
}
