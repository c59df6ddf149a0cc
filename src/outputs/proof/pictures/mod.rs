//! Sweeps that draw: what a picture costs the renderer, and how far it is from the right one.

pub mod far;
pub mod lawns;
pub mod repeats;
pub mod ridge;
pub mod trees;

use crate::bench::BenchRow;
