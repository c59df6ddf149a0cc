//! Least squares for every fit: one trace, one set of termination names, one covariance. No model's name appears here.

pub mod trace;

pub use trace::{Termination, Trace, TraceRow};
