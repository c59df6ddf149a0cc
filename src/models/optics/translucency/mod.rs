//! Light that goes through a leaf with relief (Habel et al. 2007; Habel 2009 §3.3): from maps of a blade to the
//! directional transmittance of every texel.
//!
//! A [`blade::BladeMaps`] is lit from one side. The light that enters a texel from a direction follows from its normal,
//! from the share that enters, and from the horizon around it ([`horizon`], [`irradiance`]). This light is projected
//! onto a few functions of direction ([`lights`], [`basis`]). Each of the resulting images is convolved with the kernel
//! of a leaf's inside ([`convolution`]).
//!
//! Lengths in mm. Directions are unit vectors in the lit side's image frame: x right, y up (towards row 0), z out of
//! the lit side.

#![warn(missing_docs)]

pub mod basis;
pub mod blade;
pub mod convolution;
mod fourier;
pub mod horizon;
pub mod irradiance;
mod kernel;
pub mod levels;
pub mod lights;
pub mod relief;
mod support;
pub mod tangent;
