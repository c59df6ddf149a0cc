//! ρd and ρt from ω and Δ by a named method, and whether the inputs make a slab: one row of what `eval slab` prints.

use super::faces::SlabFaces;
use super::inverse::SlabModel;
use super::{SlabResponse, fn_method, medium};
use mesophyll_base::error::Status;

/// How ρd and ρt are computed.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    strum::Display,
    strum::EnumString,
    strum::EnumIter,
    strum::IntoStaticStr,
    strum::EnumMessage,
)]
#[strum(serialize_all = "lowercase")]
pub enum SlabMethod {
    /// A table, 1e-8.
    #[default]
    Fast,
    /// Nine digits and more.
    Exact,
    /// The paper's F_N; the order is raised until two agree.
    Fn,
}

/// F_N orders are raised until ρd and ρt change by less than this. An answer that does not settle to 1e-3 is not called
/// ok.
const FN_TOLERANCE: f64 = 1e-6;
const FN_SETTLED: f64 = 1e-3;

/// Numbers smaller than this are stored with fewer digits than an answer promises.
const SMALLEST: f64 = 1e-300;

/// How slabs are computed: the method, the cosine of the beam (below 1 with [`SlabMethod::Exact`] only), and the slab's
/// index (above 1 not with [`SlabMethod::Fn`]).
pub struct SlabEvaluator {
    method: SlabMethod,
    mu0: f64,
    faces: Option<Reflecting>,
}

/// A slab with reflecting faces, from a table or exactly.
enum Reflecting {
    Table(Box<SlabModel>),
    Exact(Box<SlabFaces>),
}

impl SlabEvaluator {
    /// For slabs of `index` ≥ 1 in air. At index 1 the faces reflect nothing.
    pub fn new(method: SlabMethod, mu0: f64, index: f64) -> SlabEvaluator {
        let faces = (index != 1.0).then(|| match method {
            SlabMethod::Fast => Reflecting::Table(Box::new(SlabModel::of_index(index))),
            SlabMethod::Exact | SlabMethod::Fn => Reflecting::Exact(Box::new(SlabFaces::new(index, mu0))),
        });
        SlabEvaluator { method, mu0, faces }
    }

    /// ρd and ρt of a slab of single-scattering albedo `omega` (0 to 1) and optical thickness `delta` ≥ 0, and the
    /// status. `one_minus_omega` is NaN where only ω is known; near ω = 1 it carries the digits. ρd and ρt are NaN
    /// where the status is [`Status::Refused`].
    pub fn evaluate(&self, omega: f64, delta: f64, one_minus_omega: f64) -> (SlabResponse, Status) {
        let (omega, absorbed) = match albedo(omega, delta, one_minus_omega) {
            Ok(both) => both,
            Err(why) => return (SlabResponse::UNKNOWN, Status::Refused(why)),
        };
        match (&self.faces, self.method) {
            (Some(Reflecting::Table(model)), _) => (model.response(omega, absorbed, delta), Status::Ok),
            (Some(Reflecting::Exact(faces)), _) => (faces.shares(omega, absorbed, delta).response(), Status::Ok),
            (None, SlabMethod::Fast) => (super::reduced(omega, absorbed, delta).0, Status::Ok),
            (None, SlabMethod::Exact) => (medium::solve_at(self.mu0, omega, absorbed, delta), Status::Ok),
            (None, SlabMethod::Fn) => {
                let a = fn_method::solve(omega, absorbed, delta, FN_TOLERANCE);
                if a.change <= FN_SETTLED {
                    (a.response, Status::Ok)
                } else {
                    let what =
                        format!("rho_d; rho_t: order {} differs from the one before by {:.1e}", a.order, a.change);
                    (a.response, Status::Undetermined(what))
                }
            }
        }
    }
}

/// ω and 1−ω with all their digits, or why there is no such slab.
fn albedo(omega: f64, delta: f64, one_minus_omega: f64) -> Result<(f64, f64), String> {
    if !(0.0..=1.0).contains(&omega) {
        return Err(format!("omega is {omega}; expected 0 to 1"));
    }
    if !(delta >= 0.0 && delta.is_finite()) {
        return Err(format!("delta is {delta}; expected 0 or more"));
    }
    for (name, value) in [("omega", omega), ("delta", delta)] {
        if value != 0.0 && value < SMALLEST {
            return Err(format!(
                "{name} is {value:e}; expected 0 or at least {SMALLEST:e}, below which numbers lose their digits"
            ));
        }
    }
    let absorbed = if one_minus_omega.is_nan() { 1.0 - omega } else { one_minus_omega };
    if !(absorbed >= 0.0 && (omega + absorbed - 1.0).abs() < 1e-9) {
        return Err(format!("one_minus_omega is {absorbed} beside omega {omega}; expected their sum to be 1"));
    }
    // One of the two carries the digits: 1−ω near 1, ω near 0.
    Ok((if absorbed < 0.5 { 1.0 - absorbed } else { omega }, absorbed))
}
