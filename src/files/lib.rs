//! Files: written whole or not at all, read with errors that name the place. No physics.

#![warn(missing_docs)]

pub mod atomic;
pub mod claim;
pub mod first_bytes;
pub mod glb;
pub mod gltf_file;
mod guard;
pub mod hash;
pub mod image;
pub mod instrument;
pub mod memory;
pub mod mesh;
pub mod numbers;
pub mod picture;
pub mod progress;
pub mod quantity;
pub mod spectra;
pub mod standard_output;
pub mod table;
pub mod unit;
pub mod whole_file;

pub(crate) use mesophyll_base::error::{Error, Result};

#[cfg(test)]
#[path = "../../tests/common/skips.rs"]
mod skips;
