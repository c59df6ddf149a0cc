//! The pigments of leaves from the light that they reflect and let through.

pub mod pigments;
