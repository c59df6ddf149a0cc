//! Fits of branches: the shape that a branch takes under a load (`beam`), and how it swings in the wind (`motion`).

#![warn(missing_docs)]

pub mod beam;
pub mod motion;

pub(crate) use mesophyll_base::error::{Error, Result};
