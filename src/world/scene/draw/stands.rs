//! Hands plants that stand in many places to the path tracer: a plant once for each of its poses, as a group that
//! stands in many places. Plants with leaves that have maps of sunlight are handed over leaf by leaf, because the light
//! that passes through a leaf depends on the turn of its plant.

use crate::placed::PlacedScene;
use crate::placed::plant::MOST_LEAVES;
use crate::placed::stand::PlacedStand;
use crate::world::{SceneWorld, WorldInstance, WorldSurface};
use crate::{Error, Result};
use glam::DMat4;
use mesophyll_transport as transport;
use std::path::Path;

/// Whether each leaf of a stand is stored by itself.
fn leaf_by_leaf(placed: &PlacedScene, stand: &PlacedStand) -> bool {
    stand.leaves.iter().any(|p| placed.leaves[p.leaf].translucent.is_some())
}

/// A stand's leaves and pieces of wood that are drawn.
fn members(placed: &PlacedScene, stand: &PlacedStand) -> usize {
    stand.leaves.iter().filter(|p| placed.leaves[p.leaf].mesh.is_some()).count() + stand.wood.len()
}

/// Numbers of surfaces and of instances outside of groups that stands have in the path tracer's world, after all
/// others.
pub fn traced(placed: &PlacedScene) -> [usize; 2] {
    placed.stands.iter().fold([0; 2], |[surfaces, instances], stand| {
        let all = match leaf_by_leaf(placed, stand) {
            true => members(placed, stand).saturating_mul(stand.places.len()),
            false => 0,
        };
        [surfaces + stand.wood.len() * stand.poses, instances.saturating_add(all)]
    })
}

/// Adds stands at rest to the path tracer's world: wood once for each pose, and all plants.
///
/// # Errors
/// [`Error::Input`] for more leaves than it stores.
pub fn trace(
    of: &SceneWorld,
    placed: &PlacedScene,
    path: &Path,
    out: &mut transport::ReferenceWorld,
    surface: impl Fn(&WorldSurface) -> Result<transport::ReferenceLeaf>,
) -> Result<()> {
    let once = |stand: &PlacedStand| match leaf_by_leaf(placed, stand) {
        true => 0,
        false => members(placed, stand).saturating_mul(stand.poses),
    };
    let [_, alone] = traced(placed);
    let stored = placed.stands.iter().map(once).fold(alone, usize::saturating_add);
    if stored > MOST_LEAVES {
        let why = match alone > 0 {
            true => "; plants with translucency maps are stored leaf by leaf",
            false => "",
        };
        let found = format!("{stored} leaves and pieces of wood of plants that share poses{why}");
        let expected = format!("at most {MOST_LEAVES} for the path tracer");
        return Err(Error::unexpected(path, "plant", found, expected));
    }
    for (k, stand) in placed.stands.iter().enumerate() {
        let first = out.leaves.len();
        for wood in of.stand_wood(k) {
            let one = surface(&of.surfaces[wood])?;
            out.leaves.extend(std::iter::repeat_n(one, stand.poses));
        }
        let leaves: Vec<WorldInstance> = of.stand_leaves(k).collect();
        let plant = |pose: usize, place: DMat4| {
            let leaf = move |leaf: &WorldInstance| (leaf.surface, place * leaf.transform);
            let wood = (0..stand.wood.len()).map(move |w| (first + w * stand.poses + pose, place));
            let all = leaves.iter().map(leaf).chain(wood);
            all.map(|(leaf, transform)| transport::ReferencePlacement { leaf, transform })
        };
        if leaf_by_leaf(placed, stand) {
            out.instances.extend(stand.places.iter().flat_map(|(place, pose)| plant(*pose as usize, *place)));
            continue;
        }
        let begin = out.groups.len();
        out.groups.extend((0..stand.poses).map(|pose| plant(pose, DMat4::IDENTITY).collect()));
        let at = |(place, pose): &(DMat4, u32)| transport::ReferencePlace {
            group: begin + *pose as usize,
            transform: *place,
        };
        out.places.extend(stand.places.iter().map(at));
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
    let mut groups = world.groups.iter_mut();
    for stand in &placed.stands {
        for wood in &stand.wood {
            for pose in 0..stand.poses {
                if let Some(moved) = wood.moved_by(stand.pose(&sections, pose)) {
                    world.leaves[surface].mesh = moved;
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
        if !leaf_by_leaf(placed, stand) {
            for (group, leaves) in groups.by_ref().take(stand.poses).zip(&poses) {
                group.iter_mut().zip(leaves).for_each(|(to, leaf)| to.transform = *leaf);
            }
            continue;
        }
        for (place, pose) in &stand.places {
            let leaves = &poses[*pose as usize];
            next.by_ref().take(leaves.len()).zip(leaves).for_each(|(to, leaf)| to.transform = *place * *leaf);
            next.by_ref().take(stand.wood.len()).for_each(drop);
        }
    }
}
