//! Precomputed transfer: how light from all around arrives at the leaves of a scene, past and by way of other leaves.
//!
//! Wang et al. 2005, §4, give every vertex an operator from the harmonics of the light to the harmonics of what
//! arrives. Here an operator stands at the [`anchors`] of a leaf, a few a leaf, and its rows ([`operator`]) are what
//! shading needs.

pub mod anchors;
pub mod operator;
#[cfg(test)]
mod tests;

pub use anchors::{Anchor, Anchors, Spot};
pub use operator::{Columns, Found, Receiver, Request, Rows, measure};
