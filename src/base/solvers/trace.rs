//! What a solver reports about its run: one row for each iteration, and the one reason why it stopped.

use serde::{Deserialize, Serialize};

/// Why a solver stopped: one name a cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Termination {
    /// The scaled gradient fell below its tolerance.
    GradientSmall,
    /// The relative decrease of the cost fell below its tolerance.
    CostConverged,
    /// The relative step fell below its tolerance.
    StepSmall,
    /// A direct (linear) solve: there was nothing to iterate.
    Direct,
    /// The iteration limit was reached first.
    IterationLimit,
    /// No step, however short, lowered the cost although the gradient is not small.
    NoProgress,
    /// The model or its Jacobian became NaN or infinite.
    NotFinite,
    /// The residuals do not depend on any free parameter here: there is no direction to go, and nothing was fitted.
    Flat,
    /// The input cannot be fitted at all (no usable samples, all zero, out of range).
    Refused,
}

impl Termination {
    /// Whether the parameters may be used.
    pub fn converged(self) -> bool {
        matches!(
            self,
            Termination::GradientSmall | Termination::CostConverged | Termination::StepSmall | Termination::Direct
        )
    }

    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Termination::GradientSmall => "gradient_small",
            Termination::CostConverged => "cost_converged",
            Termination::StepSmall => "step_small",
            Termination::Direct => "direct",
            Termination::IterationLimit => "iteration_limit",
            Termination::NoProgress => "no_progress",
            Termination::NotFinite => "not_finite",
            Termination::Flat => "flat",
            Termination::Refused => "refused",
        }
    }
}

/// One iteration. Costs are ½ Σ r² of weighted residuals.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TraceRow {
    /// Number of the iteration; 0 is the start.
    pub iteration: usize,
    /// Model evaluations so far (residuals and Jacobians).
    pub evaluations: usize,
    /// Wall time since the start (s). Kept out of `fit.toml`, which is the same for the same input.
    pub elapsed_s: f64,
    /// ½ Σ r² after the iteration.
    pub cost: f64,
    /// Largest absolute component of the gradient.
    pub gradient: f64,
    /// Norm of the scaled step.
    pub step: f64,
    /// Error to the truth, when the truth is known.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub truth_error: Option<f64>,
}

/// The rows of one run.
pub type Trace = Vec<TraceRow>;
