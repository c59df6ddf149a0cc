//! Translucency maps: bases, diffusion against the random walk, extreme leaves.

pub mod basis_study;
pub mod bench;
pub mod stress;
pub mod validation;
