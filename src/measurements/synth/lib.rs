//! Synthetic leaves and their scans: a specification grows into maps (the truth), and a linear light source device
//! scans them.
//!
//! Truth and fit are different code. The slab is solved by doubling ([`slab_truth`]) and the light under the tube is
//! integrated finely ([`illumination`]); neither uses any code of the fit. A leaf may also be made of layers
//! ([`layers`]), which is a different model from the fitted one. [`dome`], [`beams`] and [`photo`] measure the same
//! leaves in the other ways.

#![warn(missing_docs)]

pub mod beams;
mod colonisation;
pub mod dome;
pub mod illumination;
#[cfg(test)]
mod illumination_tests;
mod interior;
pub mod layers;
pub mod leaf;
mod outline;
pub mod photo;
pub mod preview;
pub mod scan;
mod sensor;
pub mod slab_truth;
pub mod spec;
mod spec_checks;
mod veins;

pub(crate) use mesophyll_base::error::{Error, Result};
