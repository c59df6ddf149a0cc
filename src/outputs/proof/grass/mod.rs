//! Slices of meadows: their errors and sizes, and the cases that are hard for them.

pub mod bench;
pub mod stress;
