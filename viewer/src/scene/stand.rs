//! Plants that stand in many places and are stored once.

#[cfg(doc)]
use super::{Instance, SectionAnimation, SectionBinding};
use glam::Mat4;

/// A plant and its places. Its instances ([`Instance::stand`]) are in the scene once. Their transforms lead to the
/// plant's own frame, and each place leads from there to the world.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlantStand {
    /// Where the plant stands.
    pub places: Vec<StandPlace>,
    /// Number of its first section. [`SectionBinding::first`] of its instances counts in the first pose.
    pub first: u32,
    /// Number of sections in a pose; those of all poses follow each other. They move in the plant's own frame.
    pub sections: u32,
    /// Number of poses, at least 1.
    pub poses: u32,
}

/// A plant at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StandPlace {
    /// From the plant's frame to the world: a rigid motion with a uniform scale.
    pub transform: Mat4,
    /// Which of the stand's poses it has.
    pub pose: u32,
}
