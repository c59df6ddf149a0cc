//! The two sides of a leaf, and maps as either side's camera sees them.

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
    Front,
    Back,
}

impl Side {
    /// Both, the front first.
    pub const ALL: [Side; 2] = [Side::Front, Side::Back];

    /// As files and sections of a fit are called.
    pub fn name(self) -> &'static str {
        self.into()
    }

    pub fn other(self) -> Side {
        match self {
            Side::Front => Side::Back,
            Side::Back => Side::Front,
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
