//! Gloss traces of known texels.

pub mod bench;
pub mod stress;
