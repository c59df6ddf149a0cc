//! What stands where in the world, what lights it, and who sees which side of it.

pub mod branch;
pub mod daylight;
pub mod facing;
pub mod placement;
pub mod tree;
