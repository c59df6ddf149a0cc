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

mod bend;
mod detail;
mod dome;
mod error;
mod geometry;
pub mod gpu;
mod grass;
pub mod lobe;
mod maps;
mod material;
mod operations;
mod passes;
pub mod pick;
mod picture;
pub mod readback;
mod renderer;
pub mod scene;
mod shader;
mod stats;
mod thin;
mod timing;
mod validate;
mod variant;

pub use error::{Error, Result};
pub use geometry::ball_around;
pub use gpu::{AdapterInfo, Backend, Options};
pub use picture::{Picture, save_png};
pub use renderer::Renderer;
pub use stats::{Stats, Upload};
pub use timing::Timing;
/// For tests of shaders that other programs use. It is not part of this crate's stable interface.
#[doc(hidden)]
pub use {pollster, wgpu};
