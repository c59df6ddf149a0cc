//! Maps, curves and coefficients that a plan asks for.

pub mod gloss_bound;
pub mod texel_frame;
pub mod translucency;
