//! Designs of measurements: extreme cases, and a simulated measurement that shows errors against readings.

pub mod bench;
pub mod stress;
