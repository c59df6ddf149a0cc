//! The slab: forward methods against each other, and inversions with the verdict physics asks for.

pub mod bench;
pub mod stress;
