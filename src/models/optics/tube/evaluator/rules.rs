//! Where along the tube the integrand is evaluated. A lobe that lies between the tube's ends takes the trapezoid rule.
//! A lobe that an end cuts takes Gauss nodes. A lobe with a long tail takes a change of variable. Stretches that
//! masking darkens are integrated separately.

#![allow(clippy::needless_range_loop)] // Loops by index: closures would not take the intrinsics along.

use super::Nodes;
use super::arc::{Arc, Sums, half_tan};
use mesophyll_base::lanes::DoubleLanes;

/// The quantities that the choice of nodes depends on.
pub(super) struct Frame<L: DoubleLanes> {
    pub from: L,
    pub to: L,
    pub slope: L,
    pub bend: L,
    pub falling: L::Mask,
    pub symmetric: bool,
    pub m: f64,
}

/// Beckmann's lobe: the trapezoid rule where the bell fits between the ends, otherwise Gauss nodes on the part of it
/// that is left.
#[inline(always)]
pub(super) fn bell<L: DoubleLanes>(nodes: &Nodes, arc: &Arc<L>, frame: &Frame<L>, sums: &mut Sums<L>) {
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
        // If the integrand is even in t, one half is taken twice; otherwise both halves are.
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
    // Some lanes take one rule and some the other, so both tables are walked side by side.
    let (mid, half) = (zero.or(fits, mid), step.or(fits, half));
    for k in 0..gauss.len().max(nodes.bell.len()) {
        let b = if k < nodes.bell.len() { nodes.bell[k] } else { (0.0, 0.0) };
        let g = if k < gauss.len() { gauss[k] } else { (0.0, 0.0) };
        let (x, w) = (s(b.0).or(fits, s(g.0)), s(b.1).or(fits, s(g.1)));
        arc.node(false, false, half.fma(x, mid), half.mul(w), sums);
    }
}

/// GGX: t = w·2y/(1 − y²) takes in the tail of the Lorentzian; Gauss nodes are in y, where the integrand's poles are at
/// ±i. `even`: only the half [0, y] of a symmetric range is taken, twice.
#[inline(always)]
pub(super) fn long_tail<L: DoubleLanes>(
    nodes: &Nodes,
    arc: &Arc<L>,
    w: L,
    from: L,
    to: L,
    even: bool,
    sums: &mut Sums<L>,
) {
    let s = L::splat;
    let one = s(1.0);
    let (lo, hi) = (from.div(w.add(w.fma(w, from.mul(from)).sqrt())), to.div(w.add(w.fma(w, to.mul(to)).sqrt())));
    let (mid, half) = if even { (s(0.0), hi) } else { (lo.add(hi).mul(s(0.5)), hi.sub(lo).mul(s(0.5))) };
    let w2 = w.add(w);
    // As many nodes as for a bell whose stretch from −1 to 1 is eight widths long.
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

/// What the V-cavity's masking takes from a Cook–Torrance lobe over a symmetric arc. With x = cos ψ along the tube, a x
/// = n·l, M = b + a x and E = 1 + c x. The branches of G = min(1, 2 (n·l) M/E, 2 (n·c) M/E) meet where a x = b, where 2
/// a x M = E (a quadratic in x), and where 2 b M = E (linear). Between these places everything is smooth, and G − 1
/// goes to zero at the edges of masking. `abc` holds a, b, c.
#[inline(always)]
pub(super) fn shadows<L: DoubleLanes>(nodes: &Nodes, arc: &Arc<L>, frame: &Frame<L>, abc: [L; 3], sums: &mut Sums<L>) {
    let s = L::splat;
    let (zero, one, two) = (s(0.0), s(1.0), s(2.0));
    let [a, b, c] = abc;
    let width = s(0.5 * frame.m).div(frame.bend.sqrt());
    let reach = half_tan(s(4.2 * frame.m).div(frame.bend.sqrt()), frame.falling);
    let level = b.div(a.max(s(1e-12)));
    // 2 a² x² + (2 a b − c) x − 1 = 0 has one positive root; below it the light's side masks.
    let (p, h) = (two.mul(a).mul(a), two.mul(a).mul(b).sub(c));
    let root = h.fma(h, s(4.0).mul(p)).sqrt();
    let free = h.max(zero.sub(h)).add(root);
    let positive = zero.less(h);
    let free = two.div(free).or(positive, free.div(two.mul(p).max(s(1e-24))));
    let light = level.min(free);
    // The viewer's side masks where x (2 a b − c) < 1 − 2 b², as far as a x > b.
    let r = one.sub(two.mul(b).mul(b));
    let tiny = h.max(zero.sub(h)).less(s(1e-12));
    let edge = r.div(s(1e-12).or(tiny, h));
    let upward = zero.less(s(1e-12).or(tiny, h));
    let (low, high) = (level.or(upward, level.max(edge)), edge.min(one).or(upward, one));
    let spans = [(true, one, light), (false, high, low.min(high))];
    let sides = [frame.to.min(reach), zero.sub(frame.from).min(reach)];
    let apart = sides[0].sub(sides[1]);
    let equal = L::all(apart.max(zero.sub(apart)).less(s(1e-12)));
    for side in 0..if equal { 1 } else { 2 } {
        let end = sides[side].max(zero);
        for (by_light, high, low) in spans {
            // The light's side masks from its edge outwards, the viewer's side between two edges.
            let (from, to) =
                if by_light { (tangent(low).min(end), end) } else { (tangent(high).min(end), tangent(low).min(end)) };
            let (mid, half) = (to.add(from).mul(s(0.5)), to.sub(from).mul(s(0.5)).max(zero));
            let widths = half.add(half).div(width).most();
            if !(widths > 0.0) {
                continue;
            }
            let weight = half.mul(s(if equal { 2.0 } else { 1.0 }));
            for &(x, w) in nodes.over(widths) {
                arc.shadow(by_light, a, b, half.fma(s(x), mid), weight.mul(s(w)), sums);
            }
        }
    }
}

/// tan(ψ/2) for x = cos ψ; 0 beyond 1.
#[inline(always)]
fn tangent<L: DoubleLanes>(x: L) -> L {
    let one = L::splat(1.0);
    one.sub(x).max(L::splat(0.0)).div(one.add(x).max(L::splat(1e-12))).sqrt()
}
