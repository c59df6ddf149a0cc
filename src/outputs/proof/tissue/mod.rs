//! Photographs of known tissues.

pub mod stress;
