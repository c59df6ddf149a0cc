//! The plan of what a scene needs, and the hand-over to the renderers.
//!
//! Two rooms stand below this one: `manifest` is what a scene file says, and `placed` is what stands where in the
//! world. The folders here, from the ground up, may each use only those before it: [`plan`] is what of a scene is
//! needed, [`loaded`] holds the maps and curves that the plan asks for, [`draw`] hands them to both renderers;
//! [`traced`], [`film`] and [`window`] use all of it. The room `check`, above this one, judges whether the pictures are
//! right.

#![warn(missing_docs)]

pub mod draw;
#[cfg(feature = "render")]
pub mod film;
pub mod loaded;
pub mod plan;
pub mod traced;
pub mod transfer;
#[cfg(feature = "render")]
pub mod window;

pub(crate) use mesophyll_error::{Error, Result};
