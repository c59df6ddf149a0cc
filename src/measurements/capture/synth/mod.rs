//! Synthetic leaves and their scans: a specification grows into maps (the truth), and a linear light source device
//! scans them.
//!
//! Truth and fit are different code. The slab is solved by doubling ([`slab_truth`]) and the light under the tube is
//! integrated finely ([`illumination`]); neither uses any code of the fit. A leaf may also be made of layers
//! ([`layers`]), which is a different model from the fitted one.

mod colonise;
pub mod illumination;
#[cfg(test)]
mod illumination_tests;
mod interior;
pub mod layers;
pub mod leaf;
pub(crate) mod outline;
pub mod preview;
pub mod random;
pub mod scan;
pub(crate) mod sensor;
pub mod slab_truth;
pub mod spec;
mod spec_checks;
pub(crate) mod veins;
