//! The measurement: files, units, calibration, and synthesis with seeded noise. The format is documented in
//! `data/README.md`.

#![warn(missing_docs)]

pub mod beams;
pub mod calibration;
pub mod dome;
mod folder;
pub mod goniometer;
pub mod inspection;
pub mod kind;
pub mod lightbox;
pub mod manifest;
pub mod manifest_check;
pub mod photo;
pub mod pigments;
pub mod reader;

pub use inspection::inspect;

pub(crate) use mesophyll_base::error::{Error, Result};

/// Where a synthetic capture keeps the true maps of a side.
pub fn truth_path(capture: &std::path::Path, side: mesophyll_optics::side::Side) -> std::path::PathBuf {
    capture.join("truth").join(format!("{}.exr", side.name()))
}
