//! Plants that stand in many places and are stored once.

use super::placement::LeafPlacement;
use super::plant::{PlacedPlant, PlacedWood};
use super::winds::{SwayingPlant, SwayingPlants};
use glam::DMat4;
use mesophyll_plants::pose::RigidMotion;

/// A `[[plant]]` whose plants share poses.
#[derive(Debug)]
pub struct PlacedStand {
    /// Its leaves at rest, in the plant's frame, with their sections in the first pose.
    pub leaves: Vec<LeafPlacement>,
    /// Its wood, in the plant's frame.
    pub wood: Vec<PlacedWood>,
    /// From the plant's frame to the world, and the pose, for each place.
    pub places: Vec<(DMat4, u32)>,
    /// How much earlier or later than by the wind gusts reach its plants (s).
    pub off: f64,
    /// Number of poses; 1 where nothing moves it.
    pub poses: usize,
    /// Number of sections of a pose; 0 where nothing moves it.
    pub sections: usize,
    /// Number of its first section among those of the scene.
    pub first: usize,
}

impl PlacedStand {
    /// The stand of a plant whose plants share poses, and that moves as `swaying`; `None` for other plants.
    pub fn new(planted: &PlacedPlant, swaying: Option<&SwayingPlant>) -> Option<PlacedStand> {
        let groups = planted.groups.as_ref()?;
        let section = |leaf: usize| swaying.map(|s| s.sections.of_leaf(0, leaf));
        let leaves = planted.leaves_at(DMat4::IDENTITY).enumerate();
        let mut rest = planted.wood();
        rest.iter_mut().for_each(|wood| wood.places = vec![DMat4::IDENTITY]);
        let pose = |place: usize| if swaying.is_some() { groups.of_place[place] } else { 0 };
        Some(PlacedStand {
            leaves: leaves.map(|(k, leaf)| LeafPlacement { section: section(k), ..leaf }).collect(),
            wood: swaying.map_or_else(|| rest.clone(), |s| s.sections.wood(rest.clone())),
            places: planted.places.iter().enumerate().map(|(k, place)| (*place, pose(k))).collect(),
            off: groups.off,
            poses: swaying.map_or(1, SwayingPlant::poses),
            sections: swaying.map_or(0, |s| s.sections.on().len()),
            first: swaying.map_or(0, |s| s.sections.first()),
        })
    }

    /// Number of leaves at all places.
    pub fn leaf_count(&self) -> usize {
        self.leaves.len().saturating_mul(self.places.len())
    }

    /// The sections of a pose at a time, of those of the scene.
    pub fn pose<'a>(&self, sections: &'a [RigidMotion], pose: usize) -> &'a [RigidMotion] {
        &sections[self.first + pose * self.sections..][..self.sections]
    }

    /// A leaf of the plant as a pose carries it, in the plant's frame.
    pub fn carried(&self, leaf: &LeafPlacement, pose: &[RigidMotion]) -> DMat4 {
        leaf.section.map_or(leaf.transform, |section| pose[section - self.first].carry(leaf.transform))
    }
}

/// The leaves that stand for all leaves of stands where a scene is planned: those at the places nearest to the cameras.
pub fn near(planted: &[PlacedPlant], winds: Option<&SwayingPlants>) -> Vec<LeafPlacement> {
    let (mut out, mut frame) = (Vec::new(), 0);
    for (k, plant) in planted.iter().enumerate() {
        let swaying = winds.and_then(|w| w.plants[k].as_ref());
        for place in plant.groups.iter().flat_map(|groups| &groups.near) {
            frame += 1;
            let leaves = plant.leaves_at(plant.places[*place]).enumerate();
            out.extend(leaves.map(|(leaf, rest)| {
                let section = swaying.map(|s| s.sections.of_leaf(s.pose_of(*place), leaf));
                LeafPlacement { section, frame, ..rest }
            }));
        }
    }
    out
}
