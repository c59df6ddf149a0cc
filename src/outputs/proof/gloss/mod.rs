//! Gloss traces of known texels, and goniometer tables of known leaves.

pub mod bench;
mod samples;
pub mod stress;
