//! Sky polynomials: error against size and time.

pub mod bench;
mod faults;
pub mod figures;
pub mod stress;
