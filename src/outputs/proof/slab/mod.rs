//! The slab: comparisons of the forward methods, and inversions with the verdict that physics requires.

pub mod bench;
pub mod stress;
