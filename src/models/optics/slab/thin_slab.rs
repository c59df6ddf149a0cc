//! The slab as an integral equation, for thin slabs (Δ ≤ about 1).
//!
//! By reciprocity, the fluxes that a beam sends into the hemispheres equal the radiance that leaves along the beam
//! under isotropic unit radiance on the top side. With this light the source function obeys S(τ) = (ω/2) E₂(τ) + (ω/2)
//! ∫₀^Δ E₁(|τ−t|) S(t) dt. A Galerkin projection on shifted Legendre polynomials converges quadratically in ρd and ρt,
//! and loses no digits as Δ → 0.

use super::SlabResponse;
use super::expint::{e1, e2};
use super::quadrature::{gauss, shifted_legendre};
use std::sync::OnceLock;

/// Polynomials in the expansion of S.
const ORDER: usize = 14;
/// Number of quadrature points. The map r = u⁴ removes the logarithm of E₁ at r = 0.
const POINTS: usize = 40;

struct Basis {
    r: Vec<f64>,
    w: Vec<f64>,
    /// P*_i(r_q)
    at: Vec<[f64; ORDER]>,
    /// ∫₀^{1−r} [P*_i(x) P*_j(x+r) + P*_j(x) P*_i(x+r)] dx at each r_q
    overlap: Vec<[[f64; ORDER]; ORDER]>,
}

fn basis() -> &'static Basis {
    static BASIS: OnceLock<Basis> = OnceLock::new();
    BASIS.get_or_init(|| {
        let inner = gauss(ORDER + 1);
        let mut b = Basis { r: Vec::new(), w: Vec::new(), at: Vec::new(), overlap: Vec::new() };
        for q in gauss(POINTS) {
            let r = q.x.powi(4);
            let mut at = [0.0; ORDER];
            shifted_legendre(r, &mut at);
            let mut overlap = [[0.0; ORDER]; ORDER];
            for p in &inner {
                let (mut low, mut high) = ([0.0; ORDER], [0.0; ORDER]);
                shifted_legendre(p.x * (1.0 - r), &mut low);
                shifted_legendre(p.x * (1.0 - r) + r, &mut high);
                for i in 0..ORDER {
                    for j in 0..ORDER {
                        overlap[i][j] += p.w * (1.0 - r) * (low[i] * high[j] + low[j] * high[i]);
                    }
                }
            }
            b.r.push(r);
            b.w.push(q.w * 4.0 * q.x.powi(3));
            b.at.push(at);
            b.overlap.push(overlap);
        }
        b
    })
}

/// ρd and ρt of a slab of optical thickness `delta` and albedo `omega` for a beam at cosine `mu0`.
pub fn solve(omega: f64, delta: f64, mu0: f64) -> SlabResponse {
    let b = basis();
    let mut m = [[0.0; ORDER]; ORDER];
    let mut rhs = [0.0; ORDER];
    let (mut leave_top, mut leave_bottom) = ([0.0; ORDER], [0.0; ORDER]);
    let c = 1.0 / mu0;
    for (q, (&r, &w)) in b.r.iter().zip(&b.w).enumerate() {
        let kernel = 0.5 * omega * delta * w * e1(delta * r);
        let source = 0.5 * omega * w * e2(delta * r);
        let exit = delta * c * w * (-delta * c * r).exp();
        for i in 0..ORDER {
            for j in 0..=i {
                m[i][j] -= kernel * b.overlap[q][i][j];
            }
            rhs[i] += source * b.at[q][i];
            leave_top[i] += exit * b.at[q][i];
            // P*_i(1 − r) = (−1)^i P*_i(r)
            leave_bottom[i] += exit * if i % 2 == 0 { b.at[q][i] } else { -b.at[q][i] };
        }
    }
    for i in 0..ORDER {
        m[i][i] += 1.0 / (2 * i + 1) as f64;
        for j in 0..i {
            m[j][i] = m[i][j];
        }
    }
    // The matrix is symmetric and positive definite (the operator's norm is below 1), so elimination needs no pivots.
    for k in 0..ORDER {
        for i in k + 1..ORDER {
            let f = m[i][k] / m[k][k];
            for j in k + 1..ORDER {
                m[i][j] -= f * m[k][j];
            }
            rhs[i] -= f * rhs[k];
        }
    }
    for i in (0..ORDER).rev() {
        for j in i + 1..ORDER {
            rhs[i] -= m[i][j] * rhs[j];
        }
        rhs[i] /= m[i][i];
    }
    let dot = |v: &[f64; ORDER]| v.iter().zip(&rhs).map(|(a, b)| a * b).sum::<f64>();
    SlabResponse { rho_d: dot(&leave_top), rho_t: (-delta * c).exp() + dot(&leave_bottom) }
}
