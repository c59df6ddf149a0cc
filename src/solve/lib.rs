//! Least squares for every fit: one trace, one set of termination names, one covariance. No model's name appears here.

pub mod dd;
pub mod decompose;
pub mod descent;
pub mod dual;
pub mod global;
pub mod jacobian;
pub mod linear;
pub mod lm;
pub mod problem;
pub mod qr;
pub mod real;
mod refine;
pub mod search;
pub mod trace;
pub mod uncertainty;

pub use dd::Dd;
pub use dual::Dual;
pub use jacobian::check as jacobian_check;
pub use lm::{Fit, Options};
pub use problem::{Auto, Closure, Model, Problem};
pub use real::Real;
pub use trace::{Termination, Trace, TraceRow};
pub use uncertainty::{Noise, Uncertainty};
