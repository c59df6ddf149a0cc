//! The third kind of capture: a narrow beam from a known direction lights one side of a leaf, and the other side is
//! photographed. From such photographs `fit tissue` finds what the leaf is made of. This module has the files, their
//! synthesis and their reading.
//!
//! Photographs are as the camera of the *unlit* side sees them, mirrored relative to the lit side: column i is the lit
//! side's column width − 1 − i. Values are the exit radiance times π, divided by the irradiance of a plane that faces
//! the beam; 1 is a white Lambertian sheet that faces the beam. Lengths in mm.

pub mod inspection;
pub mod manifest;
pub mod reader;

pub use manifest::BeamsManifest;
pub use reader::BeamsCapture;
