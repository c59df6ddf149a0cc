//! Precomputed transfer: how light from all around arrives at the leaves of a scene, between and by way of other
//! leaves.
//!
//! In Wang et al. 2005, §4, every vertex has an operator from the harmonics of the light to the harmonics of what
//! arrives. Here the operators are at the [`anchors`], of which a leaf has a few. Their rows ([`operator`]) are the
//! quantities that shading needs.

pub mod anchors;
mod occlusion;
pub mod operator;
#[cfg(test)]
mod tests;

pub use anchors::{Anchor, MeshAnchors, MeshPoint};
pub use operator::{
    InstanceTransfer, TransferColumns, TransferMethod, TransferReceiver, TransferRequest, TransferRows, measure,
};
