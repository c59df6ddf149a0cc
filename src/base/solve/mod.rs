//! Least squares for every fit: one trace, one set of termination names, one covariance. No model's name appears here.

#![warn(missing_docs)]

pub mod adequacy;
pub mod damped;
pub mod decompose;
pub mod global;
pub mod jacobian;
pub mod lbfgs;
pub mod linear;
pub mod lm;
pub mod problem;
pub mod qr;
pub mod trace;
pub mod uncertainty;

pub use adequacy::{Adequacy, Along, Readings, judge};
pub use lm::{Fit, Options};
pub use problem::{Closure, Problem};
pub use trace::{Termination, Trace, TraceRow};
pub use uncertainty::{Noise, Uncertainty};
