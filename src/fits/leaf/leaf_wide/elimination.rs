//! One texel's part of the leaf-wide problem. Its thickness and γ are eliminated, and their effect goes into the sums
//! for the shared σ.

use super::{LeafWideSettings, LeafWideTexel, Sums, TexelInterior, V6};
use crate::leaf::curve::ThicknessCurve;
use mesophyll_base::rgb::Rgb;
use nalgebra::SVector;

/// The thickness t that explains three transmittances best, by Gauss–Newton in ln t from the last one, or from a scan
/// if there is none.
fn solve_thickness(x: &LeafWideTexel, start: f64, curves: &Rgb<ThicknessCurve>, settings: &LeafWideSettings) -> f64 {
    let [lo, hi] = curves[0].range().map(f64::ln);
    let cost = |t: f64| {
        (0..3)
            .map(|c| {
                let v = curves[c].at(t).ln_rho_t.exp();
                (x.rho_t[c] - v).powi(2) / x.variance(c, v, settings.relative)
            })
            .sum::<f64>()
    };
    let mut t = start;
    if t.is_nan() {
        // The transmittance falls with thickness in every channel, so a coarse scan finds the minimum's neighbourhood.
        let scan = (0..=32).map(|k| lo + (hi - lo) * f64::from(k) / 32.0);
        t = scan.map(|t| (t, cost(t))).fold((settings.h.ln(), f64::INFINITY), |a, b| if b.1 < a.1 { b } else { a }).0;
    }
    for _ in 0..30 {
        let (mut a, mut b) = (0.0, 0.0);
        for c in 0..3 {
            let q = curves[c].at(t);
            let v = q.ln_rho_t.exp();
            let w = 1.0 / x.variance(c, v, settings.relative);
            let slope = v * q.d_rho_t;
            a += w * slope * slope;
            b += w * slope * (x.rho_t[c] - v);
        }
        let step = (b / a.max(f64::MIN_POSITIVE)).clamp(-0.5, 0.5);
        let next = (t + step).clamp(lo, hi);
        let moved = (next - t).abs();
        t = next;
        if moved < 1e-13 {
            break;
        }
    }
    t
}

/// Solves one texel with the curves of the shared σ and adds its share to `sums`. `in_gauge` is the texel's weight in
/// the means of the gauges.
pub(super) fn eliminate(
    x: &LeafWideTexel,
    in_gauge: f64,
    ln_t: &mut f64,
    curves: &Rgb<ThicknessCurve>,
    settings: &LeafWideSettings,
    sums: &mut Sums,
) -> TexelInterior {
    *ln_t = solve_thickness(x, *ln_t, curves, settings);
    let points = Rgb::of(|c| curves[c].at(*ln_t));
    let (mut residual, mut slope, mut weight) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    let (mut information, mut bend, mut chi2) = (0.0, 0.0, 0.0);
    for c in 0..3 {
        let v = points[c].ln_rho_t.exp();
        residual[c] = x.rho_t[c] - v;
        slope[c] = v * points[c].d_rho_t;
        weight[c] = 1.0 / x.variance(c, v, settings.relative);
        information += weight[c] * slope[c] * slope[c];
        bend += weight[c] * slope[c] * v * (points[c].dd_rho_t + points[c].d_rho_t.powi(2));
        chi2 += weight[c] * residual[c] * residual[c];
    }
    let information = information.max(f64::MIN_POSITIVE);
    let variance = 1.0 / information;
    // There are two degrees of freedom: three transmittances less one thickness. Huber's weight acts beyond about 3.5
    // standard deviations.
    let trust = if settings.robust && chi2 > 12.0 { (12.0 / chi2).sqrt() } else { 1.0 };
    // d ln t / d p with the thickness re-solved
    let mut dt = V6::zeros();
    for c in 0..3 {
        let v = points[c].ln_rho_t.exp();
        for k in 0..2 {
            dt[2 * c + k] = -weight[c] * slope[c] * v * points[c].p_rho_t[k] * variance;
        }
    }
    for c in 0..3 {
        // row of the projected Jacobian: dT_c/dp with t following
        let v = points[c].ln_rho_t.exp();
        let mut row = dt * slope[c];
        for k in 0..2 {
            row[2 * c + k] += v * points[c].p_rho_t[k];
        }
        sums.hessian += row * row.transpose() * (weight[c] * trust);
        sums.gradient += row * (weight[c] * trust * residual[c]);
    }
    sums.cost += 0.5 * chi2 * trust.max(1e-12);
    // Second-order bias of the least-squares thickness (Box 1971). Uncorrected, noise would visibly shift the mean of
    // 10⁵ texels.
    let bias = -0.5 * variance * variance * bend;
    let usable = if variance.is_finite() && variance < 0.25 { 1.0 } else { 0.0 };
    let t = ln_t.exp();
    let mut local = TexelInterior {
        thickness: t,
        thickness_err: t * variance.sqrt(),
        chi2,
        weight: trust * usable,
        ..TexelInterior::default()
    };
    local.pull = Rgb(weight) * Rgb(slope) * variance;
    sums.weight += in_gauge;
    sums.gauge[0] += in_gauge * t * (1.0 - usable * (bias + 0.5 * variance));
    // How much the values of the gauges change with the thickness, and the covariance of γ's own part with the
    // thickness.
    let mut shared = SVector::<f64, 4>::from([t, 0.0, 0.0, 0.0]);
    let mut with_thickness = SVector::<f64, 4>::zeros();
    for k in 0..6 {
        sums.jacobian[(0, k)] += in_gauge * t * dt[k];
    }
    for c in 0..3 {
        let (r, q) = (points[c].ln_rho_d.exp(), &points[c]);
        let gamma = x.rho_d[c] / r;
        // γ is convex in ln t. With R the slab's reflectance, E[γ̂] = γ (1 − R′·bias + (R′² − R″)/2·variance), where R′
        // and R″ are derivatives of ln R by ln t; R″ is negligible.
        let curvature = 0.5 * q.d_rho_d * q.d_rho_d * variance;
        sums.gauge[1 + c] += in_gauge * gamma * (1.0 - usable * (curvature - q.d_rho_d * bias));
        for k in 0..6 {
            let own = if k / 2 == c { q.p_rho_d[k % 2] } else { 0.0 };
            sums.jacobian[(1 + c, k)] -= in_gauge * gamma * (own + q.d_rho_d * dt[k]);
        }
        local.gamma[c] = gamma;
        // dγ = dρd/R − γ R′ d ln t, and ρd goes a little with the ρt that moves the thickness.
        let by_thickness = -gamma * q.d_rho_d;
        with_thickness[1 + c] = local.pull[c] * x.covariance[c] / r;
        let own = (x.rho_d_err[c] / r).powi(2);
        let both = own + by_thickness.powi(2) * variance + 2.0 * by_thickness * with_thickness[1 + c];
        local.gamma_err[c] = both.max(0.0).sqrt();
        shared[1 + c] = by_thickness;
        sums.gauge_noise[(1 + c, 1 + c)] += in_gauge * in_gauge * own;
    }
    // Noise of the gauges: the thickness (from ρt) that they share, three ρd, and the covariance of the two.
    let cross = shared * with_thickness.transpose();
    sums.gauge_noise += (shared * shared.transpose() * variance + cross + cross.transpose()) * (in_gauge * in_gauge);
    local
}
