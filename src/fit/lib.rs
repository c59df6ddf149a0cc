//! One file a fit: a model, a solver, and what it reads and writes.

pub mod beam;
pub mod bench;
pub mod coverage;
pub mod dome;
pub mod gloss;
pub mod leaf;
pub mod nist;
pub mod peers;
pub mod record;
pub mod sky;
pub mod slab;
pub mod slab_bench;
pub mod slab_stress;
pub mod solver;
pub mod stress;
pub mod translucency;

pub(crate) use mesophyll_error::{Error, Result};
