//! One file a fit: a model, a solver, and what it reads and writes.

#![warn(missing_docs)]

pub mod branch;
pub mod consistency;
pub mod design;
pub mod dome;
pub mod foliar;
pub mod gloss;
pub mod grass;
pub mod leaf;
pub mod leaf_folder;
pub mod look;
pub mod photo;
pub mod plates;
pub mod record;
mod rivals;
pub mod sky;
pub mod slab;
pub mod transfer;
pub mod translucency;

pub(crate) use mesophyll_base::error::{Error, Result};
