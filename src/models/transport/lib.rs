//! Light transport on the CPU: the reference renderer that pictures are judged against.
//!
//! It shares no code with the GPU renderer or with `optics`. Rays, texture look-ups, lobes, directional albedo,
//! sampling and tone mapping are written again here in f64, so that an error on one side becomes visible. Both must
//! agree on the shading that is described at the top of `mesophyll_viewer::scene`. [`render`] draws direct light only:
//! the sun's disk, and a constant sky or a dome of any radiance, which nothing shadows. [`path`] follows all light from
//! leaf to leaf.

#![warn(missing_docs)]

pub mod albedo;
pub mod closed_form;
#[cfg(feature = "render")]
pub mod comparison;
pub mod cube;
mod culling;
pub mod dome;
pub mod environment;
pub mod foliar;
pub mod lobe;
pub mod lookup;
pub mod path;
pub mod quadrature;
pub mod rays;
pub mod renderer;
mod repetition;
pub mod scanner;
mod seeds;
mod shading;
mod sphere_density;
mod stage;
#[cfg(test)]
mod test_worlds;
pub mod tone;
pub mod transfer;
pub mod visibility;
pub mod world;

pub use crate::rays as accelerate;

pub use culling::shown;
pub use dome::{DomeNode, RadianceAt, ReferenceDome};
pub use renderer::{Options, ReferencePicture, ReferenceRenderer, render};
pub use world::{
    NormalFrame, NormalMap, ReferenceCamera, ReferenceGloss, ReferenceInterior, ReferenceLeaf, ReferenceMesh,
    ReferencePlacement, ReferenceScanner, ReferenceSide, ReferenceSun, ReferenceWorld, SlabAt, SunTransmission,
    SunlitMaps,
};

pub(crate) use mesophyll_base::error::{Error, Result};
