//! The proof that the fits are right: error against run time (`bench`), extreme cases with the verdict that each must
//! get (`stress`), certified regression problems (`nist`), coverage of stated errors, comparisons with other programs
//! (`peers`), and the numbers behind the pictures of the documentation.

#![warn(missing_docs)]

pub mod beam;
pub mod bench;
pub mod bench_charts;
pub mod coverage;
pub mod design;
pub mod foliar;
pub mod forest;
pub mod gloss;
pub mod grass;
pub mod leaf;
pub mod motion;
pub mod nist;
pub mod peers;
#[cfg(feature = "render")]
pub mod pictures;
mod precise;
pub mod render;
pub mod scene;
pub mod sky;
pub mod slab;
pub mod solver;
pub mod stress;
pub mod tables;
pub mod tissue;
pub mod transfer;
pub mod translucency;
pub mod transport;
pub mod visibility;
pub mod wind;

pub(crate) use mesophyll_base::error::{Error, Result};
