//! What light does in and on a leaf, one model a file. No files, no solvers.

pub mod dipole;
pub mod gloss;
pub mod side;
pub mod slab;
pub mod translucency;
pub mod tube;
pub mod walk;

pub(crate) use mesophyll_error::{Error, Result};
