//! The leaf's interior: LEAFMOD's slab (Ganapol et al. 1998; Wang et al. 2005 §3).
//!
//! The slab is plane-parallel and homogeneous, scatters isotropically, has the index of its surroundings, is lit by a
//! collimated normal beam, and has a black ground below. With σt = σa + σs, single-scattering albedo ω = σs/σt and
//! optical thickness Δ = σt h, h being the thickness, the radiance I obeys `[μ ∂/∂τ + 1] I = (ω/2) ∫ I dμ′`, I(0, μ) =
//! δ(μ−1), I(Δ, −μ) = 0. ρd and ρt are the reflected and transmitted fractions of the flux; ρt includes the unscattered
//! e^(−Δ). Units: σ in 1/mm, thickness in mm. Any ω in [0, 1] and any Δ ≥ 0 are allowed.
//!
//! Three ways lead from σ to ρ: [`response`] is fast (relative error 1e-6), [`medium`] gives nine digits, and
//! [`fn_method`] is the paper's own method. [`inverse`] leads from ρ back to σ. [`faces`] is the slab of another index
//! than its surroundings, whose faces reflect.

// Matrices and pairs are indexed as the formulas index them; a negated comparison is how NaN is kept out.
#![allow(clippy::needless_range_loop, clippy::neg_cmp_op_on_partial_ord)]

pub mod chebyshev;
pub mod curve;
pub mod expint;
pub mod faces;
pub mod fn_method;
pub mod inverse;
pub mod medium;
pub mod mirror;
pub mod ordinates;
pub mod quadrature;
mod roots;
pub mod table;
pub mod thin_slab;
pub mod verdict;

/// Diffuse reflectance and total transmittance of the slab.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlabResponse {
    /// Diffuse reflectance ρd.
    pub rho_d: f64,
    /// Transmittance ρt of a beam along the normal.
    pub rho_t: f64,
}

/// Derivatives of a [`SlabResponse`] with respect to σa (mm), σs (mm) and the thickness (1/mm).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlabPartials {
    /// By σa.
    pub sigma_a: SlabResponse,
    /// By σs.
    pub sigma_s: SlabResponse,
    /// By the thickness.
    pub thickness: SlabResponse,
}

impl SlabResponse {
    const UNKNOWN: SlabResponse = SlabResponse { rho_d: f64::NAN, rho_t: f64::NAN };
}

/// ρd and ρt; σ in 1/mm, thickness in mm, all ≥ 0 and finite (NaN otherwise).
///
/// Relative error of both below 1e-8 (2e-10 for Δ < 4, and for ρt down to 1e-30); a beam that meets nothing passes
/// unchanged.
pub fn response(sigma_a: f64, sigma_s: f64, thickness_mm: f64) -> SlabResponse {
    let mut r = response_with_partials(sigma_a, sigma_s, thickness_mm).0;
    let depth = (sigma_a + sigma_s) * thickness_mm;
    // Where almost nothing comes through, the table loses its digits; but ρt is at least the light that meets nothing.
    if depth > 60.0 {
        r.rho_t = r.rho_t.max((-depth).exp());
    }
    r
}

/// [`response`] and its derivatives.
pub fn response_with_partials(sigma_a: f64, sigma_s: f64, thickness_mm: f64) -> (SlabResponse, SlabPartials) {
    let sigma_t = sigma_a + sigma_s;
    if !(sigma_a >= 0.0 && sigma_s >= 0.0 && thickness_mm >= 0.0 && (sigma_t * thickness_mm).is_finite()) {
        return (
            SlabResponse::UNKNOWN,
            SlabPartials {
                sigma_a: SlabResponse::UNKNOWN,
                sigma_s: SlabResponse::UNKNOWN,
                thickness: SlabResponse::UNKNOWN,
            },
        );
    }
    if sigma_t == 0.0 {
        let partials = SlabPartials {
            sigma_a: SlabResponse { rho_d: 0.0, rho_t: -thickness_mm },
            sigma_s: SlabResponse { rho_d: 0.5 * thickness_mm, rho_t: -0.5 * thickness_mm },
            thickness: SlabResponse { rho_d: 0.0, rho_t: 0.0 },
        };
        return (SlabResponse { rho_d: 0.0, rho_t: 1.0 }, partials);
    }
    let (omega, absorbed) = (sigma_s / sigma_t, sigma_a / sigma_t);
    let (at, d) = reduced(omega, absorbed, sigma_t * thickness_mm);
    // ω, 1−ω and Δ by σa, σs and h
    let along = |absorbed_by: f64, delta_by: f64| SlabResponse {
        rho_d: d[0].rho_d * absorbed_by + d[1].rho_d * delta_by,
        rho_t: d[0].rho_t * absorbed_by + d[1].rho_t * delta_by,
    };
    let partials = SlabPartials {
        sigma_a: along(omega / sigma_t, thickness_mm),
        sigma_s: along(-absorbed / sigma_t, thickness_mm),
        thickness: along(0.0, sigma_t),
    };
    (at, partials)
}

/// ρd and ρt at single-scattering albedo ω (1 − ω is passed separately) and optical thickness Δ > 0, with the
/// derivatives by 1−ω and by Δ.
pub fn reduced(omega: f64, one_minus_omega: f64, delta: f64) -> (SlabResponse, [SlabResponse; 2]) {
    if !(table::DELTA_MIN..=table::DELTA_MAX).contains(&delta) {
        return beyond_table(omega, one_minus_omega, delta);
    }
    let s = table::SlabTable::committed().at(one_minus_omega, delta);
    // ρd = ω h(Δ) G₁ with h = Δ/(1+Δ); ρt = e^(−Δ G₂)
    let h = delta / (1.0 + delta);
    let h_by = h / (delta * (1.0 + delta));
    let mut at = SlabResponse { rho_d: omega * h * s.g[0], rho_t: (-delta * s.g[1]).exp() };
    let by_absorbed =
        SlabResponse { rho_d: h * (omega * s.by_absorbed[0] - s.g[0]), rho_t: -at.rho_t * delta * s.by_absorbed[1] };
    let by_delta = SlabResponse {
        rho_d: omega * (h_by * s.g[0] + h * s.by_delta[0]),
        rho_t: -at.rho_t * (s.g[1] + delta * s.by_delta[1]),
    };
    if one_minus_omega == 0.0 {
        at.conserve();
    }
    (at, [by_absorbed, by_delta])
}

impl SlabResponse {
    /// Light that is not reflected is transmitted. The smaller of the two keeps its relative accuracy.
    pub(crate) fn conserve(&mut self) {
        if self.rho_d < self.rho_t { self.rho_t = 1.0 - self.rho_d } else { self.rho_d = 1.0 - self.rho_t }
    }
}

/// Slabs thinner than the table's range use a series expansion. Thicker ones use the exact solution with central
/// differences; it is smooth there, and rarely needed.
fn beyond_table(omega: f64, absorbed: f64, delta: f64) -> (SlabResponse, [SlabResponse; 2]) {
    if delta < table::DELTA_MIN {
        return table::thin_series(omega, absorbed, delta);
    }
    let f = |a: f64, d: f64| medium::solve(1.0 - a, a, d);
    let difference = |low: SlabResponse, high: SlabResponse, width: f64| SlabResponse {
        rho_d: (high.rho_d - low.rho_d) / width,
        rho_t: (high.rho_t - low.rho_t) / width,
    };
    let at = medium::solve(omega, absorbed, delta);
    let step = (1e-3 * absorbed).max(1e-4 / (delta * delta));
    let (low, high) = ((absorbed - step).max(0.0), (absorbed + step).min(1.0));
    let by_absorbed = difference(f(low, delta), f(high, delta), high - low);
    let by_delta = difference(f(absorbed, delta * (1.0 - 1e-4)), f(absorbed, delta * (1.0 + 1e-4)), delta * 2e-4);
    (at, [by_absorbed, by_delta])
}

#[cfg(test)]
mod tests;
