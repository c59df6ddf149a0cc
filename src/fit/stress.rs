<<<<<<< HEAD
<<<<<<< HEAD
=======
>>>>>>> gloss
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
<<<<<<< HEAD
=======
//! Stiff and extreme cases, each with the verdict it must get.

use serde::Serialize;

/// One case and how it ended.
#[derive(Debug, Clone, Serialize)]
pub struct StressRow {
    pub model: String,
    pub case: String,
    /// what the verdict must begin with
    pub expected: String,
    pub verdict: String,
    /// correct digits, where the truth is known
    pub digits: Option<f64>,
    pub condition: Option<f64>,
    /// time of one call, in milliseconds
    pub ms: f64,
}

impl StressRow {
    pub fn passed(&self) -> bool {
        self.verdict.starts_with(&self.expected)
    }
}
>>>>>>> slab
=======
>>>>>>> gloss
