//! A row of `mesophyll stress`: what a case had to come to, and what it came to.

use serde::Serialize;

/// One stiff or extreme case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StressRow {
    /// Model or table: `nist`, `solve`, `slab`, `gloss` …
    pub model: String,
    pub case: String,
    /// The verdict that the case must get: `ok`, `undetermined: …`, `refused: …`.
    pub expected: String,
    /// The verdict that it got.
    pub verdict: String,
    /// Correct decimal digits, where the answer is known.
    pub digits: Option<f64>,
    /// Condition number of the problem, where there is one.
    pub condition: Option<f64>,
    /// Run time (ms).
    pub ms: f64,
}
