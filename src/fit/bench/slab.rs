//! Sweeps of the slab: its forward methods and the way back, on 64 slabs (single-scattering albedo .05–.995, optical thickness .05–20).

use super::{BenchRow, median_us};
use crate::optics::slab::{self, Response};
use crate::solve::global::starts_in_box;

/// A slab 1 mm thick: σa, σs (1/mm), and what `exact` says of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub sigma_a: f64,
    pub sigma_s: f64,
    pub exact: Response,
}

/// The 64 slabs of the sweeps, evenly over ω and ln Δ.
pub fn samples() -> Vec<Sample> {
    let points = starts_in_box(&[0.05, 0.05f64.ln()], &[0.995, 20f64.ln()], 64, 7).unwrap_or_default();
    let sample = |p: &Vec<f64>| {
        let (omega, delta) = (p[0], p[1].exp());
        let (sigma_a, sigma_s) = ((1.0 - omega) * delta, omega * delta);
        Sample { sigma_a, sigma_s, exact: slab::exact::response(sigma_a, sigma_s, 1.0) }
    };
    points.iter().map(sample).collect()
}

/// The larger of two relative errors; NaN where either is.
pub fn larger(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() { a } else { b }
}

/// Worst relative error of ρd and ρt against the exact method.
pub fn forward_error(samples: &[Sample], method: impl Fn(f64, f64) -> Response) -> f64 {
    samples
        .iter()
        .map(|s| {
            let r = method(s.sigma_a, s.sigma_s);
            larger((r.rho_d / s.exact.rho_d - 1.0).abs(), (r.rho_t / s.exact.rho_t - 1.0).abs())
        })
        .fold(0.0, larger)
}

/// The rows: forward methods against the exact one, inversions against the truth.
pub fn bench_rows() -> Vec<BenchRow> {
    let samples = samples();
    let count = samples.len() as f64;
    let row = |knob: &str, setting: &str, error: f64, us: f64, note: &str| BenchRow {
        model: "slab".into(),
        knob: knob.into(),
        setting: setting.into(),
        error,
        us,
        note: note.into(),
    };
    let forward = |method: fn(f64, f64, f64) -> Response| {
        median_us(60.0, || samples.iter().map(|s| method(s.sigma_a, s.sigma_s, 1.0).rho_d).sum::<f64>()) / count
    };
    vec![
        row(
            "forward",
            "fast",
            forward_error(&samples, |a, s| slab::response(a, s, 1.0)),
            forward(slab::response),
            "worst of 64, against exact",
        ),
        row("forward", "exact", f64::NAN, forward(slab::exact::response), "the reference of the others"),
    ]
}
