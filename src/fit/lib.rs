//! One file a fit: a model, a solver, and what it reads and writes.

#![warn(missing_docs)]

pub mod consistency;
pub mod dome;
pub mod foliar;
pub mod gloss;
pub mod leaf;
pub mod look;
pub mod photo;
pub mod slab;

pub(crate) use mesophyll_error::{Error, Result};
