//! What every room stands on: the one error, integration, order statistics, Chebyshev polynomials, Fourier transforms,
//! least squares, the instruction sets of processors and their vectors, images and their channels, and the names and
//! formulas of a leaf's surface. This room reads no files.

pub mod chebyshev;
pub mod error;
pub mod fourier;
pub mod image;
pub mod lanes;
pub mod number;
pub mod processor;
pub mod quadrature;
pub mod random;
pub mod rgb;
pub mod selection;
pub mod solvers;
pub mod statistics;
pub mod surface;
pub mod tone;
