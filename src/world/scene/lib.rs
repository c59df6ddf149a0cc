//! The plan of what a scene needs, and the hand-over to the renderers.
//!
//! Two rooms are below this one: `manifest` is the content of a scene file, and `placed` holds the things in the world
//! and their places. The folders here are listed from the bottom up, and each may use only those before it. [`plan`]
//! decides which parts of a scene are needed. [`loaded`] holds the maps and curves that the plan needs. [`draw`] hands
//! them to both renderers. [`path_tracing`], [`film`] and [`window`] use all of these. The room `check`, above this
//! one, judges whether the pictures are right.

#![warn(missing_docs)]

pub mod draw;
#[cfg(feature = "render")]
pub mod film;
pub mod loaded;
pub mod manifest;
pub mod path_tracing;
pub mod placed;
pub mod plan;
pub mod transfer;
#[cfg(feature = "render")]
pub mod verdict;
pub mod web;
#[cfg(feature = "render")]
pub mod window;

pub(crate) use mesophyll_base::error::{Error, Result};
