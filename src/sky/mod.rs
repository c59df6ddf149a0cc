//! Sky models and spherical harmonics.
