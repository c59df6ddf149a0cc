//! From (ρd, ρt, thickness) back to (σa, σs), with errors that can be trusted.

use super::response_with_partials;

/// How an inversion ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Right within the printed errors, each relative 1σ ≤ 10 %.
    Ok,
    /// The best estimate stands, but the named parameters are not determined.
    Undetermined(String),
    /// No numbers.
    Refused(String),
}

impl Verdict {
    pub fn is_ok(&self) -> bool {
        matches!(self, Verdict::Ok)
    }
}

/// σa and σs (1/mm), their standard errors and covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    pub sigma_a: f64,
    pub sigma_s: f64,
    pub sigma_a_err: f64,
    pub sigma_s_err: f64,
    pub covariance: [[f64; 2]; 2],
    pub status: Verdict,
}

impl Estimate {
    fn refused(why: &str) -> Estimate {
        let nan = f64::NAN;
        Estimate {
            sigma_a: nan,
            sigma_s: nan,
            sigma_a_err: nan,
            sigma_s_err: nan,
            covariance: [[nan; 2]; 2],
            status: Verdict::Refused(why.into()),
        }
    }
}

/// Inverts one pair of measurements; errors are absolute standard errors of ρd and ρt.
pub fn invert(rho_d: f64, rho_t: f64, thickness_mm: f64, rho_d_err: f64, rho_t_err: f64) -> Estimate {
    if !(rho_d > 0.0 && rho_t > 0.0 && rho_d + rho_t < 1.0) {
        return Estimate::refused("rho_d and rho_t must be positive and sum to less than 1");
    }
    if !(thickness_mm > 0.0 && thickness_mm.is_finite()) {
        return Estimate::refused("h must be positive");
    }
    let (mut u, mut v) = ((-rho_t.ln() * (1.0 - rho_d - rho_t) / thickness_mm).ln(), (3.0 * rho_d / rho_t / thickness_mm).ln());
    let mut best = f64::INFINITY;
    let mut damping = 1e-3;
    let cost_at = |u: f64, v: f64| {
        let (r, p) = response_with_partials(u.exp(), v.exp(), thickness_mm);
        let f = [(r.rho_d / rho_d).ln(), (r.rho_t / rho_t).ln()];
        let j = [
            [p.sigma_a.rho_d * u.exp() / r.rho_d, p.sigma_s.rho_d * v.exp() / r.rho_d],
            [p.sigma_a.rho_t * u.exp() / r.rho_t, p.sigma_s.rho_t * v.exp() / r.rho_t],
        ];
        (f, j, f[0] * f[0] + f[1] * f[1], p)
    };
    let (mut f, mut j, mut cost, mut p) = cost_at(u, v);
    for _ in 0..100 {
        best = best.min(cost);
        let g = [j[0][0] * f[0] + j[1][0] * f[1], j[0][1] * f[0] + j[1][1] * f[1]];
        let a = j[0][0].powi(2) + j[1][0].powi(2) + damping;
        let d = j[0][1].powi(2) + j[1][1].powi(2) + damping;
        let b = j[0][0] * j[0][1] + j[1][0] * j[1][1];
        let det = a * d - b * b;
        let (du, dv) = (-(d * g[0] - b * g[1]) / det, -(a * g[1] - b * g[0]) / det);
        let trial = cost_at(u + du, v + dv);
        if trial.2 < cost {
            (u, v) = (u + du, v + dv);
            (f, j, cost, p) = trial;
            damping *= 0.1;
        } else {
            damping *= 10.0;
        }
        if cost < 1e-24 || damping > 1e12 {
            break;
        }
    }
    if cost > 1e-12 {
        return Estimate::refused("no slab has this rho_d and rho_t");
    }
    let det = p.sigma_a.rho_d * p.sigma_s.rho_t - p.sigma_s.rho_d * p.sigma_a.rho_t;
    let inverse = [[p.sigma_s.rho_t / det, -p.sigma_s.rho_d / det], [-p.sigma_a.rho_t / det, p.sigma_a.rho_d / det]];
    let (vd, vt) = (rho_d_err.powi(2), rho_t_err.powi(2));
    let c = |i: usize, k: usize| inverse[i][0] * inverse[k][0] * vd + inverse[i][1] * inverse[k][1] * vt;
    let covariance = [[c(0, 0), c(0, 1)], [c(1, 0), c(1, 1)]];
    let (sigma_a, sigma_s) = (u.exp(), v.exp());
    let (ea, es) = (covariance[0][0].sqrt(), covariance[1][1].sqrt());
    let status = match (ea <= 0.1 * sigma_a, es <= 0.1 * sigma_s) {
        (true, true) => Verdict::Ok,
        (false, true) => Verdict::Undetermined("sigma_a".into()),
        (true, false) => Verdict::Undetermined("sigma_s".into()),
        _ => Verdict::Undetermined("sigma_a; sigma_s".into()),
    };
    Estimate { sigma_a, sigma_s, sigma_a_err: ea, sigma_s_err: es, covariance, status }
}
