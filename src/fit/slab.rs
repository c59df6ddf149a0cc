//! σa and σs of a slab from measured (ρd, ρt, thickness), one row at a time. `mesophyll fit slab` does this to each
//! row.
//!
//! Units: thickness in mm, σ in 1/mm, errors absolute standard errors.

use mesophyll_files::table::{Answer, Status};
use mesophyll_optics::slab::inverse::{self, Precision};

/// How rows are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// How exactly the slab is computed.
    pub precision: Precision,
    /// Standard error of ρd and ρt where a row has none of its own; 0 for exact values, `None` where nobody stated it.
    pub noise: Option<f64>,
    /// The share of the measured ρd that the surface reflects before light enters the slab; it is subtracted.
    pub surface: f64,
}

/// Standard error that an inversion takes where none was stated, to tell which slabs can be found at all. No error is
/// printed for it.
pub const ASSUMED_NOISE: f64 = 1e-6;

/// Output columns of [`answer`].
pub const OUTPUTS: [&str; 4] = ["sigma_a", "sigma_s", "sigma_a_err", "sigma_s_err"];

/// One measurement; an error that is NaN was not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Diffuse reflectance ρd, 0 to 1.
    pub rho_d: f64,
    /// Transmittance ρt, 0 to 1.
    pub rho_t: f64,
    /// Thickness (mm).
    pub thickness_mm: f64,
    /// Standard error of ρd.
    pub rho_d_err: f64,
    /// Standard error of ρt.
    pub rho_t_err: f64,
}

impl Measured {
    /// Whether both standard errors are known, from the row or from the options.
    pub fn noise_is_stated(&self, options: &Options) -> bool {
        options.noise.is_some() || !(self.rho_d_err.is_nan() || self.rho_t_err.is_nan())
    }
}

/// Inverts one measurement: the values of [`OUTPUTS`], NaN where there is none, and how it ended.
///
/// Where no noise is stated nothing is known of the errors, so they are NaN. The status then only says whether the
/// numbers belong to a slab and can be inverted: `ok`, or what stays open at a noise of [`ASSUMED_NOISE`].
pub fn found(options: &Options, m: &Measured) -> ([f64; 4], Status) {
    let stated = m.noise_is_stated(options);
    let or_noise = |err: f64| if err.is_nan() { options.noise.unwrap_or(ASSUMED_NOISE) } else { err };
    let (rho_d, [d_err, t_err]) = (m.rho_d - options.surface, [m.rho_d_err, m.rho_t_err].map(or_noise));
    let e = inverse::invert_with(options.precision, rho_d, m.rho_t, m.thickness_mm, d_err, t_err);
    let errors = if stated { [e.sigma_a_err, e.sigma_s_err] } else { [f64::NAN; 2] };
    let status = match e.status {
        Status::Undetermined(what) if !stated => {
            Status::Undetermined(format!("{what} (judged at a noise of {ASSUMED_NOISE:e}; none was stated)"))
        }
        status => status,
    };
    ([e.sigma_a, e.sigma_s, errors[0], errors[1]], status)
}

/// [`found`] as the row of a batch.
pub fn answer(options: &Options, m: &Measured) -> Answer {
    match found(options, m) {
        (_, Status::Refused(why)) => Answer::refused(why),
        (values, status) => Answer { values: values.to_vec(), status },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAF: Measured =
        Measured { rho_d: 0.3, rho_t: 0.2, thickness_mm: 0.2, rho_d_err: f64::NAN, rho_t_err: f64::NAN };

    fn with(noise: Option<f64>, m: Measured) -> Answer {
        answer(&Options { precision: Precision::Fast, noise, surface: 0.0 }, &m)
    }

    /// Without stated noise the numbers are those of exact input, and no error is claimed.
    #[test]
    fn errors_are_empty_without_noise() {
        let (unstated, exact, noisy) = (with(None, LEAF), with(Some(0.0), LEAF), with(Some(5e-3), LEAF));
        assert!(unstated.values[2].is_nan() && unstated.values[3].is_nan() && unstated.status == Status::Ok);
        for k in 0..2 {
            assert!((unstated.values[k] / exact.values[k] - 1.0).abs() < 1e-9);
            assert!(
                exact.values[2 + k] < 1e-6 * exact.values[k],
                "exact values leave the model's own error only: {exact:?}"
            );
            assert!(noisy.values[2 + k] > 1e-3 * noisy.values[k]);
        }
        // One error alone does not say how sure σ is.
        assert!(with(None, Measured { rho_d_err: 1e-3, ..LEAF }).values[2].is_nan());
        let both = with(None, Measured { rho_d_err: 5e-3, rho_t_err: 5e-3, ..LEAF });
        assert_eq!(both, noisy);
    }

    #[test]
    fn what_cannot_be_inverted_is_named_without_noise_too() {
        let opaque = with(None, Measured { rho_t: 0.0, ..LEAF });
        assert!(
            opaque.status.leaves_open("sigma_a") && opaque.status.to_string().contains("none was stated"),
            "{opaque:?}"
        );
        assert!(opaque.values[2].is_nan());
        assert!(matches!(with(None, Measured { rho_d: 0.9, rho_t: 0.5, ..LEAF }).status, Status::Refused(_)));
    }
}
