//! Whether a level ground needs to cast shadows.
//!
//! A ground that casts none leaves the shadow maps to what stands on it: their texels are finer. Its shadow can only
//! fall on what lies below it. Most plants end just below the ground, if only by rounding. What nobody sees may be
//! lit there.

use crate::manifest::SceneManifest;
use crate::placed::PlacedScene;
use crate::placed::placement::LeafPlacement;
use crate::placed::plant::PlacedWood;
use crate::placed::stand::PlacedStand;
use glam::{DMat4, DVec3};
use mesophyll_files::mesh::LeafMesh;

/// A level rectangle, and the eyes that look at the scene.
struct Level {
    /// Lowest and highest corner.
    corners: [DVec3; 2],
    eyes: Vec<DVec3>,
}

impl Level {
    fn height(&self) -> f64 {
        self.corners[1].z
    }

    /// Whether a point lies above, or is hidden by the rectangle from every eye.
    fn clears(&self, p: DVec3) -> bool {
        let [low, high] = self.corners;
        let hidden = |eye: &DVec3| {
            let at = p + (*eye - p) * ((high.z - p.z) / (eye.z - p.z));
            eye.z > high.z && at.x >= low.x && at.x <= high.x && at.y >= low.y && at.y <= high.y
        };
        p.z >= high.z || self.eyes.iter().all(hidden)
    }

    /// The same of all plants of a stand, as far as boxes around a plant at rest tell.
    fn clears_stand(&self, stand: &PlacedStand, placed: &PlacedScene) -> bool {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut add = |p: DVec3| (low, high) = (low.min(p), high.max(p));
        for (leaf, mesh) in stand.leaves.iter().filter_map(|p| Some((p, placed.leaves[p.leaf].mesh.as_ref()?))) {
            mesh.positions.iter().for_each(|p| add(leaf.transform.transform_point3(*p)));
        }
        stand.wood.iter().flat_map(|wood| &wood.mesh.positions).for_each(|p| add(*p));
        let corner = |k: usize| {
            let pick = |bit: usize, l: f64, h: f64| if k & bit == 0 { l } else { h };
            DVec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z))
        };
        let stands = |(place, _): &(DMat4, u32)| (0..8).all(|k| self.clears(place.transform_point3(corner(k))));
        low.x > high.x || stand.places.iter().all(stands)
    }
}

/// Whether everything stands above the ground, or is hidden by it from every view of the scene.
pub fn hides_what_is_below(manifest: &SceneManifest, placed: &PlacedScene) -> bool {
    let Some(corners) = placed.ground.as_ref().and_then(|(ground, _)| ground.extent()) else { return false };
    let level = Level { corners, eyes: manifest.perspectives().map(|view| view.camera.eye).collect() };
    let wood = |w: &PlacedWood| {
        let clears = |place: &DMat4| w.mesh.positions.iter().all(|v| level.clears(place.transform_point3(*v)));
        w.places.iter().all(clears)
    };
    let balls: Vec<Option<(DVec3, f64)>> =
        placed.leaves.iter().map(|l| l.mesh.as_ref().map(LeafMesh::bounds)).collect();
    let leaf = |p: &LeafPlacement| {
        let (mesh, (centre, radius)) = (placed.leaves[p.leaf].mesh.as_ref()?, balls[p.leaf]?);
        let low = p.transform.transform_point3(centre).z - radius * p.transform.x_axis.truncate().length();
        // Of most leaves the ball is above the ground, so that no vertex is looked at.
        let clears = |v: &DVec3| level.clears(p.transform.transform_point3(*v));
        Some(low >= level.height() || mesh.positions.iter().all(clears))
    };
    placed.wood.iter().all(wood)
        && placed.standing().filter_map(leaf).all(|b| b)
        && placed.stands.iter().all(|stand| level.clears_stand(stand, placed))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point just below the ground is hidden from eyes above it, unless the line of sight passes beside it. From
    /// below nothing is hidden.
    #[test]
    fn what_lies_below_is_hidden_from_above() {
        let corners = [DVec3::new(-100.0, -100.0, 5.0), DVec3::new(100.0, 100.0, 5.0)];
        let level = |eye: DVec3| Level { corners, eyes: vec![DVec3::new(0.0, 0.0, 900.0), eye] };
        let above = DVec3::new(0.0, -500.0, 300.0);
        let root = DVec3::new(0.0, 0.0, -40.0);
        assert!(level(above).clears(root) && level(above).clears(DVec3::new(0.0, 0.0, 5.0 - 1e-12)));
        // Half of the way to an eye at the height of 50 leads beside the rectangle, where the eye is 400 away.
        assert!(!level(DVec3::new(0.0, -400.0, 50.0)).clears(root));
        assert!(!level(DVec3::new(0.0, 0.0, -300.0)).clears(root));
        assert!(!level(above).clears(DVec3::new(0.0, -130.0, 4.0)));
        assert!(level(DVec3::new(0.0, 0.0, -300.0)).clears(DVec3::new(0.0, 0.0, 6.0)));
    }
}
