//! Draws leaves and the plants that they grow on with wgpu, with or without a window. The input is plain scene data:
//! meshes, materials, instances, branches and lights ([`scene`]). This crate knows nothing of fits or of scene files.
//!
//! ```no_run
//! use mesophyll_viewer::{Error, Options, Renderer, scene::{Camera, Scene}};
//!
//! fn draw(scene: &Scene, camera: &Camera) -> Result<(), Error> {
//!     let mut renderer = Renderer::headless(&Options::default())?;
//!     renderer.set_scene(scene)?;
//!     renderer.render(camera, 800, 600)?.save_png("leaf.png".as_ref())
//! }
//! ```

#![warn(missing_docs)]
// A page in a browser must not wait for the adapter. So what reads pictures and times back has no callers there.
#![cfg_attr(target_arch = "wasm32", allow(dead_code))]

mod bend;
mod detail;
mod dome;
mod error;
mod extents;
mod far;
mod geometry;
pub mod gpu;
mod grass;
mod guard;
mod least_squares;
pub mod lobe;
mod maps;
mod material;
#[cfg(not(target_arch = "wasm32"))]
mod operations;
mod orbit;
mod passes;
pub mod picking;
mod picture;
pub mod readback;
mod renderer;
mod samplers;
pub mod scene;
mod shader;
mod stand;
mod stats;
mod thinning;
mod timing;
mod validation;
mod variant;
mod vertices;

pub use error::{Error, Result};
pub use extents::ball_around;
pub use gpu::{AdapterInfo, Backend, Options};
pub use orbit::OrbitCamera;
pub use picture::Picture;
#[cfg(not(target_arch = "wasm32"))]
pub use picture::save_png;
/// For tests of shaders that other programs use. It is not part of this crate's stable interface.
#[cfg(not(target_arch = "wasm32"))]
#[doc(hidden)]
pub use pollster;
pub use renderer::Renderer;
pub use renderer::measure::DrawnInstance;
pub use stats::{RenderStatistics, Upload};
pub use timing::FrameTiming;
#[doc(hidden)]
pub use wgpu;
