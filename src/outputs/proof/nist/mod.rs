//! NIST StRD nonlinear regression: 27 problems with certified answers, by which the solver is judged.
//!
//! Digits of an answer are −log₁₀ of its relative error, at most 11 (the certified values have eleven).

mod bench;
mod loops;
mod models;
mod reader;
mod table;

pub use bench::bench_rows;
pub use table::{FILES, stress};
