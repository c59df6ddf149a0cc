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
