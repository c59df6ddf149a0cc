//! The placements of single leaves. Those of plants ([`super::plant`]) follow them. Lengths are in mm.

use crate::manifest::SceneManifest;
use glam::{DMat4, DQuat, DVec3, EulerRot};

/// One leaf at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafPlacement {
    /// Index into the manifest's leaves.
    pub leaf: usize,
    /// The transform from the leaf to the world. It is that at rest if something moves the leaf.
    pub transform: DMat4,
    /// The section of a plant that the leaf moves with, by its number among the sections of the scene
    /// ([`super::sections`]).
    pub section: Option<usize>,
    /// 0, or one more than the index of the place of a plant that shares its pose
    /// ([`super::winds::SwayingPlants::frames`]): its section moves in the plant's frame. Such leaves stand for all
    /// leaves of their `[[plant]]` where a scene is planned.
    pub frame: u32,
}

/// The scene's single leaves, in the manifest's order.
pub fn placements(manifest: &SceneManifest) -> Vec<LeafPlacement> {
    let placed = |i: &crate::manifest::SceneInstance| {
        let (turn, place) = (rotation(i.rotation_deg), DVec3::from(i.position_mm));
        let transform = DMat4::from_scale_rotation_translation(DVec3::splat(i.scale), turn, place);
        manifest.leaf_index(&i.leaf).map(|leaf| LeafPlacement { leaf, transform, section: None, frame: 0 })
    };
    manifest.instances.iter().filter_map(placed).collect()
}

/// The rotation about x, then y, then z (degrees).
pub fn rotation(deg: [f64; 3]) -> DQuat {
    DQuat::from_euler(EulerRot::ZYX, deg[2].to_radians(), deg[1].to_radians(), deg[0].to_radians())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_apply_x_first_and_z_last() {
        let q = rotation([90.0, 0.0, 90.0]);
        // The turn about x maps y to z, and the turn about z leaves this unchanged. The turn about z maps x to y.
        assert!((q * DVec3::Y - DVec3::Z).length() < 1e-12);
        assert!((q * DVec3::X - DVec3::Y).length() < 1e-12);
    }
}
