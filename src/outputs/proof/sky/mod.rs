//! Sky polynomials: error against size and time.

pub mod bench;
pub mod charts;
pub mod dome;
mod faults;
pub mod figures;
pub mod stress;
