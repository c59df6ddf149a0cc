//! Sky polynomials: error against size and time.

pub mod bench;
pub mod charts;
mod faults;
pub mod figures;
pub mod stress;
