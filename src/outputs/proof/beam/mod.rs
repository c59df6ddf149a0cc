//! Bending branches, compared with double-double references.

pub mod bench;
pub mod charts;
pub mod figures;
pub mod reference;
pub mod stress;
