//! What light does in and on a leaf, one model a folder. This room reads no files and solves no fits.
//!
//! | model | says |
//! |---|---|
//! | [`slab`] | what share of the light a leaf reflects and lets through, from σa, σs and thickness, and back |
//! | [`gloss`] | how its surface reflects light from one direction into another |
//! | [`tube`] | what a camera sees of a texel while a luminous tube travels over the leaf |
//! | [`dipole`] | where light leaves the far side that entered at one point |
//! | [`foliar`] | what the layers of a leaf do to rays of light |
//! | [`plates`] | what a leaf reflects and lets through as a stack of plates, with what real leaves hold |
//!
//! [`number`] has the numbers that formulas are computed with where derivatives are asked for.
//!
//! Lengths are in mm, absorption σa and scattering σs in 1/mm, angles in radians. Short names of sources such as W, H9
//! and G3 are explained in `docs/sources.md`.

#![warn(missing_docs)]

pub mod dipole;
pub mod foliar;
pub mod number;
pub mod plates;
pub mod slab;
pub mod translucency;
pub mod tube;
pub mod walk;

pub use mesophyll_base::processor::InstructionSet;
pub use mesophyll_base::surface::{defect, gloss, side};
