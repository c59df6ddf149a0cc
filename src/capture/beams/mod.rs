//! The third kind of capture: a leaf lit by a narrow beam from known directions on one side, photographed from the
//! other. From such photographs `fit tissue` finds what the leaf is made of. Files, synthesis, reading.
//!
//! Photographs are as the camera of the *unlit* side sees them: mirrored against the lit side's (column i is the lit
//! side's column width − 1 − i). Values: exit radiance times π per irradiance of a plane that faces the beam; 1 is a
//! white Lambertian sheet facing the beam. Lengths in mm.

pub mod inspect;
pub mod manifest;
pub mod reader;
pub mod synth;

pub use manifest::Manifest;
pub use reader::Capture;
