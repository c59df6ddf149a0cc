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
pub mod compare;
pub mod cube;
pub mod dome;
pub mod environment;
pub mod foliar;
pub mod lobe;
pub mod lookup;
#[cfg(test)]
mod made_up;
pub mod path;
pub mod quadrature;
pub mod rays;
pub mod render;
mod repeat;
pub mod scan;
mod seeds;
mod shade;
mod shown;
mod sphere_density;
mod stage;
pub mod tone;
pub mod transfer;
pub mod visibility;
pub mod world;

pub use crate::rays as accelerate;

pub use dome::{Dome, RadianceAt};
pub use render::{Options, ReferencePicture, Renderer, render};
pub use shown::shown;
pub use world::{
    Camera, Gloss, Interior, NormalFrame, NormalMap, Placement, ReferenceLeaf, ReferenceMesh, ReferenceSide,
    ReferenceSun, Scanner, SlabAt, Sunlit, Through, World,
};

pub(crate) use mesophyll_base::error::{Error, Result};
