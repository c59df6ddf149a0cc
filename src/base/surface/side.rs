//! The two sides of a leaf, and how a map in one side's columns is written in the other's.

use serde::{Deserialize, Serialize};

/// A side of a leaf. The front is the upper (adaxial) one.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    strum::Display,
    strum::EnumString,
    strum::IntoStaticStr,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Side {
    /// The upper (adaxial) side.
    Front,
    /// The lower (abaxial) side.
    Back,
}

impl Side {
    /// Both, the front first.
    pub const ALL: [Side; 2] = [Side::Front, Side::Back];

    /// The name of the side in files and sections of a fit.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The side's name in botany: adaxial is the upper side, which faces the stem, and abaxial the lower one.
    pub fn botanical(self) -> &'static str {
        match self {
            Side::Front => "adaxial",
            Side::Back => "abaxial",
        }
    }

    /// The side of a name from botany.
    pub fn of_botanical(name: &str) -> Option<Side> {
        Side::ALL.into_iter().find(|side| side.botanical() == name)
    }

    /// Index in the front's map of the texel that is at `k` in this side's map. Maps are row-major with `width`
    /// columns.
    pub fn in_front(self, k: usize, width: usize) -> usize {
        match self {
            Side::Front => k,
            Side::Back => behind(k, width),
        }
    }

    /// The opposite side.
    pub fn other(self) -> Side {
        match self {
            Side::Front => Side::Back,
            Side::Back => Side::Front,
        }
    }
}

/// One thing for each side of a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct Sides<T> {
    /// What belongs to the front.
    pub front: T,
    /// What belongs to the back.
    pub back: T,
}

impl<T> Sides<T> {
    /// Makes both, the front's first.
    pub fn of(mut make: impl FnMut(Side) -> T) -> Sides<T> {
        Sides { front: make(Side::Front), back: make(Side::Back) }
    }

    /// As [`Sides::of`], where either may fail.
    pub fn try_of<E>(mut make: impl FnMut(Side) -> Result<T, E>) -> Result<Sides<T>, E> {
        Ok(Sides { front: make(Side::Front)?, back: make(Side::Back)? })
    }

    /// Both with their sides, the front first.
    pub fn iter(&self) -> impl Iterator<Item = (Side, &T)> {
        [(Side::Front, &self.front), (Side::Back, &self.back)].into_iter()
    }

    /// As [`Sides::iter`], to be changed.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (Side, &mut T)> {
        [(Side::Front, &mut self.front), (Side::Back, &mut self.back)].into_iter()
    }
}

impl<T> std::ops::Index<Side> for Sides<T> {
    type Output = T;
    fn index(&self, side: Side) -> &T {
        match side {
            Side::Front => &self.front,
            Side::Back => &self.back,
        }
    }
}

impl<T> std::ops::IndexMut<Side> for Sides<T> {
    fn index_mut(&mut self, side: Side) -> &mut T {
        match side {
            Side::Front => &mut self.front,
            Side::Back => &mut self.back,
        }
    }
}

/// Index of the texel that lies behind texel `k` of a row-major map with `width` columns: the cameras of the two sides
/// see the columns in opposite order.
pub fn behind(k: usize, width: usize) -> usize {
    k / width * width + width - 1 - k % width
}

/// A map with its columns reversed: the front's as the back's camera sees it, and the other way round.
pub fn mirror<T: Clone>(map: &[T], width: usize) -> Vec<T> {
    map.chunks(width.max(1)).flat_map(|row| row.iter().rev().cloned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirrored_map_holds_what_lies_behind() {
        let map: Vec<usize> = (0..12).collect();
        let seen = mirror(&map, 4);
        assert!((0..12).all(|k| seen[k] == behind(k, 4) && behind(behind(k, 4), 4) == k));
        assert_eq!(Side::ALL.map(|s| s.name().parse::<Side>().ok()), Side::ALL.map(Some));
        assert_eq!(Side::Front.other(), Side::Back);
    }
}
