//! How a lobe spreads light over angles: the density of the new cosine, given the angle of the ray that is turned.
//!
//! A ray at θ′ is turned by an angle α with the density (ob + 1)/2π · cos^ob α. Up to a factor, ∫ max(0, cos θ cos θ′ +
//! sin θ sin θ′ cos φ)^ob dφ of its light comes to θ. Directions that leave the ray's side of the leaf's plane are
//! drawn again; so all light goes somewhere, which determines the factor. R and T do not depend on azimuth, so it is
//! integrated out here.

use super::grid::AngleGrid;
use crate::number::Real;
use mesophyll_base::quadrature;
use std::f64::consts::{FRAC_PI_2, PI};

/// −ln of the share of light that is neglected.
const NEGLIGIBLE: f64 = 40.0;

/// Nodes by which a lobe is integrated.
#[derive(Debug, Clone)]
pub struct LobeRules {
    /// Over φ.
    azimuth: Vec<(f64, f64)>,
    /// Over each smooth piece of θ.
    piece: Vec<(f64, f64)>,
}

impl LobeRules {
    /// `azimuth` nodes over φ and `piece` nodes over each smooth piece of θ.
    pub fn new(azimuth: usize, piece: usize) -> LobeRules {
        LobeRules { azimuth: quadrature::unit(azimuth), piece: quadrature::unit(piece) }
    }
}

/// One node of the integral over θ.
#[derive(Debug, Clone, Copy)]
pub struct AngleNode<N> {
    /// Sine of θ.
    pub sin: N,
    /// Cosine of θ.
    pub cos: N,
    /// Share of the light that it stands for; all of them add up to 1.
    pub weight: N,
}

/// x^p for x > 0.
fn power(x: f64, p: f64) -> f64 {
    if p.fract() == 0.0 && p <= 32.0 { x.powi(p as i32) } else { x.powf(p) }
}

/// ∫ max(0, a + b cos φ)^ob dφ over half a turn for a, b ≥ 0 and a + b > 0, divided by (a + b)^ob.
fn around<N: Real>(rules: &LobeRules, a: N, b: N, ob: N) -> N {
    let whole = a + b;
    // With z = a/(a + b) the base is z + (1 − z) cos φ = 1 − (1 − z)(1 − cos φ).
    let rest = b / whole;
    let (r, p) = (rest.value(), ob.value());
    if !(r > 0.0) {
        return N::of(PI);
    }
    // The φ at which the base becomes 0, and the φ at which its power becomes negligible.
    let zero = 1.0 - 1.0 / r;
    let faint = 1.0 - -(-NEGLIGIBLE / p).exp_m1() / r;
    let (end, graded, slope) = if faint > zero && faint > -1.0 {
        // The integral is cut where it is negligible, so no derivative comes from the cut.
        (faint.clamp(-1.0, 1.0).acos(), false, 0.0)
    } else if zero > -1.0 {
        // d arccos(1 − 1/r)/dr = −1/(r² sin φ)
        let end = zero.acos();
        (end, true, -1.0 / (r * r * end.sin()))
    } else {
        (PI, true, 0.0)
    };
    let (mut sum, mut by_rest, mut by_power) = (0.0, 0.0, 0.0);
    for &(y, w) in &rules.azimuth {
        // The power goes to 0 like a root: nodes are concentrated there.
        let (x, dx) = if graded { (1.0 - (1.0 - y) * (1.0 - y), 2.0 * (1.0 - y) * w) } else { (y, w) };
        let phi = end * x;
        let (sin, cos) = phi.sin_cos();
        let base = (1.0 - r * (1.0 - cos)).max(0.0);
        if base <= 0.0 {
            continue;
        }
        let value = power(base, p) * dx;
        sum += value;
        if N::DIFFERENTIATES {
            // The node moves with the end of the range.
            by_rest += p * value / base * (cos - 1.0 - r * sin * x * slope);
            by_power += value * base.ln();
        }
    }
    N::chain(end * sum, [(end * by_rest + slope * sum, rest), (end * by_power, ob)])
}

/// Nodes over all angles θ to which a ray of sine `sin` and cosine `cos` is turned, with the share of light at each.
/// `grazing` puts more nodes where cos θ is small.
pub fn spread<N: Real>(
    rules: &LobeRules,
    breaks: &[(N, bool)],
    sin: N,
    cos: N,
    ob: N,
    grazing: bool,
) -> Vec<AngleNode<N>> {
    let center = sin.angle(cos);
    let p = ob.value();
    // Beyond this distance the lobe is negligible.
    let reach = if p > 0.0 { (-NEGLIGIBLE / p).exp().acos() } else { FRAC_PI_2 };
    let width = 1.0 / (p + 1.0).sqrt();
    // Ends of pieces: the angle, and whether functions behave like a root below and above it.
    let mut ends: Vec<(N, bool, bool)> = vec![(N::of(0.0), false, false), (center, false, false)];
    ends.extend(breaks.iter().map(|&(at, root)| (at, root, false)));
    // The lobe ends a quarter turn away from the ray.
    if p < 40.0 {
        ends.push((N::of(FRAC_PI_2) - center, true, true));
    }
    if grazing {
        ends.extend([0.06, 0.006].map(|x| (N::of(FRAC_PI_2 - x), false, false)));
    }
    for step in [2.0, 5.0] {
        for way in [-1.0, 1.0] {
            ends.push((center + N::of(way * step * width), false, false));
        }
    }
    for way in [-1.0, 1.0] {
        ends.push((center + N::of(way * reach), false, false));
    }
    let (low, high) = ((center.value() - reach).max(0.0), (center.value() + reach).min(FRAC_PI_2));
    ends.retain(|e| (low - 1e-15..=high + 1e-15).contains(&e.0.value()));
    ends.sort_by(|a, b| a.0.value().total_cmp(&b.0.value()));
    ends.dedup_by(|b, a| {
        let same = b.0.value() - a.0.value() < 1e-13;
        if same {
            (a.1, a.2) = (a.1 || b.1, a.2 || b.2);
        }
        same
    });
    // An end without a root is removed where an end with a root lies close to it: the piece on its other side would be
    // disturbed by that root.
    let crowds = |root: f64, near: f64, far: f64| (near - root).abs() < 0.7 * (far - near).abs();
    let mut k = 1;
    while k + 1 < ends.len() {
        let [before, at, after] = [ends[k - 1].0.value(), ends[k].0.value(), ends[k + 1].0.value()];
        let plain = !ends[k].1 && !ends[k].2;
        if plain && (ends[k + 1].1 && crowds(after, at, before) || ends[k - 1].2 && crowds(before, at, after)) {
            ends.remove(k);
            k = k.max(2) - 1;
        } else {
            k += 1;
        }
    }
    // Where an end with a root lies close to the next end, its root is also felt in the piece beyond that end.
    let at: Vec<f64> = ends.iter().map(|e| e.0.value()).collect();
    for k in 1..ends.len().saturating_sub(1) {
        if ends[k - 1].2 && crowds(at[k - 1], at[k], at[k + 1]) {
            ends[k].2 = true;
        }
    }
    for k in (1..ends.len().saturating_sub(1)).rev() {
        if ends[k + 1].1 && crowds(at[k + 1], at[k], at[k - 1]) {
            ends[k].1 = true;
        }
    }
    let mut points = Vec::with_capacity(rules.piece.len() * ends.len());
    let mut total = N::of(0.0);
    let mut piece = |from: N, to: N, at_from: bool, at_to: bool| {
        for &(y, w) in &rules.piece {
            let (x, dx) = match (at_from, at_to) {
                (false, false) => (y, w),
                (true, _) => (y * y, 2.0 * y * w),
                (false, true) => (1.0 - (1.0 - y) * (1.0 - y), 2.0 * (1.0 - y) * w),
            };
            let length = to - from;
            let theta = from + length.times(x);
            let (s, c) = (theta.sin(), theta.cos());
            let (a, b) = (c * cos, s * sin);
            if !(c.value() > 0.0 && s.value() > 0.0) {
                continue;
            }
            // (a + b)^ob, of the cosine of the distance from the ray
            let near = a + b;
            let scale = power(near.value(), p);
            let near = N::chain(scale, [(p * scale / near.value(), near), (scale * near.value().ln(), ob)]);
            let weight = (around(rules, a, b, ob) * near * s * length).times(dx);
            total = total + weight;
            points.push(AngleNode { sin: s, cos: c, weight });
        }
    };
    for pair in ends.windows(2) {
        let ((from, _, above), (to, below, _)) = (pair[0], pair[1]);
        let last = to.value() > FRAC_PI_2 - 1e-12 && grazing;
        if above && (below || last) {
            let middle = (from + to).times(0.5);
            piece(from, middle, true, false);
            piece(middle, to, false, true);
        } else {
            piece(from, to, above, below || last);
        }
    }
    points.iter_mut().for_each(|q| q.weight = q.weight / total);
    points
}

/// Weights that turn the values at the nodes of a medium of the index `n` into the mean over the lobe around a ray.
/// `through` is the share of light at an angle that goes on.
pub fn row<N: Real>(
    grid: &AngleGrid<N>,
    n: N,
    points: &[AngleNode<N>],
    through: impl Fn(&AngleNode<N>) -> N,
) -> Vec<N> {
    let mut out = vec![N::of(0.0); grid.len(n)];
    grid.integrate(n, points.iter().map(|q| (q.sin, q.cos, q.weight * through(q))), &mut out);
    out
}
