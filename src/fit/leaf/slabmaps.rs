//! σa and σs a texel and channel: the slab inverted with the texel's own thickness (the pigment representation).
//!
//! Their errors hold the noise of the texel's ρd and ρt and that of its thickness, which is found from the same ρt of all three channels. They do
//! not hold what all texels share: the caliper's reading, and the errors of the leaf's own σa and σs.

use crate::fit::leaf::curve::Incidence;
use crate::fit::leaf::wide::Local;
use crate::optics::slab;
use crate::optics::slab::inverse;

/// σa, σs (1/mm) and their standard errors; NaN where the slab cannot be inverted at all.
#[derive(Debug, Clone, Copy)]
pub struct Sigma {
    pub value: [f64; 2],
    pub error: [f64; 2],
}

const UNKNOWN: Sigma = Sigma { value: [f64::NAN; 2], error: [f64::NAN; 2] };

impl Sigma {
    /// Adds the noise of the texel's thickness. σ = X(ρd, ρt)/thickness, and the thickness moves with `local.pull` times the same ρt, so that
    /// var σ = σ² (var ln X + var ln t − 2 cov(ln X, ln t)). `rho_t_err` is the standard error of this channel's ρt, `to_normal` what ρt is along
    /// the normal over what it was measured as.
    fn with_thickness(self, local: &Local, c: usize, thickness: f64, rho_t_err: f64, to_normal: f64) -> Sigma {
        let [a, s] = self.value;
        let (_, p) = slab::response_with_partials(a, s, thickness);
        let determinant = p.sigma_a.rho_d * p.sigma_s.rho_t - p.sigma_s.rho_d * p.sigma_a.rho_t;
        let by_rho_t = [-p.sigma_s.rho_d / determinant, p.sigma_a.rho_d / determinant].map(|d| d * to_normal);
        let spread = (local.thickness_err / local.thickness).powi(2);
        let error = [0, 1].map(|q: usize| {
            let shared = self.value[q] * by_rho_t[q] * local.pull[c] * rho_t_err * rho_t_err;
            (self.error[q].powi(2) + self.value[q].powi(2) * spread - 2.0 * shared).max(0.0).sqrt()
        });
        Sigma { value: self.value, error }
    }
}

/// Inverts slabs whose transmittance was measured at one incidence.
#[derive(Debug)]
pub struct Inverter {
    oblique: Option<Oblique>,
}

impl Inverter {
    pub fn new(incidence: Incidence) -> Inverter {
        Inverter { oblique: (incidence.0 != 1.0).then(|| Oblique::new(incidence.0)) }
    }

    /// σ of one texel and channel `c`, its thickness found from its own ρt; `error` are the standard errors of (ρd, ρt).
    pub fn invert_fitted(&self, rho_d: f64, rho_t: f64, thickness: f64, error: [f64; 2], local: &Local, c: usize) -> Sigma {
        let found = self.invert(rho_d, rho_t, thickness, error);
        let to_normal = self.oblique.as_ref().map_or(1.0, |o| (-o.ratio(found.value[0], found.value[1], thickness)).exp());
        // Where ρd and ρt alone bound nothing, a thickness adds nothing.
        if found.error.iter().all(|e| e.is_finite()) { found.with_thickness(local, c, thickness, error[1], to_normal) } else { found }
    }

    /// σ at a thickness that is taken as exact; `error` are the standard errors of (ρd, ρt).
    pub fn invert(&self, rho_d: f64, rho_t: f64, thickness: f64, error: [f64; 2]) -> Sigma {
        let solve = |t: f64, te: f64| {
            let e = inverse::invert(rho_d, t, thickness, error[0], te);
            if e.sigma_a.is_finite() && e.sigma_s.is_finite() {
                Sigma { value: [e.sigma_a, e.sigma_s], error: [e.sigma_a_err, e.sigma_s_err] }
            } else {
                UNKNOWN
            }
        };
        let Some(oblique) = &self.oblique else { return solve(rho_t, error[1]) };
        // ρt at normal incidence = ρt measured · exp(−q(ω, Δ)): a fixed point, since q follows from what it leads to.
        let mut q = 0.0;
        let mut found = UNKNOWN;
        for _ in 0..60 {
            let scale = f64::exp(-q);
            found = solve(rho_t * scale, error[1] * scale);
            if found.value[0].is_nan() {
                // The first guess may exceed what any slab transmits; move towards it with the grid's thin end.
                if q == 0.0 {
                    q = oblique.thinnest();
                    continue;
                }
                return UNKNOWN;
            }
            let [a, s] = found.value;
            let next = oblique.ratio(a, s, thickness);
            if (next - q).abs() < 1e-9 {
                break;
            }
            q = next;
        }
        found
    }
}

/// q = ln ρt(μ₀) − ln ρt(1) on a grid over (logit ω, ln Δ), interpolated by cubics through the four nearest nodes each way.
#[derive(Debug)]
struct Oblique {
    q: Vec<f64>,
}

const OMEGA: [f64; 2] = [-4.0, 8.0];
const DELTA: [f64; 2] = [-4.6, 4.0];
const SIZE: [usize; 2] = [49, 70];

impl Oblique {
    fn new(mu0: f64) -> Oblique {
        use rayon::prelude::*;
        let q = (0..SIZE[0] * SIZE[1])
            .into_par_iter()
            .map(|k| {
                let logit = OMEGA[0] + (OMEGA[1] - OMEGA[0]) * (k / SIZE[1]) as f64 / (SIZE[0] - 1) as f64;
                let delta = (DELTA[0] + (DELTA[1] - DELTA[0]) * (k % SIZE[1]) as f64 / (SIZE[1] - 1) as f64).exp();
                let omega = 1.0 / (1.0 + (-logit).exp());
                let oblique = slab::exact::response_at(mu0, delta * (1.0 - omega), delta * omega, 1.0).rho_t;
                let normal = slab::exact::response(delta * (1.0 - omega), delta * omega, 1.0).rho_t;
                (oblique.max(f64::MIN_POSITIVE) / normal.max(f64::MIN_POSITIVE)).ln()
            })
            .collect();
        Oblique { q }
    }

    fn thinnest(&self) -> f64 {
        self.q[SIZE[1] / 2]
    }

    fn ratio(&self, sigma_a: f64, sigma_s: f64, thickness: f64) -> f64 {
        let place =
            |v: f64, range: [f64; 2], n: usize| ((v - range[0]) / (range[1] - range[0]) * (n - 1) as f64).clamp(0.0, (n - 1) as f64);
        let x = place((sigma_s / sigma_a.max(1e-300)).ln(), OMEGA, SIZE[0]);
        let y = place(((sigma_a + sigma_s) * thickness).ln(), DELTA, SIZE[1]);
        let (i, u) = cubic(x, SIZE[0]);
        let (j, v) = cubic(y, SIZE[1]);
        (0..4).map(|a| u[a] * (0..4).map(|b| v[b] * self.q[(i + a) * SIZE[1] + j + b]).sum::<f64>()).sum()
    }
}

/// First of the four nodes around `x` of a unit grid of `n`, and Lagrange's weights for them.
fn cubic(x: f64, n: usize) -> (usize, [f64; 4]) {
    let first = (x as usize).saturating_sub(1).min(n - 4);
    let t = x - first as f64;
    let weight = |k: usize| (0..4).filter(|&m| m != k).map(|m| (t - m as f64) / (k as f64 - m as f64)).product();
    (first, [0, 1, 2, 3].map(weight))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_oblique_light_box_gives_the_same_leaf() {
        let mu0 = 55f64.to_radians().cos();
        let inverter = Inverter::new(Incidence(mu0));
        for (a, s) in [(2.6, 16.0), (9.0, 18.0)] {
            let r = slab::exact::response(a, s, 0.2);
            let t = slab::exact::response_at(mu0, a, s, 0.2).rho_t;
            let found = inverter.invert(r.rho_d, t, 0.2, [1e-5; 2]);
            assert!((found.value[0] / a - 1.0).abs() < 2e-4 && (found.value[1] / s - 1.0).abs() < 2e-4, "{found:?}");
        }
    }
}
