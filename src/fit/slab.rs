//! σa and σs of a slab from measured (ρd, ρt, thickness), one row at a time: what `mesophyll fit slab` does to each row.
//!
//! Units: thickness in mm, σ in 1/mm, errors absolute standard errors.

use crate::files::table::{Answer, Status};
use crate::optics::slab::inverse::{self, Estimate, Precision, Verdict};

/// How rows are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    pub precision: Precision,
    /// Standard error of ρd and ρt where a row has none of its own.
    pub noise: f64,
    /// What the surface reflects of the measured ρd before light enters the slab; it is taken off.
    pub surface: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options { precision: Precision::Fast, noise: 1e-6, surface: 0.0 }
    }
}

/// Output columns of [`answer`].
pub const OUTPUTS: [&str; 4] = ["sigma_a", "sigma_s", "sigma_a_err", "sigma_s_err"];

/// Inverts one measurement; an error that is NaN stands for the options' noise.
pub fn fit(options: &Options, rho_d: f64, rho_t: f64, thickness_mm: f64, rho_d_err: f64, rho_t_err: f64) -> Estimate {
    let or_noise = |err: f64| if err.is_nan() { options.noise } else { err };
    inverse::invert_with(options.precision, rho_d - options.surface, rho_t, thickness_mm, or_noise(rho_d_err), or_noise(rho_t_err))
}

/// The row of a batch that says what [`fit`] found.
pub fn answer(e: &Estimate) -> Answer {
    let values = vec![e.sigma_a, e.sigma_s, e.sigma_a_err, e.sigma_s_err];
    match &e.status {
        Verdict::Ok => Answer::ok(values),
        Verdict::Undetermined(what) => Answer { values, status: Status::Undetermined(what.clone()) },
        Verdict::Refused(why) => Answer::refused(why.clone()),
    }
}
