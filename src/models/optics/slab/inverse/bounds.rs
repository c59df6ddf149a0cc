//! Finds which σa and σs are possible, given noisy ρd and ρt. The ellipse of two standard errors around the measured
//! pair is cut to the pairs that a slab can have, and its outline is inverted point by point.

use super::newton::{self, SlabPoint};
use super::{InversionPrecision, Measured, SlabEstimate, SlabModel, Spread, Status};

/// The bounds are stated at this many standard errors.
const WIDTH: f64 = 2.0;
const DIRECTIONS: usize = 24;

/// Smallest and largest σa h and σs h that the measurements allow; 0 and ∞ are possible.
struct Range {
    low: [f64; 2],
    high: [f64; 2],
}

impl Range {
    fn include(&mut self, value: [f64; 2]) {
        for k in 0..2 {
            self.low[k] = self.low[k].min(value[k]);
            self.high[k] = self.high[k].max(value[k]);
        }
    }
}

/// A point of the (ρd, ρt) plane, moved to the nearest point that some slab has. The edges of the possible region
/// belong to black, clear, opaque and conservative slabs.
struct Feasible {
    r: f64,
    /// what r is above the reflectance of the faces
    above: f64,
    t: f64,
    lost: f64,
    /// on the edge where nothing scatters, ρt = 0, ρd + ρt = 1
    edge: [bool; 3],
}

/// A number small enough to act as zero and large enough to compute with.
const TINY: f64 = 1e-18;

fn feasible(model: &SlabModel, r: f64, t: f64, m: &Measured) -> Feasible {
    let (mut r, mut t) = (r, t);
    let mut edge = [false; 3];
    let excess = r + t - 1.0;
    if excess >= 0.0 {
        // Moves the point onto the conservative edge, by the shortest way in units of the noise.
        let share = (m.t_err / m.r_err).powi(2);
        r -= excess / (1.0 + share);
        t = 1.0 - r;
        edge[2] = true;
    }
    let floor = model.mirror.reflectance(t.max(0.0)).0;
    let mut above = r - floor;
    if above <= 0.0 {
        (r, above) = (floor + TINY, TINY);
        edge[0] = true;
    }
    if t <= 0.0 {
        t = TINY;
        edge[1] = true;
    }
    // the corners: clear, and white (1, 0)
    (r, t) = (r.min(1.0), t.min(model.mirror.clear()));
    Feasible { r, above, t, lost: if edge[2] { 0.0 } else { 1.0 - r - t }, edge }
}

/// σa h and σs h of a feasible point. On the edges they are exactly zero or infinite; where both are numbers, the point
/// itself is returned too.
fn place(model: &SlabModel, p: &Feasible, precision: InversionPrecision) -> Option<([f64; 2], Option<SlabPoint>)> {
    let [clear, opaque, conservative] = p.edge;
    if p.t >= model.mirror.clear() || (clear && conservative) {
        // The slab is clear: nothing is in the way of the light.
        return Some(([0.0, 0.0], None));
    }
    if opaque {
        // The slab may be arbitrarily thick. A coefficient that is zero stays zero; the other is infinite.
        let open = |closed: bool| if closed { 0.0 } else { f64::INFINITY };
        return Some(([open(conservative), open(clear)], None));
    }
    if conservative {
        return newton::conservative(model, p.t).map(|point| ([0.0, point.delta], None));
    }
    if clear {
        return Some(([-model.mirror.crossing(p.t).ln(), 0.0], None));
    }
    let point = newton::solve(model, p.above, p.t, p.lost, precision)?;
    Some(([point.absorbed * point.delta, point.omega * point.delta], Some(point)))
}

/// The range over the ellipse of `width` standard errors around the nearest measurement that some slab has. So a
/// transmittance measured three errors below zero bounds the range as well as one measured at zero.
fn range(model: &SlabModel, m: &Measured, width: f64, precision: InversionPrecision) -> Option<Range> {
    let mut range = Range { low: [f64::INFINITY; 2], high: [0.0; 2] };
    let mut any = false;
    let mut see = |r: f64, t: f64| {
        let p = feasible(model, r, t, m);
        if let Some((value, _)) = place(model, &p, precision) {
            range.include(value);
            any = true;
        }
        if p.edge[1] && p.edge[2] {
            // The slab is opaque and white: with enough thickness any absorption is possible.
            range.include([f64::INFINITY, f64::INFINITY]);
        }
    };
    let centre = feasible(model, m.r, m.t, m);
    for k in 0..DIRECTIONS {
        let (s, c) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
        see(centre.r + width * m.r_err * c, centre.t + width * m.t_err * s);
    }
    see(centre.r, centre.t);
    any.then_some(range)
}

/// Whether the parameters' ranges at ±2σ agree with linear error propagation.
pub(super) fn nearly_linear(
    model: &SlabModel,
    m: &Measured,
    point: &SlabPoint,
    spread: &Spread,
    precision: InversionPrecision,
) -> bool {
    let Some(range) = range(model, m, WIDTH, precision) else { return false };
    let centre = [point.absorbed * point.delta, point.omega * point.delta];
    (0..2).all(|k| {
        // Both sides are taken relative to the estimate: additive and multiplicative noise pass, a side that runs away
        // does not.
        let expected = WIDTH * spread.relative[k];
        let (down, up) = ((centre[k] - range.low[k]) / centre[k], (range.high[k] - centre[k]) / centre[k]);
        let fits = |x: f64| x > 0.6 * expected - 1e-3 && x < 1.6 * expected + 1e-3;
        fits(down) && fits(up)
    })
}

/// The best estimate with large errors, and bounds by name. It uses the fast model, whose error is part of `m`.
pub(super) fn undetermined(model: &SlabModel, m: &Measured, h: f64) -> SlabEstimate {
    let precision = InversionPrecision::Fast;
    let best = feasible(model, m.r, m.t, m);
    let centre = place(model, &best, precision);
    let Some(range) = range(model, m, WIDTH, precision) else {
        return SlabEstimate::refused(format!("no slab was found for rho_d {} and rho_t {}", m.r, m.t));
    };
    let linear = centre.and_then(|c| c.1).map(|p| Spread::new(model, &p, &Measured { r: best.r, t: best.t, ..*m }));
    let mut value = centre.map_or([f64::INFINITY; 2], |c| c.0);
    let mut err = [0.0; 2];
    let mut open = Vec::new();
    for (k, name) in ["sigma_a", "sigma_s"].into_iter().enumerate() {
        let may_be_opaque = m.t <= super::OPAQUE * m.t_err && range.high[k] > 0.0 && value[k] > 0.0;
        let (low, high) = (range.low[k], range.high[k]);
        if value[k].is_infinite() {
            // The slab is opaque: the thinnest slab that explains the measurement is taken.
            value[k] = low;
        }
        let half = 0.5 * (high - low) / WIDTH;
        let slope = linear.as_ref().map_or(0.0, |l| l.relative[k] * value[k]);
        err[k] = if slope.is_finite() { half.max(slope) } else { half };
        let edge = value[k] == 0.0 || !(err[k] <= super::DETERMINED * value[k]);
        let runaway = high - value[k] > 2.0 * WIDTH * super::DETERMINED * value[k]
            || low < (1.0 - 2.0 * WIDTH * super::DETERMINED) * value[k];
        if !edge && !runaway && !may_be_opaque {
            continue;
        }
        err[k] = err[k].max(super::DETERMINED * 1.01 * value[k]);
        open.push(bounded(name, [low / h, high / h], value[k] / h));
    }
    if open.is_empty() {
        // Each range alone passes, but the straight line between them does not: both parameters are named.
        open = vec!["sigma_a".into(), "sigma_s".into()];
        for k in 0..2 {
            err[k] = err[k].max(super::DETERMINED * 1.01 * value[k]);
        }
    }
    let correlation = linear.as_ref().map_or(0.0, |l| l.correlation).clamp(-1.0, 1.0);
    let (ea, es) = (err[0] / h, err[1] / h);
    let cross = if correlation.is_finite() && ea.is_finite() && es.is_finite() { correlation * ea * es } else { 0.0 };
    SlabEstimate {
        sigma_a: value[0] / h,
        sigma_s: value[1] / h,
        sigma_a_err: ea,
        sigma_s_err: es,
        covariance: [[ea * ea, cross], [cross, es * es]],
        condition: linear.map_or(f64::INFINITY, |l| l.condition),
        status: Status::undetermined(open, ""),
    }
}

/// The name of a coefficient with the bounds that close its interval; the lower one says something where it is more
/// than a twentieth of the value.
pub(super) fn bounded(name: &str, [low, high]: [f64; 2], value: f64) -> String {
    match (low > 0.05 * value && low > 0.0, high.is_finite()) {
        (false, true) => format!("{name} <= {}", figure(high, true)),
        (true, false) => format!("{name} >= {}", figure(low, false)),
        (true, true) => format!("{name} >= {} and <= {}", figure(low, false), figure(high, true)),
        (false, false) => name.to_string(),
    }
}

/// A bound to two figures, rounded outward.
pub(super) fn figure(x: f64, up: bool) -> String {
    if x == 0.0 {
        return "0".into();
    }
    let scale = 10.0_f64.powi(x.abs().log10().floor() as i32 - 1);
    let steps = if up { (x / scale).ceil() } else { (x / scale).floor() };
    let rounded = steps * scale;
    if (1e-4..1e5).contains(&rounded) {
        let decimals = (1.0 - rounded.log10().floor()).clamp(0.0, 8.0) as usize;
        format!("{rounded:.decimals$}")
    } else {
        format!("{rounded:.1e}")
    }
}
