//! Light transport on the CPU: the reference renderer that pictures are judged against.
//!
//! It shares no code with the GPU renderer, whose shaders are written in another language. Rays, texture look-ups, the
//! bounded lobes, directional albedo, sampling and tone mapping are written here in f64, so that an error on one side
//! becomes visible. Both must agree on the shading that is described at the top of `mesophyll_viewer::scene`.
//! [`render`] draws direct light only: the sun's disk, and a constant sky or a dome of any radiance, which nothing
//! shadows. [`path`] follows all light from leaf to leaf.
//!
//! Two things are those of `optics`, and an error in them would be on both sides of what is compared here:
//!
//! - D and F of a lobe ([`lobe::Lobe`]). The shaders compute them on their own, and `tests/scenes/reference` compares
//!   pictures of both. G, the limits and the albedo are this package's.
//! - The foliar models of B1 ([`foliar`]): the table and the lobes of FSM, a ray's walk through the layers (ABM), and
//!   the goniometer's patches. `path/foliar_tests.rs` compares pictures of both models with
//!   `mesophyll_optics::foliar::exact`, which solves the layers' integral equation and follows no ray, and the draws of
//!   directions with their densities.

#![warn(missing_docs)]

pub mod albedo;
mod camera;
pub mod closed_form;
#[cfg(feature = "render")]
pub mod comparison;
pub mod cube;
mod culling;
pub mod dome;
pub mod environment;
mod even;
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
mod surface;
#[cfg(test)]
mod test_worlds;
pub mod transfer;
mod validation;
pub mod visibility;
pub mod world;

pub use crate::rays as accelerate;

pub use camera::{CameraRays, ReferenceCamera};
pub use culling::{covered, shown};
pub use dome::{DomeNode, RadianceAt, ReferenceDome};
pub use mesophyll_base::tone;
pub use renderer::{Options, ReferencePicture, ReferenceRenderer, render};
pub use world::{
    NormalFrame, NormalMap, ReferenceGloss, ReferenceInterior, ReferenceLeaf, ReferencePlace, ReferencePlacement,
    ReferenceScanner, ReferenceSide, ReferenceSun, ReferenceWorld, SlabAt, SunTransmission, SunlitMaps,
};

pub(crate) use mesophyll_base::error::{Error, Result};
