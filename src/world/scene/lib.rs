//! The plan of what a scene needs, and the hand-over to the renderers.
//!
//! The folders are listed from the bottom up, and each may use only those before it. [`manifest`] is the content of a
//! scene file. [`placed`] holds the things in the world and their places. [`plan`] decides which parts of a scene are
//! needed. [`loaded`] holds the maps and curves that the plan needs. [`world`] puts all of it together once, and
//! [`draw`] hands that to both renderers. [`path_tracing`], [`film`] and [`window`] use all of these. The room `check`,
//! above this one, judges whether the pictures are right.

#![warn(missing_docs)]

pub mod draw;
#[cfg(feature = "render")]
pub mod film;
pub mod loaded;
pub mod manifest;
pub mod path_tracing;
pub mod placed;
pub mod plan;
#[cfg(feature = "render")]
pub mod real_time;
pub mod transfer;
pub mod verdict;
#[cfg(feature = "render")]
pub mod web;
#[cfg(feature = "window")]
pub mod window;
pub mod world;

pub(crate) use mesophyll_base::error::{Error, Result};
