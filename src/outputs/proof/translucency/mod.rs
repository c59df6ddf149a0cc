//! Translucency maps: bases, diffusion compared with the random walk, and extreme leaves.

pub mod basis_charts;
pub mod basis_study;
pub mod bench;
pub mod stress;
pub mod validation;
