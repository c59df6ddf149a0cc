//! Sharp sunlight among leaves by maps that were computed beforehand: what they cost and what they are worth.

pub mod bench;
pub(crate) mod cluster;
pub mod stress;
