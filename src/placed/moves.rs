//! The things that move in a scene: branches, things that hang on them, plants, and lawns in the wind.

use super::branch::Bends;
use super::placement::{Placement, Ride};
use super::winds::Winds;

/// Everything that moves.
#[derive(Debug, Clone, Copy)]
pub struct Moves<'a> {
    /// The scene's own branches, if they bend.
    pub bends: Option<&'a Bends>,
    /// The scene's plants, if a wind moves them.
    pub winds: Option<&'a Winds>,
    /// Whether a wind leans any lawn.
    pub grass: bool,
}

impl Moves<'_> {
    /// Whether anything moves.
    pub fn any(&self) -> bool {
        self.bends.is_some() || self.winds.is_some() || self.grass
    }

    /// Whether branches or plants move, and with them leaves, wood and their shadows. A lawn that leans moves none of
    /// these.
    pub fn plants(&self) -> bool {
        self.bends.is_some() || self.winds.is_some()
    }

    /// A placement at a time (s).
    pub fn placement(&self, rest: &Placement, time: f64) -> Placement {
        let transform = match (rest.ride, self.bends, self.winds) {
            (Some(Ride::Branch(on)), Some(bends), _) => bends.transform(on, time, rest.transform),
            (Some(Ride::Section(k)), _, Some(winds)) => winds.sections(time)[k].carry(rest.transform),
            _ => rest.transform,
        };
        Placement { transform, ..*rest }
    }
}
