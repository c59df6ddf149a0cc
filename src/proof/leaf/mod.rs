//! Small synthetic scans of known leaves.

pub mod stress;
