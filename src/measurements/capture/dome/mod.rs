//! The second kind of capture, for people without a linear light source: photographs under a diffuse dome and in front
//! of a diffuse back light, and height scans of both sides (Habel 2009, §3.3.2). This module has the files, their
//! synthesis, their reduction to maps, and a first look.
//!
//! The format is documented in `data/README.md`. Lengths in mm; shares (albedo, transmittance) in 0 … 1; directions in
//! the image frame of the side that is looked at (x right, y up, z towards the camera). The back's images are mirrored:
//! its column i is the front's column width − 1 − i.

mod alignment;
pub mod highlight;
pub mod inspection;
pub mod manifest;
pub mod noise;
pub mod reader;
pub mod reduction;
mod shape;
pub mod smoothing;
pub mod visibility;

pub use manifest::DomeManifest;
pub use reader::DomeCapture;
pub use reduction::{DomeMaps, DomeSideMaps, reduce};
