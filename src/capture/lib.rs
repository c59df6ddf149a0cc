//! The measurement: files, units, calibration, and synthesis with seeded noise. The format is documented in
//! `data/README.md`.

pub mod beams;
pub mod calibrate;
pub mod dome;
pub mod field;
pub mod grid;
pub mod inspect;
pub mod kind;
pub mod lightbox;
pub mod manifest;
pub mod reader;
pub mod synth;

pub use inspect::inspect;

pub(crate) use mesophyll_error::{Error, Result};
