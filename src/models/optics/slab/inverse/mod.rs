//! From (ρd, ρt, thickness) back to (σa, σs), with errors that can be trusted.
//!
//! Every ρd > 0, ρt > 0 with ρd + ρt < 1 belongs to exactly one slab. The map from L = ln(σs/σa) and M = ln Δ to F₁ =
//! ln(ρd/α), α = 1 − ρd − ρt, and F₂ = ln(−ln ρt) is close to linear from the thinnest to the thickest slab. So
//! Newton's method from a tabulated start ends after two or three steps ([`newton`]). To find what noise leaves open,
//! its ellipse is carried through the model ([`bounds`]).

mod bounds;
mod model;
mod newton;
mod single;

pub use mesophyll_base::error::Status;
pub use model::SlabModel;
pub use newton::{SlabPoint, after_steps, solve};
pub use single::{SingleMeasurement, SlabCoefficient, SlabShare, invert_single};
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// Which forward model the answer is held to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum InversionPrecision {
    /// The table: better than 1e-6 in σa and σs wherever they are determined.
    #[default]
    Fast,
    /// Refined against [`super::medium`]: nine digits.
    Exact,
}

/// σa and σs (1/mm), their standard errors and covariance (1/mm²). Numbers are NaN where refused; an error is infinite
/// where nothing limits the parameter from above.
#[derive(Debug, Clone, PartialEq)]
pub struct SlabEstimate {
    /// Absorption (1/mm).
    pub sigma_a: f64,
    /// Scattering (1/mm).
    pub sigma_s: f64,
    /// Standard error of σa.
    pub sigma_a_err: f64,
    /// Standard error of σs.
    pub sigma_s_err: f64,
    /// Covariance of (σa, σs).
    pub covariance: [[f64; 2]; 2],
    /// Condition number of the map from relative changes of (ρd, ρt) to relative changes of (σa, σs); NaN where
    /// refused.
    pub condition: f64,
    /// Whether the numbers may be used.
    pub status: Status,
}

/// How the refusal of a pair begins whose sum is above 1.
pub const MORE_THAN_ALL: &str = "rho_d + rho_t";

/// What was measured, and its standard errors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    pub r: f64,
    pub t: f64,
    pub r_err: f64,
    pub t_err: f64,
}

impl Measured {
    /// What scattering adds to the reflectance of the faces at this transmittance.
    fn above(&self, model: &SlabModel) -> f64 {
        self.r - model.mirror.reflectance(self.t.max(0.0)).0
    }

    /// Standard error of [`Measured::above`].
    fn above_err(&self, model: &SlabModel) -> f64 {
        self.r_err.hypot(model.mirror.reflectance(self.t.max(0.0)).1 * self.t_err)
    }
}

/// A parameter whose relative standard error is above this is not called determined.
pub const DETERMINED: f64 = 0.1;
/// A measurement that is more than this many standard errors outside the possible region is refused.
const IMPOSSIBLE: f64 = 4.0;
/// A transmittance within this many standard errors of zero may belong to an opaque slab, so it leaves the coefficients
/// open. Noise puts that of an opaque slab beyond it once in 30,000 rows. It is the number at which measurements are
/// refused: what is called impossible there is not called possible here.
pub const OPAQUE: f64 = IMPOSSIBLE;
/// Rounding of the measurements themselves: relative, and absolute where one is exactly zero.
const ROUNDING: f64 = 2e-16;
/// A transmittance below this is treated as zero: double precision resolves no more.
const SMALLEST: f64 = 1e-300;
/// A transmittance below this is inverted with the exact model.
const DEEP: f64 = 1e-30;
/// Thicknesses that a slab of matter can have (mm): from the size of an atom to a kilometre. At far smaller ones σ
/// would overflow.
const THICKNESS_MM: [f64; 2] = [1e-7, 1e6];
/// Relative error of the exact model in ρd and in −ln ρt.
const EXACT_MODEL: f64 = 2e-10;

/// Inverts one pair of measurements with the fast model; `rho_d_err` and `rho_t_err` are absolute standard errors ≥ 0.
///
/// Where the fast model's own error would decide the verdict, the exact one is used.
pub fn invert(rho_d: f64, rho_t: f64, thickness_mm: f64, rho_d_err: f64, rho_t_err: f64) -> SlabEstimate {
    invert_with(InversionPrecision::Fast, rho_d, rho_t, thickness_mm, rho_d_err, rho_t_err)
}

/// [`invert`] with a stated precision.
pub fn invert_with(
    precision: InversionPrecision,
    rho_d: f64,
    rho_t: f64,
    thickness_mm: f64,
    rho_d_err: f64,
    rho_t_err: f64,
) -> SlabEstimate {
    invert_in(SlabModel::matched(), precision, rho_d, rho_t, thickness_mm, rho_d_err, rho_t_err)
}

/// [`invert_with`] of a slab with these faces. ρd is all that comes back, with the mirror reflection of the faces.
pub fn invert_in(
    model: &SlabModel,
    precision: InversionPrecision,
    rho_d: f64,
    rho_t: f64,
    thickness_mm: f64,
    rho_d_err: f64,
    rho_t_err: f64,
) -> SlabEstimate {
    let mut measured = Measured { r: rho_d, t: rho_t, r_err: rho_d_err, t_err: rho_t_err };
    if let Some(why) = impossible(model, &measured, thickness_mm) {
        return SlabEstimate::refused(why);
    }
    if rho_t.abs() < SMALLEST {
        measured.t = 0.0;
        measured.t_err = rho_t_err.hypot(if rho_t == 0.0 { 0.0 } else { SMALLEST });
    }
    let stated_matters = rho_d_err.hypot(rho_t_err) > 30.0 * model.error;
    let coarse = with_model_error(model, &measured, model.error);
    // The table keeps the digits of ρt down to 1e-30.
    let deep = rho_t > 0.0 && rho_t < DEEP;
    let found = if precision == InversionPrecision::Fast && !deep {
        determined(model, &coarse, thickness_mm, InversionPrecision::Fast, InversionPrecision::Fast)
    } else {
        None
    };
    if let Some(found) = found {
        return found;
    }
    if precision == InversionPrecision::Exact || !stated_matters {
        let check = if stated_matters { InversionPrecision::Fast } else { InversionPrecision::Exact };
        if let Some(found) = determined(
            model,
            &with_model_error(model, &measured, EXACT_MODEL),
            thickness_mm,
            InversionPrecision::Exact,
            check,
        ) {
            return found;
        }
    }
    bounds::undetermined(model, &coarse, thickness_mm)
}

/// Adds the forward model's error and rounding to the stated errors.
fn with_model_error(model: &SlabModel, m: &Measured, error: f64) -> Measured {
    let t = m.t.clamp(1e-300, model.mirror.clear());
    let widen = |stated: f64, own: f64, value: f64| {
        let rounding = if value == 0.0 && stated == 0.0 { ROUNDING } else { ROUNDING * value };
        stated.hypot(own).hypot(rounding)
    };
    let depth = model.log_clear - t.ln();
    Measured { r_err: widen(m.r_err, error * m.above(model), m.r), t_err: widen(m.t_err, error * t * depth, m.t), ..*m }
}

/// Why this thickness (mm) cannot be used, if so.
fn thickness_trouble(h: f64) -> Option<String> {
    let [thinnest, thickest] = THICKNESS_MM;
    if !(h > 0.0 && h.is_finite()) {
        return Some(format!("h is {h}; expected a positive thickness"));
    }
    if !(thinnest..=thickest).contains(&h) {
        return Some(format!("h is {h:e} mm; expected a thickness of {thinnest:e} to {thickest:e} mm"));
    }
    None
}

/// Why this is no share of light with a standard error, if so.
fn no_share(name: &str, value: f64, err: f64) -> Option<String> {
    if !value.is_finite() {
        return Some(format!("{name} is {value}; expected a fraction between 0 and 1"));
    }
    if !(err >= 0.0 && err.is_finite()) {
        return Some(format!("{name}_err is {err}; expected a standard error of 0 or more"));
    }
    if value > 1.0 + IMPOSSIBLE * (err + ROUNDING) {
        return Some(format!("{name} is {value}; expected a fraction between 0 and 1 (is it in per cent?)"));
    }
    if value < -IMPOSSIBLE * (err + ROUNDING) {
        return Some(format!("{name} is {value}; negative beyond the stated noise"));
    }
    None
}

/// Why no slab can have these measurements, if so.
fn impossible(model: &SlabModel, m: &Measured, h: f64) -> Option<String> {
    let shares = || no_share("rho_d", m.r, m.r_err).or_else(|| no_share("rho_t", m.t, m.t_err));
    if let Some(why) = thickness_trouble(h).or_else(shares) {
        return Some(why);
    }
    let excess = m.r + m.t - 1.0;
    if excess > IMPOSSIBLE * (m.r_err.hypot(m.t_err) + ROUNDING) {
        return Some(format!("{MORE_THAN_ALL} is {}; more than 1 beyond the stated noise", m.r + m.t));
    }
    let clear = model.mirror.clear();
    if m.t - clear > IMPOSSIBLE * (m.t_err + ROUNDING) {
        return Some(format!(
            "rho_t is {}; the faces of a slab of index {} let through at most {clear:.4}: is the index too large?",
            m.t, model.index
        ));
    }
    if m.above(model) < -IMPOSSIBLE * (m.above_err(model) + ROUNDING) {
        return Some(format!(
            "rho_d is {}; at this rho_t the faces of a slab of index {} reflect {:.4} by themselves: is the index too \
             large, or rho_d measured without the mirror reflection?",
            m.r,
            model.index,
            m.r - m.above(model)
        ));
    }
    if m.r_err > 1.0 || m.t_err > 1.0 {
        return Some(format!("the stated noise {} leaves nothing to fit", m.r_err.max(m.t_err)));
    }
    None
}

/// The answer where both parameters are determined, by linear error propagation and, where its validity is in doubt, by
/// the model itself.
///
/// `check` is the model that decides such cases: the fast one, unless noise is below the fast model's own error.
fn determined(
    model: &SlabModel,
    m: &Measured,
    h: f64,
    precision: InversionPrecision,
    check: InversionPrecision,
) -> Option<SlabEstimate> {
    let lost = 1.0 - m.r - m.t;
    if !(m.above(model) > 2.0 * m.above_err(model) && m.t > OPAQUE * m.t_err && lost > 2.0 * m.r_err.hypot(m.t_err)) {
        return None;
    }
    let point = newton::solve(model, m.above(model), m.t, lost, precision)?;
    let spread = Spread::new(model, &point, m);
    let (ra, rs) = (spread.relative[0], spread.relative[1]);
    if !(ra <= DETERMINED && rs <= DETERMINED) {
        return None;
    }
    // Far from the edges, errors of up to DETERMINED carry over linearly everywhere; a test goes through them. To ask
    // the model there too would take ten times as long as the inversion itself.
    if near_edge(model, m, lost) && !bounds::nearly_linear(model, m, &point, &spread, check) {
        return None;
    }
    Some(spread.estimate(&point, h, Status::Ok))
}

/// Whether the noise may reach a black, an opaque or a conservative slab, where σ by the measurements is anything but
/// linear.
fn near_edge(model: &SlabModel, m: &Measured, lost: f64) -> bool {
    m.above(model) < 6.0 * m.above_err(model) || m.t < 12.0 * m.t_err || lost < 6.0 * m.r_err.hypot(m.t_err)
}

/// Standard errors by linear propagation.
pub(crate) struct Spread {
    /// of ln σa and ln σs
    pub relative: [f64; 2],
    pub correlation: f64,
    pub condition: f64,
}

impl Spread {
    pub fn new(model: &SlabModel, point: &SlabPoint, m: &Measured) -> Spread {
        // rows: ln σa, ln σs; columns: ρd, ρt
        let g = point.log_sigma_by_measured(model, m.r, m.t);
        // The products are formed before they are squared: the squares of the errors alone would underflow at a
        // transmittance of 1e-200.
        let e = [[g[0][0] * m.r_err, g[0][1] * m.t_err], [g[1][0] * m.r_err, g[1][1] * m.t_err]];
        let c = |i: usize, k: usize| e[i][0] * e[k][0] + e[i][1] * e[k][1];
        let relative = [c(0, 0).sqrt(), c(1, 1).sqrt()];
        let s = [[g[0][0] * m.r, g[0][1] * m.t], [g[1][0] * m.r, g[1][1] * m.t]];
        let norm: f64 = s.iter().flatten().map(|x| x * x).sum();
        let det = (s[0][0] * s[1][1] - s[0][1] * s[1][0]).abs();
        let root = (norm * norm - 4.0 * det * det).max(0.0).sqrt();
        Spread { relative, correlation: c(0, 1) / (relative[0] * relative[1]), condition: 0.5 * (norm + root) / det }
    }

    fn estimate(&self, point: &SlabPoint, h: f64, status: Status) -> SlabEstimate {
        let (a, s) = (point.absorbed * point.delta / h, point.omega * point.delta / h);
        let (ea, es) = (a * self.relative[0], s * self.relative[1]);
        let cross = self.correlation * ea * es;
        SlabEstimate {
            sigma_a: a,
            sigma_s: s,
            sigma_a_err: ea,
            sigma_s_err: es,
            covariance: [[ea * ea, cross], [cross, es * es]],
            condition: self.condition,
            status,
        }
    }
}

impl SlabEstimate {
    fn refused(why: String) -> SlabEstimate {
        let nan = f64::NAN;
        SlabEstimate {
            sigma_a: nan,
            sigma_s: nan,
            sigma_a_err: nan,
            sigma_s_err: nan,
            covariance: [[nan; 2]; 2],
            condition: nan,
            status: Status::Refused(why),
        }
    }
}

#[cfg(test)]
mod faces_tests;
#[cfg(test)]
mod tests;
