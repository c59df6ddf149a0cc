//! Files: written whole or not at all, read with errors that name the place. No physics.

pub mod atomic;
pub mod claim;
pub mod hash;
pub mod image;
pub mod mesh;
pub mod progress;
pub mod table;
