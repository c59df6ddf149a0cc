//! One file a fit: a model, a solver, and what it reads and writes.

pub mod gloss;
pub mod leaf;
pub mod record;
