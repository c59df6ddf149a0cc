//! Bending branches against double-double references.

pub mod bench;
pub mod figures;
pub mod reference;
pub mod stress;
