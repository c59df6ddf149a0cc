//! Small synthetic scans of known leaves.

pub mod faults;
pub mod stress;
