//! Sweeps of the slab: its forward methods, the order of F_N, ordinates, table sizes, Newton's steps and the inversion.
//! They use 64 slabs of 1 mm (single-scattering albedo .05–.995, optical thickness .05–20), each compared with the
//! exact method.

use crate::bench::{BenchRow, median_us};
use mesophyll_base::solvers::multi_start::starts_in_box;
use mesophyll_optics::slab::inverse::{self, InversionPrecision};
use mesophyll_optics::slab::ordinates::with_ordinates;
use mesophyll_optics::slab::table::SlabTable;
use mesophyll_optics::slab::{self, SlabResponse, fn_method, medium};

/// A slab 1 mm thick, so that σ in 1/mm is an optical thickness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProofSlab {
    /// Absorption coefficient (1/mm).
    pub sigma_a: f64,
    /// Scattering coefficient (1/mm).
    pub sigma_s: f64,
    /// Single-scattering albedo ω.
    pub omega: f64,
    /// 1 − ω, with the digits that a subtraction would lose.
    pub one_minus_omega: f64,
    /// Optical thickness Δ.
    pub delta: f64,
    /// What the exact method gives.
    pub exact: SlabResponse,
}

/// The 64 slabs, evenly over ω and ln Δ.
pub fn slabs() -> Vec<ProofSlab> {
    let points = starts_in_box(&[0.05, 0.05f64.ln()], &[0.995, 20f64.ln()], 64, 7).unwrap_or_default();
    let slab = |p: &Vec<f64>| {
        let (omega, one_minus_omega, delta) = (p[0], 1.0 - p[0], p[1].exp());
        let exact = medium::solve(omega, one_minus_omega, delta);
        ProofSlab { sigma_a: one_minus_omega * delta, sigma_s: omega * delta, omega, one_minus_omega, delta, exact }
    };
    points.iter().map(slab).collect()
}

/// The larger of two relative errors; NaN where either is.
pub fn larger(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

/// Larger relative error of ρd and ρt.
pub fn forward_error(s: &ProofSlab, r: SlabResponse) -> f64 {
    larger((r.rho_d / s.exact.rho_d - 1.0).abs(), (r.rho_t / s.exact.rho_t - 1.0).abs())
}

/// The method behind `exact`, which uses 40 ordinates, with fewer of them.
fn ordinates(forward: &mut impl FnMut(&str, String, &dyn Fn(&ProofSlab) -> SlabResponse, bool)) {
    fn of<const K: usize>(forward: &mut impl FnMut(&str, String, &dyn Fn(&ProofSlab) -> SlabResponse, bool)) {
        let solve = with_ordinates::<K>();
        let response = |s: &ProofSlab| {
            let (rho_d, log_t) = solve(s.omega, s.one_minus_omega, s.delta);
            SlabResponse { rho_d, rho_t: log_t.exp() }
        };
        forward("ordinates", K.to_string(), &response, false);
    }
    of::<4>(forward);
    of::<6>(forward);
    of::<8>(forward);
    of::<12>(forward);
    of::<16>(forward);
    of::<24>(forward);
    of::<32>(forward);
}

/// The rows.
///
/// # Errors
/// None; the signature is that of every sweep.
pub fn bench_rows() -> crate::Result<Vec<BenchRow>> {
    let slabs = slabs();
    let mut rows = Vec::new();
    let mut forward = |knob: &str, setting: String, method: &dyn Fn(&ProofSlab) -> SlabResponse, reference: bool| {
        let error = slabs.iter().map(|s| forward_error(s, method(s))).fold(0.0, larger);
        rows.push(BenchRow {
            model: "slab".into(),
            knob: knob.into(),
            setting,
            error: if reference { f64::NAN } else { error },
            us: median_us(40.0, || slabs.iter().map(|s| method(s).rho_d).sum::<f64>()) / slabs.len() as f64,
            note: if reference { "the reference of the others" } else { "rho_d and rho_t, worst of 64, against exact" }
                .into(),
        });
    };
    forward("method", "fast".into(), &|s| slab::response(s.sigma_a, s.sigma_s, 1.0), false);
    forward("method", "fn".into(), &|s| fn_method::solve(s.omega, s.one_minus_omega, s.delta, 1e-3).response, false);
    forward("method", "exact".into(), &|s| medium::response(s.sigma_a, s.sigma_s, 1.0), true);
    for order in [3, 5, 7, 9, 13, 17, 25, 33] {
        forward(
            "F_N order",
            order.to_string(),
            &|s| fn_method::at_order(s.omega, s.one_minus_omega, s.delta, order),
            false,
        );
    }
    ordinates(&mut forward);
    for tolerance in [1e-3, 1e-5, 1e-7, 1e-9] {
        // The tables cover only the thicknesses of these slabs, so that making them does not take minutes.
        let table = SlabTable::made([0.05, 20.0], tolerance);
        let setting = format!("{:.1} kB", table.bytes() as f64 / 1e3);
        forward("table size", setting, &|s| table.response(s.omega, s.one_minus_omega, s.delta), false);
    }
    for steps in 0..=4 {
        let found = |s: &ProofSlab| {
            inverse::after_steps(s.exact.rho_d, s.exact.rho_t, 1.0 - s.exact.rho_d - s.exact.rho_t, steps)
        };
        let error = |s: &ProofSlab| {
            let [absorbed, omega, delta] = found(s);
            larger((absorbed * delta / s.sigma_a - 1.0).abs(), (omega * delta / s.sigma_s - 1.0).abs())
        };
        rows.push(BenchRow {
            model: "slab".into(),
            knob: "Newton steps".into(),
            setting: steps.to_string(),
            error: slabs.iter().map(error).fold(0.0, larger),
            us: median_us(40.0, || slabs.iter().map(|s| found(s)[2]).sum::<f64>()) / slabs.len() as f64,
            note: "sigma_a and sigma_s after so many plain steps from the tabulated start, worst of 64".into(),
        });
    }
    // The noise that each precision is meant for. With a noise below 1e-7 the fast one uses the exact one by itself.
    for (setting, precision, noise) in
        [("fast", InversionPrecision::Fast, 1e-6), ("exact", InversionPrecision::Exact, 1e-9)]
    {
        let invert = |s: &ProofSlab| inverse::invert_with(precision, s.exact.rho_d, s.exact.rho_t, 1.0, noise, noise);
        let found: Vec<_> = slabs.iter().map(|s| (s, invert(s))).filter(|(_, e)| e.status.is_ok()).collect();
        let error =
            found.iter().map(|(s, e)| larger((e.sigma_a / s.sigma_a - 1.0).abs(), (e.sigma_s / s.sigma_s - 1.0).abs()));
        rows.push(BenchRow {
            model: "slab".into(),
            knob: "inversion".into(),
            setting: setting.into(),
            error: error.fold(0.0, larger),
            us: median_us(80.0, || slabs.iter().map(|s| invert(s).sigma_a).sum::<f64>()) / slabs.len() as f64,
            note: format!(
                "sigma_a and sigma_s, worst of the {} of 64 that are ok at a noise of {noise:.0e}",
                found.len()
            ),
        });
    }
    Ok(rows)
}
