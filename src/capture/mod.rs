//! The measurement: files, units, calibration, and synthesis with seeded noise. The format is documented in `data/README.md`.

pub mod inspect;
pub mod manifest;

pub use inspect::inspect;
