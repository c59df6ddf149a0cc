//! Light among leaves: the number of rays a second, on a crown that is the same in every run.

pub mod bench;
mod foliage;
pub mod paths;

pub use foliage::ProofFoliage;
