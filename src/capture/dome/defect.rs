//! The defects that a texel can have, by name. A status of 1 is a good texel, 0 is off the leaf, and the codes of the
//! defects say what is wrong.

use serde::Serialize;

/// A named defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Defect {
    /// A photograph has no number here: dead, or saturated in every exposure.
    NoReading,
    /// A photograph reads `full_scale` or more here.
    Saturated,
    /// A height scan has no number here, on either side; the maps hold values from its neighbours.
    Hole,
    /// The two heights leave no thickness above 0.
    Thickness,
    /// Albedo and transmittance sum to more than 1 in some channel, by more than three standard errors.
    Energy,
    /// Once the highlight is subtracted, the albedo is below 0 in some channel by more than three standard errors.
    Dark,
}

/// Status of a texel off the leaf.
pub const OUTSIDE: i16 = 0;
/// Status of a texel on the leaf with nothing wrong.
pub const GOOD: i16 = 1;

impl Defect {
    /// Every defect, in the order of their codes.
    pub const ALL: [Defect; 6] =
        [Defect::NoReading, Defect::Saturated, Defect::Hole, Defect::Thickness, Defect::Energy, Defect::Dark];

    /// Its status in maps: −1 and down.
    pub fn code(self) -> i16 {
        -1 - self as i16
    }

    /// Its name in messages and in `fit.toml`.
    pub fn name(self) -> &'static str {
        match self {
            Defect::NoReading => "no_reading",
            Defect::Saturated => "saturated",
            Defect::Hole => "hole",
            Defect::Thickness => "thickness",
            Defect::Energy => "energy",
            Defect::Dark => "dark",
        }
    }
}
