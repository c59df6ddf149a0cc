//! A leaf without a laboratory: photographs of both sides in open shade and of the leaf on a light table, with a grey
//! card and a ruler in the picture. How to take them: `docs/photo.md`.
//!
//! Open shade lights the leaf from the whole hemisphere, and the camera looks along its normal. So a photograph
//! measures the hemispherical-directional reflectance factor; by reciprocity it is the share of a beam along the normal
//! that the leaf reflects, which is the slab's ρd plus what the surface mirrors. The light table measures the slab's
//! ρt in the same way. What the sheet or the table sends back to the underside comes from all sides and is worked out
//! apart (`returned.rs`).

#![warn(missing_docs)]

pub mod colours;
pub mod diffuse;
mod encoding;
mod gloss;
mod grid;
mod inspection;
mod interreflection;
mod light;
mod light_table;
pub mod manifest;
mod maps;
mod noise;
mod outline;
pub mod picture;
mod reduction;
mod registration;
mod ruler;
mod shade;
mod silhouette;
mod texture;
mod views;

pub use inspection::{PhotoInspection, inspect};
pub use manifest::PhotoManifest;
pub use maps::{PhotoMaps, PhotoSideMaps};
pub use noise::SensorNoise;
pub use reduction::reduce;
pub use ruler::PictureScale;

pub(crate) use mesophyll_base::error::{Error, Result};
