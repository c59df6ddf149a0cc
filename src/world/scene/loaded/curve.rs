//! The slab curve of a leaf's side, with the figures of its accuracy for the plan.

use crate::placed::ledger::Ledger;
use crate::plan::accuracy::AccuracyRow;
pub use mesophyll_optics::slab::curve::ResponseCurve;
use std::time::Instant;

/// [`ResponseCurve::sampled`], noted in the ledger as `what`, and the error of linear interpolation for several numbers
/// of points.
pub fn curve(
    sigma_a: [f64; 3],
    sigma_s: [f64; 3],
    range: [f64; 2],
    allowed: f64,
    what: &str,
    ledger: &Ledger,
) -> (ResponseCurve, Vec<AccuracyRow>) {
    ledger.note("curve", what, 0, || {
        let (start, mut rows) = (Instant::now(), Vec::new());
        let made = ResponseCurve::sampled(sigma_a, sigma_s, range, allowed, |points, error| {
            let ms = start.elapsed().as_secs_f64() * 1e3;
            rows.push(AccuracyRow { setting: points, error, ms, bytes: points as u64 * 32 });
        });
        (made, rows)
    })
}
