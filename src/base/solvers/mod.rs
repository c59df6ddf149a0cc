//! Least squares for every fit: one trace, one set of termination names, one covariance. No model's name appears here.

#![warn(missing_docs)]

pub mod adequacy;
pub mod damping;
pub mod decomposition;
pub mod jacobian;
pub mod lbfgs;
pub mod linear_algebra;
pub mod lm;
pub mod multi_start;
pub mod problem;
pub mod qr;
pub mod trace;
pub mod uncertainty;

pub use adequacy::{Adequacy, ReadingOrder, SolutionResiduals, judge};
pub use lm::{Fit, Options};
pub use problem::{ClosureProblem, Problem};
pub use trace::{Termination, Trace, TraceRow};
pub use uncertainty::{ResidualNoise, Uncertainty};
