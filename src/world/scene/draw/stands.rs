//! Hands plants that stand in many places to the path tracer, leaf by leaf.

use crate::placed::PlacedScene;
use crate::placed::plant::MOST_LEAVES;
use crate::world::{SceneWorld, WorldInstance, WorldSurface};
use crate::{Error, Result};
use glam::DMat4;
use mesophyll_transport as transport;
use std::path::Path;

/// Numbers of surfaces and of instances that stands have in the path tracer's world, after all others.
pub fn traced(placed: &PlacedScene) -> [usize; 2] {
    let drawn = |leaf: usize| placed.leaves[leaf].mesh.is_some();
    placed.stands.iter().fold([0; 2], |[surfaces, instances], stand| {
        let leaves = stand.leaves.iter().filter(|p| drawn(p.leaf)).count() + stand.wood.len();
        let all = leaves.saturating_mul(stand.places.len());
        [surfaces + stand.wood.len() * stand.poses, instances.saturating_add(all)]
    })
}

/// Adds stands at rest to the path tracer's world: their wood once for each pose, and all plants leaf by leaf.
///
/// # Errors
/// [`Error::Input`] for more leaves than it follows light through.
pub fn trace(
    of: &SceneWorld,
    placed: &PlacedScene,
    path: &Path,
    out: &mut transport::ReferenceWorld,
    surface: impl Fn(&WorldSurface) -> Result<transport::ReferenceLeaf>,
) -> Result<()> {
    let [_, more] = traced(placed);
    if more > MOST_LEAVES {
        let found = format!("{more} leaves and pieces of wood of plants that share poses");
        let expected = format!("at most {MOST_LEAVES} for the path tracer; the real-time renderer draws more");
        return Err(Error::unexpected(path, "plant", found, expected));
    }
    for (k, stand) in placed.stands.iter().enumerate() {
        let first = out.leaves.len();
        for wood in of.stand_wood(k) {
            let one = surface(&of.surfaces[wood])?;
            out.leaves.extend(std::iter::repeat_n(one, stand.poses));
        }
        let leaves: Vec<WorldInstance> = of.stand_leaves(k).collect();
        for (place, pose) in &stand.places {
            let leaf = |leaf: &WorldInstance| (leaf.surface, *place * leaf.transform);
            let wood = (0..stand.wood.len()).map(|w| (first + w * stand.poses + *pose as usize, *place));
            let all = leaves.iter().map(leaf).chain(wood);
            out.instances.extend(all.map(|(leaf, transform)| transport::ReferencePlacement { leaf, transform }));
        }
    }
    Ok(())
}

/// Moves the stands of a path tracer's world to a time (s).
pub fn move_to(world: &mut transport::ReferenceWorld, placed: &PlacedScene, time: f64) {
    let Some(winds) = placed.winds.as_ref().filter(|_| !placed.stands.is_empty()) else { return };
    let sections = winds.sections(time);
    let [surfaces, instances] = traced(placed);
    let mut surface = world.leaves.len() - surfaces;
    let first = world.instances.len() - instances;
    let mut next = world.instances[first..].iter_mut();
    for stand in &placed.stands {
        for wood in &stand.wood {
            for pose in 0..stand.poses {
                if let Some(moved) = wood.moved_by(stand.pose(&sections, pose)) {
                    world.leaves[surface].mesh = (&moved).into();
                }
                surface += 1;
            }
        }
        let drawn: Vec<_> = stand.leaves.iter().filter(|p| placed.leaves[p.leaf].mesh.is_some()).collect();
        let of_pose = |pose| -> Vec<DMat4> {
            let pose = stand.pose(&sections, pose);
            drawn.iter().map(|leaf| stand.carried(leaf, pose)).collect()
        };
        let poses: Vec<Vec<DMat4>> = (0..stand.poses).map(of_pose).collect();
        for (place, pose) in &stand.places {
            let leaves = &poses[*pose as usize];
            next.by_ref().take(leaves.len()).zip(leaves).for_each(|(to, leaf)| to.transform = *place * *leaf);
            next.by_ref().take(stand.wood.len()).for_each(drop);
        }
    }
}
