//! One file a fit: a model, a solver, and what it reads and writes.

pub mod record;
pub mod slab;
pub mod slab_stress;
pub mod stress;
