//! The measurement: files, units, calibration, and synthesis with seeded noise. The format is documented in `data/README.md`.

pub mod manifest;
pub mod synth;
