//! σa and σs of each texel and channel: the slab is inverted with the texel's own thickness (the pigment
//! representation).
//!
//! The errors include the noise of the texel's ρd and ρt, and that of its thickness, which is found from the same ρt of
//! all three channels. They do not include what all texels share: the error of the caliper's reading, and the errors of
//! the leaf's own σa and σs.

use crate::leaf::curve::Incidence;
use crate::leaf::leaf_wide::TexelInterior;
use mesophyll_optics::slab;
use mesophyll_optics::slab::inverse;
use nalgebra::Matrix2;

/// σa, σs (1/mm) and their standard errors; NaN where the slab cannot be inverted at all.
#[derive(Debug, Clone, Copy)]
pub struct SigmaEstimate {
    pub value: [f64; 2],
    pub error: [f64; 2],
}

const UNKNOWN: SigmaEstimate = SigmaEstimate { value: [f64::NAN; 2], error: [f64::NAN; 2] };

/// What was measured of one texel and channel whose thickness was found from its own ρt.
#[derive(Debug, Clone, Copy)]
pub struct FittedReading {
    pub rho_d: f64,
    pub rho_t: f64,
    /// Standard errors of (ρd, ρt).
    pub error: [f64; 2],
    /// Covariance of the two.
    pub covariance: f64,
}

/// Inverts slabs whose transmittance was measured at one incidence.
#[derive(Debug)]
pub struct SlabInverter {
    oblique: Option<Oblique>,
}

impl SlabInverter {
    pub fn new(incidence: Incidence) -> SlabInverter {
        SlabInverter { oblique: (incidence.0 != 1.0).then(|| Oblique::new(incidence.0)) }
    }

    /// σ of one texel and channel `c` whose thickness was found from its own ρt.
    ///
    /// The thickness t changes with the ρt of all three channels: d ln t = Σ pull · dρt. At fixed ρd and ρt the optical
    /// depths σa·t and σs·t are fixed, so dσ = ∂σ/∂ρd · dρd + ∂σ/∂ρt · dρt − σ · d ln t. The two contributions of this
    /// channel's ρt nearly cancel in σa, so they are added before they are squared.
    pub fn invert_fitted(
        &self,
        reading: FittedReading,
        thickness: f64,
        local: &TexelInterior,
        c: usize,
    ) -> SigmaEstimate {
        let FittedReading { rho_d, rho_t, error, covariance } = reading;
        let found = self.invert(rho_d, rho_t, thickness, error);
        let inverse = self.jacobian(found.value, thickness).try_inverse();
        // Where ρd and ρt alone bound nothing, a thickness does not help.
        let Some(by) = inverse.filter(|_| found.error.iter().all(|e| e.is_finite())) else { return found };
        let [rho_d_err, rho_t_err] = error;
        let own = local.pull[c] * rho_t_err;
        let others = ((local.thickness_err / local.thickness).powi(2) - own * own).max(0.0).sqrt();
        let error = [0, 1].map(|q: usize| {
            let value = found.value[q];
            // This channel's ρt acts in two ways: at the thickness found, and by changing it.
            let by_rho_t = by[(q, 1)] - value * local.pull[c];
            let variance = (by[(q, 0)] * rho_d_err).powi(2)
                + (by_rho_t * rho_t_err).powi(2)
                + 2.0 * by[(q, 0)] * by_rho_t * covariance
                + (value * others).powi(2);
            variance.max(0.0).sqrt()
        });
        SigmaEstimate { value: found.value, error }
    }

    /// Derivatives of (ρd, ρt as it was measured) by (σa, σs) in 1/mm; ρd and ρt are the rows.
    fn jacobian(&self, [sigma_a, sigma_s]: [f64; 2], thickness: f64) -> Matrix2<f64> {
        let (r, p) = slab::response_with_partials(sigma_a, sigma_s, thickness);
        let mut rho_t = [p.sigma_a.rho_t, p.sigma_s.rho_t];
        if let Some(oblique) = &self.oblique {
            // Measured ρt = ρt along the normal · exp(q), where q also depends on σa and σs.
            let step = 1e-4 * (sigma_a + sigma_s);
            let q = |a: f64, s: f64| oblique.ratio((sigma_a + a).max(0.0), (sigma_s + s).max(0.0), thickness);
            let slope = [(q(step, 0.0) - q(-step, 0.0)) / (2.0 * step), (q(0.0, step) - q(0.0, -step)) / (2.0 * step)];
            let scale = q(0.0, 0.0).exp();
            rho_t = [0, 1].map(|k| scale * (rho_t[k] + r.rho_t * slope[k]));
        }
        Matrix2::new(p.sigma_a.rho_d, p.sigma_s.rho_d, rho_t[0], rho_t[1])
    }

    /// σ at a thickness that is taken as exact. `error` holds the standard errors of (ρd, ρt).
    pub fn invert(&self, rho_d: f64, rho_t: f64, thickness: f64, error: [f64; 2]) -> SigmaEstimate {
        let solve = |t: f64, te: f64| {
            let e = inverse::invert(rho_d, t, thickness, error[0], te);
            if e.sigma_a.is_finite() && e.sigma_s.is_finite() {
                SigmaEstimate { value: [e.sigma_a, e.sigma_s], error: [e.sigma_a_err, e.sigma_s_err] }
            } else {
                UNKNOWN
            }
        };
        let Some(oblique) = &self.oblique else { return solve(rho_t, error[1]) };
        // ρt at normal incidence = measured ρt · exp(−q(ω, Δ)). This is a fixed point, because q depends on the result.
        let mut q = 0.0;
        let mut found = UNKNOWN;
        for _ in 0..60 {
            let scale = f64::exp(-q);
            found = solve(rho_t * scale, error[1] * scale);
            if found.value[0].is_nan() {
                // The first guess may exceed the transmittance of any slab. Then the iteration restarts from q at the
                // thin end of the grid.
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

/// q = ln ρt(μ₀) − ln ρt(1) on a grid over (logit ω, ln Δ). It is interpolated by cubics through the four nearest nodes
/// in each direction.
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
                let oblique = slab::medium::response_at(mu0, delta * (1.0 - omega), delta * omega, 1.0).rho_t;
                let normal = slab::medium::response(delta * (1.0 - omega), delta * omega, 1.0).rho_t;
                (oblique.max(f64::MIN_POSITIVE) / normal.max(f64::MIN_POSITIVE)).ln()
            })
            .collect();
        Oblique { q }
    }

    fn thinnest(&self) -> f64 {
        self.q[SIZE[1] / 2]
    }

    fn ratio(&self, sigma_a: f64, sigma_s: f64, thickness: f64) -> f64 {
        let place = |v: f64, range: [f64; 2], n: usize| {
            ((v - range[0]) / (range[1] - range[0]) * (n - 1) as f64).clamp(0.0, (n - 1) as f64)
        };
        let x = place((sigma_s / sigma_a.max(1e-300)).ln(), OMEGA, SIZE[0]);
        let y = place(((sigma_a + sigma_s) * thickness).ln(), DELTA, SIZE[1]);
        let (i, u) = cubic(x, SIZE[0]);
        let (j, v) = cubic(y, SIZE[1]);
        (0..4).map(|a| u[a] * (0..4).map(|b| v[b] * self.q[(i + a) * SIZE[1] + j + b]).sum::<f64>()).sum()
    }
}

/// The first of the four nodes around `x` on a unit grid of `n` nodes, and Lagrange's weights for the four.
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
        let inverter = SlabInverter::new(Incidence(mu0));
        for (a, s) in [(2.6, 16.0), (9.0, 18.0)] {
            let r = slab::medium::response(a, s, 0.2);
            let t = slab::medium::response_at(mu0, a, s, 0.2).rho_t;
            let found = inverter.invert(r.rho_d, t, 0.2, [1e-5; 2]);
            assert!((found.value[0] / a - 1.0).abs() < 2e-4 && (found.value[1] / s - 1.0).abs() < 2e-4, "{found:?}");
        }
    }

    /// Compares the derivatives that the errors depend on with differences of the exact slab, at normal and at oblique
    /// incidence.
    #[test]
    fn derivatives_of_what_was_measured() {
        let h = 0.2;
        for mu0 in [1.0, 55f64.to_radians().cos()] {
            let inverter = SlabInverter::new(Incidence(mu0));
            for (a, s) in [(2.6, 16.0), (9.0, 18.0), (0.4, 25.0)] {
                let measured = |a: f64, s: f64| {
                    [slab::medium::response(a, s, h).rho_d, slab::medium::response_at(mu0, a, s, h).rho_t]
                };
                let found = inverter.jacobian([a, s], h);
                for (column, da, ds) in [(0, 1e-3 * a, 0.0), (1, 0.0, 1e-3 * s)] {
                    let [up, down] = [measured(a + da, s + ds), measured(a - da, s - ds)];
                    for row in 0..2 {
                        let want = (up[row] - down[row]) / (2.0 * (da + ds));
                        assert!(
                            (found[(row, column)] / want - 1.0).abs() < 5e-3,
                            "{mu0} {a} {s} ({row}, {column}): {} {want}",
                            found[(row, column)]
                        );
                    }
                }
            }
        }
    }
}
