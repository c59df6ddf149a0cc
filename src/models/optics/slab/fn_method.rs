//! The paper's method: Siewert's F_N with shifted Legendre polynomials, as in LEAFMOD (Siewert 1978; Siewert & Benoist
//! 1979; Ganapol et al. 1998). The order is raised until two answers agree.
//!
//! The radiances that leave, A(μ) at the top and B(μ) at the bottom, are expanded as (ω/2) Σ a_α P_α(2μ−1). Case's
//! orthogonality relations couple them at every ξ of the spectrum, which consists of ν₀ and the interval (0, 1).
//! Collocation at ν₀ and the N Gauss points gives 2(N+1) equations. The expansion converges only algebraically, because
//! the radiance is like μ ln μ at μ = 0. So only six digits are asked of it.

use super::SlabResponse;
use super::quadrature::{gauss, shifted_legendre};

/// Highest order tried.
pub(crate) const MAX_ORDER: usize = 40;
/// Where ω is nearer to 1 than this, the collocation cannot resolve ν₀, and ω is taken as 1 minus this.
const CONSERVATIVE: f64 = 1e-11;

/// An F_N answer and how well it settled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FnSolution {
    /// What the slab reflects and transmits.
    pub response: SlabResponse,
    /// order of the accepted answer
    pub order: usize,
    /// largest relative change of ρd and ρt from the order before
    pub change: f64,
}

/// Raises the order by two until ρd and ρt change by less than `tolerance`. If that never happens, the pair of orders
/// with the smallest change is returned.
pub fn solve(omega: f64, one_minus_omega: f64, delta: f64, tolerance: f64) -> FnSolution {
    let mut best = FnSolution { response: at_order(omega, one_minus_omega, delta, 2), order: 2, change: f64::INFINITY };
    let mut before = best.response;
    for order in (4..=MAX_ORDER).step_by(2) {
        let response = at_order(omega, one_minus_omega, delta, order);
        let relative = |a: f64, b: f64| if a == b { 0.0 } else { (a / b - 1.0).abs() };
        let change = relative(response.rho_d, before.rho_d).max(relative(response.rho_t, before.rho_t));
        if change < best.change {
            best = FnSolution { response, order, change };
        }
        if change < tolerance {
            break;
        }
        before = response;
    }
    best
}

/// ρd and ρt with polynomials up to `order` ≥ 1; NaN outside 0 ≤ ω ≤ 1, Δ ≥ 0.
pub fn at_order(omega: f64, one_minus_omega: f64, delta: f64, order: usize) -> SlabResponse {
    if !(omega >= 0.0 && one_minus_omega >= 0.0 && delta >= 0.0) {
        return SlabResponse { rho_d: f64::NAN, rho_t: f64::NAN };
    }
    if omega == 0.0 || delta == 0.0 {
        return SlabResponse { rho_d: 0.0, rho_t: (-delta).exp() };
    }
    let absorbed = one_minus_omega.max(CONSERVATIVE);
    let omega = omega.min(1.0 - CONSERVATIVE);
    let n = order + 1;
    let nu = discrete_eigenvalue(omega, absorbed);
    let points = [nu].into_iter().chain(gauss(order).into_iter().map(|q| q.x));
    let size = 2 * n;
    let mut matrix = vec![0.0; size * size];
    let mut rhs = vec![0.0; size];
    let (mut c, mut a) = (vec![0.0; n], vec![0.0; n]);
    let crossing = (-delta / nu).exp();
    for (row, xi) in points.enumerate() {
        near_side(xi, omega, &mut c);
        far_side(xi, omega, &mut a);
        let own = (-delta / xi).exp();
        // B is counted in units of e^(−Δ/ν₀)
        let scaled = (-delta * (1.0 / xi - 1.0 / nu)).exp();
        for k in 0..n {
            matrix[row * size + k] = c[k];
            matrix[row * size + n + k] = own * crossing * a[k];
            matrix[(n + row) * size + k] = scaled * a[k];
            matrix[(n + row) * size + n + k] = c[k];
        }
        rhs[row] = 0.5 * omega * -(-delta * (1.0 / xi + 1.0)).exp_m1() / (xi + 1.0);
        // (e^(−Δ/ξ) − e^(−Δ))/(ξ−1) e^(Δ/ν₀)
        let gap = (1.0 - 1.0 / xi).abs() * delta;
        let slow = (-delta * (xi.recip().min(1.0) - 1.0 / nu)).exp();
        let difference = if gap < 1e-12 { delta / xi } else { -(-gap).exp_m1() / (xi - 1.0).abs() };
        rhs[n + row] = 0.5 * omega * slow * difference;
    }
    if !eliminate(&mut matrix, &mut rhs) {
        return SlabResponse { rho_d: f64::NAN, rho_t: f64::NAN };
    }
    // ∫ μ P_α dμ = ½, 1/6, 0, …
    let flux = |v: &[f64]| 0.5 * v[0] + v[1] / 6.0;
    SlabResponse { rho_d: flux(&rhs[..n]), rho_t: (-delta).exp() + crossing * flux(&rhs[n..]) }
}

/// ν₀ > 1 with 1 = ω ν₀ artanh(1/ν₀), by Newton's method in k = 1/ν₀.
fn discrete_eigenvalue(omega: f64, absorbed: f64) -> f64 {
    let mut k = if absorbed < 0.3 { (3.0 * absorbed).sqrt() } else { 1.0 - 2.0 * (-2.0 / omega).exp() };
    if k > 1.0 - 1e-14 {
        return 1.0 + 1e-14;
    }
    for _ in 0..100 {
        // artanh k / k − 1/ω, with the small difference of large numbers taken analytically where k is small
        let (f, slope) = if k < 0.05 {
            let k2 = k * k;
            (k2 * (1.0 / 3.0 + k2 * (0.2 + k2 * (1.0 / 7.0 + k2 / 9.0))) - absorbed / omega, k * (2.0 / 3.0 + 0.8 * k2))
        } else {
            (k.atanh() / k - 1.0 / omega, (1.0 / (1.0 - k * k) - k.atanh() / k) / k)
        };
        let next = (k - f / slope).clamp(0.5 * k, 0.5 * (1.0 + k));
        if (next - k).abs() < 1e-16 * k {
            break;
        }
        k = next;
    }
    1.0 / k
}

/// C_α(ξ) = (1/ξ) ∫₀¹ μ φ(ξ, μ) P_α(2μ−1) dμ.
fn near_side(xi: f64, omega: f64, out: &mut [f64]) {
    if xi > 1.1 {
        return quadrature_side(|mu| 0.5 * omega / (xi - mu), out);
    }
    let z = 2.0 * xi - 1.0;
    out[0] = 1.0 - 0.5 * omega * (1.0 + xi * (1.0 / xi).ln_1p());
    for k in 1..out.len() {
        let j = (k - 1) as f64;
        let moment = 0.5 * omega * [0.5, 1.0 / 6.0].get(k - 1).copied().unwrap_or(0.0);
        let older = if k > 1 { out[k - 2] } else { 0.0 };
        out[k] = ((2.0 * j + 1.0) * (z * out[k - 1] - 2.0 * moment) - j * older) / (j + 1.0);
    }
}

/// (1/ξ) ∫₀¹ μ φ(−ξ, μ) P_α(2μ−1) dμ. It is the decreasing solution of its recurrence, computed downwards and scaled by
/// the two moments that start it.
fn far_side(xi: f64, omega: f64, out: &mut [f64]) {
    if xi > 0.5 {
        return quadrature_side(|mu| 0.5 * omega / (xi + mu), out);
    }
    let z = 2.0 * xi + 1.0;
    let first = 1.0 - xi * (1.0 / xi).ln_1p();
    out[0] = 0.5 * omega * first;
    out[1] = 0.5 * omega * (1.0 - z * first);
    let grow = (z + (z * z - 1.0).sqrt()).ln();
    let start = out.len() + ((40.0 / grow) as usize).min(4000);
    let mut ratios = vec![0.0; out.len()];
    let mut ratio = 0.0;
    for k in (2..start).rev() {
        let j = k as f64;
        ratio = -j / ((2.0 * j + 1.0) * z + (j + 1.0) * ratio);
        if k < out.len() {
            ratios[k] = ratio;
        }
    }
    for k in 2..out.len() {
        out[k] = ratios[k] * out[k - 1];
    }
}

/// ∫₀¹ μ f(μ) P_α(2μ−1) dμ for an f without near singularities.
fn quadrature_side(f: impl Fn(f64) -> f64, out: &mut [f64]) {
    out.fill(0.0);
    let mut p = vec![0.0; out.len()];
    for q in gauss(out.len() / 2 + 30) {
        shifted_legendre(q.x, &mut p);
        for (o, p) in out.iter_mut().zip(&p) {
            *o += q.w * q.x * f(q.x) * p;
        }
    }
}

/// Gaussian elimination with partial pivoting; false where the matrix is singular.
fn eliminate(m: &mut [f64], v: &mut [f64]) -> bool {
    let n = v.len();
    for k in 0..n {
        let p = (k..n).max_by(|&i, &j| m[i * n + k].abs().total_cmp(&m[j * n + k].abs())).unwrap_or(k);
        if !(m[p * n + k].abs() > 0.0) {
            return false;
        }
        for j in 0..n {
            m.swap(k * n + j, p * n + j);
        }
        v.swap(k, p);
        for i in k + 1..n {
            let f = m[i * n + k] / m[k * n + k];
            for j in k..n {
                m[i * n + j] -= f * m[k * n + j];
            }
            v[i] -= f * v[k];
        }
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            v[i] -= m[i * n + j] * v[j];
        }
        v[i] /= m[i * n + i];
    }
    true
}
