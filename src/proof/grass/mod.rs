//! Slices of meadows: their errors and bytes, and what is hard for them.

pub mod bench;
pub mod stress;
