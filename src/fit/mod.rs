//! One file a fit: a model, a solver, and what it reads and writes.

pub mod bench;
pub mod gloss;
pub mod record;
pub mod stress;
