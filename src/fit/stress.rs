<<<<<<< HEAD
<<<<<<< HEAD
<<<<<<< HEAD
=======
>>>>>>> gloss
//! A row of `mesophyll stress`: what a case had to come to, and what it came to.
=======
//! A row of `mesophyll stress`: what a stiff or extreme case had to come to, and what it came to.
>>>>>>> solve

use serde::Serialize;

/// One case and how it ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StressRow {
    /// Model or table: `nist`, `solve`, `slab`, `gloss` …
    pub model: String,
    pub case: String,
    /// What the verdict must begin with: `ok`, `undetermined: …`, `refused: …`.
    pub expected: String,
    /// The verdict that the case got.
    pub verdict: String,
    /// Correct decimal digits, where the answer is known.
    pub digits: Option<f64>,
    /// Condition number of the problem, where there is one.
    pub condition: Option<f64>,
<<<<<<< HEAD
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
=======
    /// Run time of one call (ms).
>>>>>>> solve
    pub ms: f64,
}

impl StressRow {
    /// Whether the case got the verdict that it expects. `ok` is `ok` alone; the others may go on with a bound: `undetermined: sigma_a <= 0.02`.
    pub fn passed(&self) -> bool {
        self.verdict == self.expected || (self.expected != "ok" && self.verdict.starts_with(&self.expected))
    }
}
<<<<<<< HEAD
>>>>>>> slab
=======
>>>>>>> gloss
=======
>>>>>>> solve
