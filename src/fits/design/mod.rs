//! Experiments planned: from a fit's own Jacobian, which readings leave the smallest standard errors.

pub mod foliar;
pub(crate) mod frames;
pub mod gloss;
pub mod leaf;
pub mod search;
pub mod tube;
