//! A row of `mesophyll bench`: what one setting of an accuracy knob costs in time and what accuracy it gives.

use mesophyll_base::statistics::median_of;
use serde::Serialize;
use std::time::Instant;

/// One setting of one knob. Times are comparable within one run on one machine only.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchRow {
    /// Model: `solve`, `slab`, `gloss` …
    pub model: String,
    /// What was turned, with its unit: `ordinates`, `quadrature nodes` …
    pub knob: String,
    /// The knob's setting, with no unit.
    pub setting: String,
    /// Error of the result (relative unless `note` says otherwise). `note` says what it is measured on.
    pub error: f64,
    /// Run time of one evaluation or fit (µs), the median of several.
    pub us: f64,
    /// What the error is measured on, and other remarks; may be empty.
    pub note: String,
}

/// Median run time of `work` in µs: repeated at least three times, and until about `budget_ms` are spent.
pub fn median_us<T>(budget_ms: f64, mut work: impl FnMut() -> T) -> f64 {
    let mut times: Vec<f64> = Vec::new();
    let clock = Instant::now();
    while times.len() < 3 || (clock.elapsed().as_secs_f64() * 1e3 < budget_ms && times.len() < 10_000) {
        let start = Instant::now();
        std::hint::black_box(work());
        times.push(start.elapsed().as_secs_f64() * 1e6);
    }
    median_of(times).unwrap_or(f64::NAN)
}
