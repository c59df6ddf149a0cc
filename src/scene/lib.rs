//! The plan of what a scene needs, and the hand-over to the renderers. What a scene file says is the room `manifest`,
//! below this one.
//!
//! Folders from the ground up, each of which may use only those before it: [`fits`] are the folders that its leaves
//! come from, [`placed`] is what stands where and in which light, [`plan`] is what of it is needed, [`loaded`] holds
//! the maps and curves that the plan asks for, [`draw`] hands them to both renderers; [`traced`], [`film`] and
//! [`window`] use all of it. Whether the pictures are right is judged in the room `check`, above this one.

#![warn(missing_docs)]

pub mod draw;
#[cfg(feature = "render")]
pub mod film;
pub mod fits;
pub mod ledger;
pub mod loaded;
pub mod placed;
pub mod plan;
pub mod traced;
pub mod transfer;
#[cfg(feature = "render")]
pub mod window;

pub(crate) use mesophyll_error::{Error, Result};
