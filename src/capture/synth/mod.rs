//! Synthetic leaves and their scans.

pub mod illumination;
pub mod slab_truth;
