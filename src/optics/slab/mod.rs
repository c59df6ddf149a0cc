//! The leaf's interior: LEAFMOD's slab (Ganapol et al. 1998; Wang et al. 2005 §3).
//!
//! A plane-parallel homogeneous slab, isotropic scattering, index-matched, lit by a collimated normal beam, black below:
//! `[μ ∂/∂τ + 1] I = (ω/2) ∫ I dμ′`, I(0, μ) = δ(μ−1), I(Δ, −μ) = 0, with σt = σa + σs, ω = σs/σt, Δ = σt h.
//! ρd and ρt are the reflected and transmitted fractions of the flux (ρt with the unscattered e^(−Δ)).
//! Units: σ in 1/mm, thickness in mm. Any ω in [0, 1], any Δ ≥ 0.
//!
//! [`response`] is fast, [`exact`] the nine-digit one, [`fn_method`] the paper's; [`inverse`] goes back.

pub mod exact;
pub mod expint;
pub mod inverse;
pub mod ordinates;
pub mod quadrature;
pub mod thin;

/// Diffuse reflectance and total transmittance of the slab.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    pub rho_d: f64,
    pub rho_t: f64,
}

/// Derivatives of a [`Response`] with respect to σa (mm), σs (mm) and the thickness (1/mm).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Partials {
    pub sigma_a: Response,
    pub sigma_s: Response,
    pub thickness: Response,
}

/// ρd and ρt; σ in 1/mm, thickness in mm, all finite and ≥ 0 (NaN otherwise).
pub fn response(sigma_a: f64, sigma_s: f64, thickness_mm: f64) -> Response {
    exact::response(sigma_a, sigma_s, thickness_mm)
}

/// [`response`] and its derivatives.
pub fn response_with_partials(sigma_a: f64, sigma_s: f64, thickness_mm: f64) -> (Response, Partials) {
    let at = response(sigma_a, sigma_s, thickness_mm);
    let floor = 1e-6 * (sigma_a + sigma_s);
    let slope = |x: f64, f: &dyn Fn(f64) -> Response| {
        let step = (1e-4 * x).max(floor);
        let (low, high) = ((x - step).max(0.0), x + step);
        let (a, b) = (f(low), f(high));
        Response { rho_d: (b.rho_d - a.rho_d) / (high - low), rho_t: (b.rho_t - a.rho_t) / (high - low) }
    };
    let partials = Partials {
        sigma_a: slope(sigma_a, &|x| response(x, sigma_s, thickness_mm)),
        sigma_s: slope(sigma_s, &|x| response(sigma_a, x, thickness_mm)),
        thickness: slope(thickness_mm, &|x| response(sigma_a, sigma_s, x)),
    };
    (at, partials)
}
