//! Maps, curves and coefficients that a plan asks for.

pub mod gloss_bound;
pub mod translucency;
