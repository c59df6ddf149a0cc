//! Whole plants. [`form`] is the plant itself, and [`file`] its glTF file. [`growth`] grows a plant from a table, and
//! [`import`] finds the branches of a plant that consists of triangles only. [`branch_loads`] sums what its branches
//! carry, and [`pose`] computes where they are when they bend.
//!
//! Lengths are in mm, z is up and the foot is the origin. Only the tables of [`import`] keep the frame of the file that
//! was read.

#![warn(missing_docs)]

pub mod branch_loads;
pub mod file;
pub mod form;
pub mod growth;
pub mod import;
pub mod mechanics;
pub mod pose;

pub(crate) use mesophyll_base::error::{Error, Result};
