//! The things that move in a scene: plants, with their leaves and their wood, and lawns in the wind.

use super::placement::LeafPlacement;
use super::winds::SwayingPlants;

/// Everything that moves.
#[derive(Debug, Clone, Copy)]
pub struct SceneMotion<'a> {
    /// The scene's plants, if a wind or a stated load moves them.
    pub winds: Option<&'a SwayingPlants>,
    /// Whether a wind leans any lawn.
    pub grass: bool,
}

impl SceneMotion<'_> {
    /// Whether anything moves.
    pub fn any(&self) -> bool {
        self.winds.is_some() || self.grass
    }

    /// Whether plants move, and with them leaves, wood and their shadows. A lawn that leans moves none of these.
    pub fn plants(&self) -> bool {
        self.winds.is_some()
    }

    /// Whether anything moves with time. Branches that only a load bends do not.
    pub fn with_time(&self) -> bool {
        self.winds.is_some_and(SwayingPlants::sways) || self.grass
    }

    /// A placement at a time (s).
    pub fn placement(&self, rest: &LeafPlacement, time: f64) -> LeafPlacement {
        let transform = match (rest.section, self.winds) {
            (Some(section), Some(winds)) => {
                let by = winds.sections(time)[section];
                match (rest.frame as usize).checked_sub(1).and_then(|k| winds.frames.get(k)) {
                    Some(frame) => *frame * by.carry(frame.inverse() * rest.transform),
                    None => by.carry(rest.transform),
                }
            }
            _ => rest.transform,
        };
        LeafPlacement { transform, ..*rest }
    }
}
