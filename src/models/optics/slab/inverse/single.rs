//! One measured share and one known coefficient: the other coefficient.
//!
//! Either of ρd and ρt is a function of the unknown σ alone once the other σ is known. All slabs with the measured
//! value are looked for over the whole range of σ, since with reflecting faces or at strong absorption ρd need not rise
//! with σs everywhere. The error has two parts: that of the measurement and that of the known coefficient.

use super::bounds::{bounded, figure};
use super::{DETERMINED, IMPOSSIBLE, OPAQUE, ROUNDING, SMALLEST, SlabEstimate, SlabModel, Status, thickness_trouble};

/// Which share was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlabShare {
    /// ρd
    Reflected,
    /// ρt
    Transmitted,
}

/// Which coefficient is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlabCoefficient {
    /// σa
    Absorption,
    /// σs
    Scattering,
}

/// One measured share and one known coefficient (1/mm), with standard errors ≥ 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingleMeasurement {
    /// Which share was measured.
    pub share: SlabShare,
    /// Its value.
    pub value: f64,
    /// Its standard error.
    pub err: f64,
    /// Which coefficient is known.
    pub known: SlabCoefficient,
    /// Its value (1/mm).
    pub sigma: f64,
    /// Its standard error.
    pub sigma_err: f64,
}

/// Range of ln(σh) of the unknown coefficient, and the points that are looked at.
const RANGE: [f64; 2] = [-16.0, 9.0];
const POINTS: usize = 76;
/// Bounds are stated at this many standard errors.
const WIDTH: f64 = 2.0;

/// What one value allows: the unknown σh that give it, ascending.
enum Roots {
    Some(Vec<f64>),
    /// No slab gives it; the nearest has this σh (0 or ∞, or where the share is largest) and this share.
    None {
        nearest: f64,
        share: f64,
    },
}

/// A slab with one coefficient known.
struct Curve<'a> {
    model: &'a SlabModel,
    share: SlabShare,
    known: SlabCoefficient,
}

impl Curve<'_> {
    /// The share at the known σh and the unknown σh.
    fn at(&self, known: f64, unknown: f64) -> f64 {
        let (a, s) = match self.known {
            SlabCoefficient::Absorption => (known, unknown),
            SlabCoefficient::Scattering => (unknown, known),
        };
        let delta = a + s;
        let r = if delta > 0.0 {
            self.model.response(s / delta, a / delta, delta)
        } else {
            self.model.response(0.0, 1.0, 0.0)
        };
        match self.share {
            SlabShare::Reflected => r.rho_d,
            SlabShare::Transmitted => r.rho_t,
        }
    }

    fn roots(&self, known: f64, value: f64) -> Roots {
        if self.share == SlabShare::Transmitted && value < SMALLEST {
            // Every slab that is thick enough transmits nothing.
            return Roots::None { nearest: f64::INFINITY, share: 0.0 };
        }
        let step = (RANGE[1] - RANGE[0]) / (POINTS - 1) as f64;
        // 0 stands before the points.
        let place = |k: usize| if k == 0 { 0.0 } else { (RANGE[0] + step * (k - 1) as f64).exp() };
        let miss = |x: f64| self.at(known, x) - value;
        let mut found = Vec::new();
        let (mut low, mut low_miss) = (0.0, miss(0.0));
        let (mut nearest, mut smallest) = (0.0, low_miss.abs());
        for k in 1..=POINTS {
            let (high, high_miss) = (place(k), miss(place(k)));
            if high_miss.abs() < smallest {
                (nearest, smallest) = (if k == POINTS { f64::INFINITY } else { high }, high_miss.abs());
            }
            if low_miss == 0.0 || low_miss * high_miss < 0.0 {
                found.push(if low_miss == 0.0 { low } else { bisect(&miss, [low, high], [low_miss, high_miss]) });
            }
            (low, low_miss) = (high, high_miss);
        }
        if found.is_empty() {
            let share = self.at(known, nearest.min(place(POINTS)));
            Roots::None { nearest, share }
        } else {
            Roots::Some(found)
        }
    }
}

/// The zero between two points of opposite sign (the Illinois variant of false position).
fn bisect(f: &dyn Fn(f64) -> f64, [mut a, mut b]: [f64; 2], [mut fa, mut fb]: [f64; 2]) -> f64 {
    let mut side = 0;
    let mut x = a;
    for _ in 0..80 {
        x = (a * fb - b * fa) / (fb - fa);
        let fx = f(x);
        if fx == 0.0 || (b - a).abs() <= 1e-13 * x.abs() {
            break;
        }
        if fx * fb < 0.0 {
            (a, fa) = (b, fb);
            side = 0;
        } else {
            // The end that stays is given less weight.
            side += 1;
            fa *= if side > 1 { 0.5 } else { 1.0 };
        }
        (b, fb) = (x, fx);
    }
    x
}

/// The slab of this thickness with the measured share and the known coefficient.
pub fn invert_single(model: &SlabModel, single: &SingleMeasurement, thickness_mm: f64) -> SlabEstimate {
    let h = thickness_mm;
    if let Some(why) = thickness_trouble(h).or_else(|| trouble(single)) {
        return SlabEstimate::refused(why);
    }
    let SingleMeasurement { share, value, known, sigma, sigma_err, .. } = *single;
    let err = single.err.hypot(model.error * value.abs()).hypot(ROUNDING);
    let curve = Curve { model, share, known };
    let (name, unknown) = names(single);
    let centre = match curve.roots(sigma * h, value) {
        Roots::Some(found) if found.len() > 1 => {
            let list: Vec<String> = found.iter().map(|x| figure(x / h, false)).collect();
            let text = format!("{unknown} ({} 1/mm give this {name} alike)", list.join(" and "));
            let width = (found[found.len() - 1] - found[0]) / h;
            return answer(single, found[0] / h, width, Status::Undetermined(text));
        }
        Roots::Some(found) => found[0],
        Roots::None { nearest, share: reached } => {
            // What the known coefficient's error does to the nearest slab counts, too.
            let end = nearest.min(RANGE[1].exp());
            let other = curve.at((sigma + sigma_err) * h, end) - curve.at(sigma * h, end);
            if (value - reached).abs() > IMPOSSIBLE * err.hypot(other) {
                let which = if value > reached { "at most" } else { "at least" };
                let known = if known == SlabCoefficient::Absorption { "sigma_a" } else { "sigma_s" };
                return SlabEstimate::refused(format!(
                    "{name} is {value}; a slab of this thickness with {known} {sigma} has {which} {reached:.4}"
                ));
            }
            nearest
        }
    };
    // ∂x/∂measured · err and ∂x/∂known · err
    let by = |known: f64, x: f64| {
        let step = 1e-4 * x;
        let slope = (curve.at(known, x + step) - curve.at(known, x - step)) / (2.0 * step);
        let step = 1e-4 * known.max(1e-3 * x);
        let other = (curve.at(known + step, x) - curve.at((known - step).max(0.0), x)) / (step + step.min(known));
        [err / slope, -other / slope * sigma_err * h]
    };
    let regular = centre > 0.0 && centre.is_finite();
    let parts = if regular { by(sigma * h, centre) } else { [f64::INFINITY; 2] };
    let own = parts[0].hypot(parts[1]);
    // The ends of the range: the measurement and the known coefficient are moved together, as each contributes.
    let (c, s) = if regular && own > 0.0 && own.is_finite() { (parts[0] / own, parts[1] / own) } else { (1.0, 0.0) };
    let mut several = false;
    let mut end = |sign: f64| {
        let moved = ((sigma + sign * WIDTH * s * sigma_err) * h).max(0.0);
        match curve.roots(moved, value + sign * WIDTH * c * err) {
            Roots::Some(found) => {
                several |= found.len() > 1;
                found
            }
            Roots::None { nearest, .. } => vec![nearest],
        }
    };
    let all: Vec<f64> = end(1.0).into_iter().chain(end(-1.0)).chain([centre]).collect();
    // Where no slab of the range reaches the value, the range's end bounds it.
    let (low, high) = all.iter().fold((RANGE[1].exp(), 0.0_f64), |(l, u), &x| (l.min(x), u.max(x)));
    let opaque = share == SlabShare::Transmitted && value <= OPAQUE * err;
    // A transmittance within two errors of zero may be that of any thicker slab, also where part of the range comes
    // from the known coefficient.
    let high = if share == SlabShare::Transmitted && value <= WIDTH * err { f64::INFINITY } else { high };
    let relative = own / centre;
    let fits = |x: f64| x > 0.6 * WIDTH * relative - 1e-3 && x < 1.6 * WIDTH * relative + 1e-3;
    let (down, up) = ((centre - low) / centre, (high - centre) / centre);
    if regular && relative <= DETERMINED && !several && !opaque && fits(down) && fits(up) {
        return answer(single, centre / h, own / h, Status::Ok);
    }
    let best = if centre.is_finite() { centre } else { low };
    let text = match several {
        true => format!("{unknown} (several values give this {name} within its error)"),
        false => bounded(unknown, [low / h, high / h], best / h),
    };
    let width = own.max(0.5 * (high - low) / WIDTH).max(1.01 * DETERMINED * best);
    let width = if width.is_nan() { f64::INFINITY } else { width };
    answer(single, best / h, width / h, Status::Undetermined(text))
}

/// Names of the measured column and of the unknown one.
fn names(single: &SingleMeasurement) -> (&'static str, &'static str) {
    let measured = match single.share {
        SlabShare::Reflected => "rho_d",
        SlabShare::Transmitted => "rho_t",
    };
    let unknown = match single.known {
        SlabCoefficient::Absorption => "sigma_s",
        SlabCoefficient::Scattering => "sigma_a",
    };
    (measured, unknown)
}

/// Why these are no measurements, if so.
fn trouble(single: &SingleMeasurement) -> Option<String> {
    let (name, _) = names(single);
    let known = match single.known {
        SlabCoefficient::Absorption => "known_sigma_a",
        SlabCoefficient::Scattering => "known_sigma_s",
    };
    let SingleMeasurement { value, err, sigma, sigma_err, .. } = *single;
    if let Some(why) = super::no_share(name, value, err) {
        return Some(why);
    }
    if !(sigma >= 0.0 && sigma.is_finite()) {
        return Some(format!("{known} is {sigma}; expected 0 or more, in 1/mm"));
    }
    if !(sigma_err >= 0.0 && sigma_err.is_finite()) {
        return Some(format!("{known}_err is {sigma_err}; expected a standard error of 0 or more"));
    }
    None
}

/// The estimate with the known coefficient as it was given.
fn answer(single: &SingleMeasurement, found: f64, err: f64, status: Status) -> SlabEstimate {
    let ([a, s], [ea, es]) = match single.known {
        SlabCoefficient::Absorption => ([single.sigma, found], [single.sigma_err, err]),
        SlabCoefficient::Scattering => ([found, single.sigma], [err, single.sigma_err]),
    };
    SlabEstimate {
        sigma_a: a,
        sigma_s: s,
        sigma_a_err: ea,
        sigma_s_err: es,
        covariance: [[ea * ea, f64::NAN], [f64::NAN, es * es]],
        condition: f64::NAN,
        status,
    }
}
