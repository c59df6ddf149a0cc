//! The slab with nine digits or more. Thin slabs are solved as an integral equation ([`thin`](super::thin_slab)), all
//! others by discrete ordinates in closed form ([`ordinates`](super::ordinates)).
//!
//! The two methods share no formula. Between optical thicknesses Δ = 1e-3 and 0.2 both are valid and agree to better
//! than 1e-9; a test compares them.

use super::{SlabResponse, ordinates, thin_slab};
use std::sync::OnceLock;

/// Below this optical thickness the integral equation is used, above it the ordinates (here both are good to 1e-10).
const THIN: f64 = 0.06;

/// ρd and ρt at normal incidence; σ in 1/mm, thickness in mm. Inputs are finite and ≥ 0; otherwise NaN.
pub fn response(sigma_a: f64, sigma_s: f64, thickness_mm: f64) -> SlabResponse {
    response_at(1.0, sigma_a, sigma_s, thickness_mm)
}

/// The same for a collimated beam at cosine `mu0` (0 < mu0 ≤ 1) that carries unit flux through a horizontal surface.
pub fn response_at(mu0: f64, sigma_a: f64, sigma_s: f64, thickness_mm: f64) -> SlabResponse {
    let sigma_t = sigma_a + sigma_s;
    if sigma_t == 0.0 {
        return solve_at(mu0, 0.0, 1.0, 0.0);
    }
    solve_at(mu0, sigma_s / sigma_t, sigma_a / sigma_t, sigma_t * thickness_mm)
}

/// ρd and ρt at single-scattering albedo ω and optical thickness Δ, for normal incidence. 1 − ω is passed separately,
/// so that it keeps its digits where ω is near 1.
pub fn solve(omega: f64, one_minus_omega: f64, delta: f64) -> SlabResponse {
    solve_at(1.0, omega, one_minus_omega, delta)
}

/// [`solve`] for a beam at cosine `mu0`.
pub fn solve_at(mu0: f64, omega: f64, one_minus_omega: f64, delta: f64) -> SlabResponse {
    let (rho_d, log_t) = solve_log(mu0, omega, one_minus_omega, delta);
    let mut r = SlabResponse { rho_d, rho_t: log_t.exp() };
    if one_minus_omega == 0.0 {
        r.conserve();
    }
    r
}

/// ρd and ln ρt. The logarithm stays finite where ρt itself underflows.
pub fn solve_log(mu0: f64, omega: f64, one_minus_omega: f64, delta: f64) -> (f64, f64) {
    SlabMedium::new(omega, one_minus_omega).solve_log(mu0, delta)
}

/// One single-scattering albedo, for slabs of many thicknesses. Finding the modes is most of the work; they do not
/// depend on the thickness and are found once.
pub struct SlabMedium {
    omega: f64,
    one_minus_omega: f64,
    modes: OnceLock<Box<ordinates::OrdinateModes<{ ordinates::N }>>>,
}

impl SlabMedium {
    /// `one_minus_omega` is passed separately, so that it keeps its digits near ω = 1.
    pub fn new(omega: f64, one_minus_omega: f64) -> SlabMedium {
        SlabMedium { omega, one_minus_omega, modes: OnceLock::new() }
    }

    /// [`solve_log`] in this medium.
    pub fn solve_log(&self, mu0: f64, delta: f64) -> (f64, f64) {
        let (omega, one_minus_omega) = (self.omega, self.one_minus_omega);
        let known = omega >= 0.0 && one_minus_omega >= 0.0 && (omega + one_minus_omega - 1.0).abs() < 1e-9;
        if !(known && delta >= 0.0 && mu0 > 0.0 && mu0 <= 1.0) {
            return (f64::NAN, f64::NAN);
        }
        if delta == 0.0 || omega == 0.0 {
            return (0.0, -delta / mu0);
        }
        let delta = delta.min(1e300);
        if delta / mu0 < THIN {
            let r = thin_slab::solve(omega, delta, mu0);
            (r.rho_d, r.rho_t.ln())
        } else {
            self.modes.get_or_init(|| Box::new(ordinates::modes(omega, one_minus_omega))).response(delta, mu0)
        }
    }
}
