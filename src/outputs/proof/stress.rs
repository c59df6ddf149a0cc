//! A row of `mesophyll stress`: the verdict that a stiff or extreme case had to get, and the one that it got.

use serde::Serialize;

/// One case and how it ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StressRow {
    /// Model or table: `nist`, `solve`, `slab`, `gloss` …
    pub model: String,
    /// What makes the case stiff or extreme.
    pub case: String,
    /// What the verdict must begin with: `ok`, `undetermined: …`, `refused: …`.
    pub expected: String,
    /// The verdict that the case got.
    pub verdict: String,
    /// Correct decimal digits, where the answer is known.
    pub digits: Option<f64>,
    /// Condition number of the problem, where there is one.
    pub condition: Option<f64>,
    /// Run time of one call (ms).
    pub ms: f64,
}

impl StressRow {
    /// Whether the case got the verdict that it expects. `ok` must be exactly `ok`; the others may continue with a
    /// bound: `undetermined: sigma_a <= 0.02`.
    pub fn passed(&self) -> bool {
        self.verdict == self.expected || (self.expected != "ok" && self.verdict.starts_with(&self.expected))
    }
}
