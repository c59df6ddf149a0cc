//! Sharp sunlight among leaves, by maps that are computed beforehand: their cost and their accuracy.

pub mod bench;
pub(crate) mod cluster;
pub mod stress;
