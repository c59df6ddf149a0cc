//! Whole plants: what one is ([`form`]), its glTF file ([`file`]), growing one from a table ([`mod@grow`]) and finding
//! the branches of one that is nothing but triangles ([`import`]); what its branches carry ([`mod@carried`]) and where
//! they are when they bend ([`pose`]).
//!
//! Lengths are in mm, z is up and the foot is the origin, but in the tables of [`import`], which keep the frame of the
//! file that was read.

#![warn(missing_docs)]

pub mod carried;
pub mod file;
pub mod form;
pub mod grow;
pub mod import;
pub mod pose;

pub(crate) use mesophyll_error::{Error, Result};
