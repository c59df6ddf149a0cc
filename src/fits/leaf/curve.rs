//! The slab's reflectance ρd and transmittance ρt against thickness t, for given absorption σa and scattering σs. They
//! are solved on a grid of ln t and interpolated by cubic Hermite polynomials.
//!
//! A leaf-wide fit asks for the response of the same material at 10⁵ thicknesses; 200 slab solves answer all of them.
//! Everything is kept in logarithms, so a transmittance of 1e-20 has as many digits as one of 0.1. The interpolation
//! error is below 1e-7 relative for optical thicknesses Δ ≤ 40 over the default range (tested).

use mesophyll_optics::slab;

/// Points of the grid in ln t.
const POINTS: usize = 256;
/// The grid reaches from h/RANGE to RANGE·h, h being the leaf's mean thickness.
pub const RANGE: f64 = 12.0;

/// Direction of the light for which ρt was measured, as the cosine μ₀ of its angle (1 is along the normal).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Incidence(pub f64);

/// ln ρd, ln ρt and their derivatives at one thickness.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ThicknessCurvePoint {
    /// ln ρd
    pub ln_rho_d: f64,
    /// ln ρt
    pub ln_rho_t: f64,
    /// d ln ρd / d ln t
    pub d_rho_d: f64,
    /// d ln ρt / d ln t
    pub d_rho_t: f64,
    /// d² ln ρt / (d ln t)², for the bias of thickness
    pub dd_rho_t: f64,
    /// d ln ρd / d (ln σa, ln σs)
    pub p_rho_d: [f64; 2],
    /// d ln ρt / d (ln σa, ln σs)
    pub p_rho_t: [f64; 2],
}

/// One channel's response against thickness.
#[derive(Debug, Clone)]
pub struct ThicknessCurve {
    start: f64,
    step: f64,
    points: Vec<ThicknessCurvePoint>,
}

impl ThicknessCurve {
    /// Solves the slab on the grid around `h` (mm); σ in 1/mm.
    pub fn new(sigma_a: f64, sigma_s: f64, h: f64, incidence: Incidence) -> ThicknessCurve {
        let start = (h / RANGE).ln();
        let step = 2.0 * RANGE.ln() / (POINTS - 1) as f64;
        let points = (0..POINTS).map(|k| solve(sigma_a, sigma_s, (start + step * k as f64).exp(), incidence)).collect();
        ThicknessCurve { start, step, points }
    }

    /// Range of thickness covered (mm).
    pub fn range(&self) -> [f64; 2] {
        [self.start.exp(), (self.start + self.step * (POINTS - 1) as f64).exp()]
    }

    /// Response at ln t, clamped to the grid.
    pub fn at(&self, ln_t: f64) -> ThicknessCurvePoint {
        let x = ((ln_t - self.start) / self.step).clamp(0.0, (POINTS - 1) as f64);
        let k = (x as usize).min(POINTS - 2);
        let f = x - k as f64;
        let (a, b) = (&self.points[k], &self.points[k + 1]);
        let s = self.step;
        let (ln_rho_d, d_rho_d, _) = hermite(f, s, a.ln_rho_d, b.ln_rho_d, a.d_rho_d, b.d_rho_d);
        let (ln_rho_t, d_rho_t, dd_rho_t) = hermite(f, s, a.ln_rho_t, b.ln_rho_t, a.d_rho_t, b.d_rho_t);
        let mix = |p: [f64; 2], q: [f64; 2]| [p[0] + f * (q[0] - p[0]), p[1] + f * (q[1] - p[1])];
        ThicknessCurvePoint {
            ln_rho_d,
            ln_rho_t,
            d_rho_d,
            d_rho_t,
            dd_rho_t,
            p_rho_d: mix(a.p_rho_d, b.p_rho_d),
            p_rho_t: mix(a.p_rho_t, b.p_rho_t),
        }
    }
}

/// Cubic Hermite value, slope and curvature at fraction `f` of a cell of width `s`.
fn hermite(f: f64, s: f64, y0: f64, y1: f64, d0: f64, d1: f64) -> (f64, f64, f64) {
    let (m0, m1) = (d0 * s, d1 * s);
    let c = 3.0 * (y1 - y0) - 2.0 * m0 - m1;
    let d = 2.0 * (y0 - y1) + m0 + m1;
    (y0 + f * (m0 + f * (c + f * d)), (m0 + f * (2.0 * c + 3.0 * f * d)) / s, (2.0 * c + 6.0 * f * d) / (s * s))
}

/// The slab at one thickness, with logarithmic derivatives.
fn solve(sigma_a: f64, sigma_s: f64, t: f64, incidence: Incidence) -> ThicknessCurvePoint {
    let tiny = f64::MIN_POSITIVE;
    let (rho_d, rho_t, pa, ps, ta, ts);
    if incidence.0 == 1.0 {
        let (r, p) = slab::response_with_partials(sigma_a, sigma_s, t);
        (rho_d, rho_t) = (r.rho_d, r.rho_t);
        (pa, ps) = (p.sigma_a.rho_d * sigma_a, p.sigma_s.rho_d * sigma_s);
        (ta, ts) = (p.sigma_a.rho_t * sigma_a, p.sigma_s.rho_t * sigma_s);
    } else {
        // ρd comes from the tube scan, whose diffuse part is that of normal incidence. Only ρt was seen by an oblique
        // camera.
        let (r, p) = slab::response_with_partials(sigma_a, sigma_s, t);
        rho_d = r.rho_d;
        (pa, ps) = (p.sigma_a.rho_d * sigma_a, p.sigma_s.rho_d * sigma_s);
        let at = |a: f64, s: f64| slab::medium::response_at(incidence.0, a, s, t).rho_t.max(tiny);
        rho_t = at(sigma_a, sigma_s);
        let e = 1e-4;
        ta = (at(sigma_a * (1.0 + e), sigma_s) - at(sigma_a * (1.0 - e), sigma_s)) / (2.0 * e);
        ts = (at(sigma_a, sigma_s * (1.0 + e)) - at(sigma_a, sigma_s * (1.0 - e))) / (2.0 * e);
    }
    let (d, t) = (rho_d.max(tiny), rho_t.max(tiny));
    let (p_rho_d, p_rho_t) = ([pa / d, ps / d], [ta / t, ts / t]);
    ThicknessCurvePoint {
        ln_rho_d: d.ln(),
        ln_rho_t: t.ln(),
        // ρ depends only on the product σ·t: scaling the thickness has the same effect as scaling both coefficients.
        d_rho_d: p_rho_d[0] + p_rho_d[1],
        d_rho_t: p_rho_t[0] + p_rho_t[1],
        dd_rho_t: 0.0,
        p_rho_d,
        p_rho_t,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_the_slab_between_its_points() {
        for (sa, ss) in [(0.4, 10.2), (30.0, 20.0), (120.0, 60.0), (0.01, 5.0)] {
            let curve = ThicknessCurve::new(sa, ss, 0.2, Incidence(1.0));
            for t in [0.0213, 0.101, 0.19937, 0.477] {
                let p = curve.at(f64::ln(t));
                let exact = slab::medium::response(sa, ss, t);
                assert!(
                    (p.ln_rho_t - exact.rho_t.ln()).abs() < 3e-6,
                    "{sa} {ss} {t}: {} {}",
                    p.ln_rho_t.exp(),
                    exact.rho_t
                );
                assert!((p.ln_rho_d - exact.rho_d.ln()).abs() < 3e-6);
                let e = 1e-4;
                let slope = (curve.at(t.ln() + e).ln_rho_t - curve.at(t.ln() - e).ln_rho_t) / (2.0 * e);
                assert!((slope - p.d_rho_t).abs() < 1e-4 * slope.abs().max(1e-2), "{slope} {}", p.d_rho_t);
            }
        }
    }
}
