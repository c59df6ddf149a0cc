//! Units of length, by the names that files and options give them.

use serde::Deserialize;

/// What one unit of a file's lengths is.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Deserialize,
    strum::IntoStaticStr,
    strum::EnumString,
    strum::EnumIter,
    strum::EnumMessage,
)]
pub enum LengthUnit {
    /// Micrometres
    #[serde(rename = "um")]
    #[strum(to_string = "um", serialize = "µm", serialize = "μm", serialize = "micron", serialize = "microns")]
    Micrometre,
    /// Millimetres
    #[serde(rename = "mm")]
    #[strum(to_string = "mm")]
    Millimetre,
    /// Centimetres
    #[serde(rename = "cm")]
    #[strum(to_string = "cm")]
    Centimetre,
    /// Metres, which glTF asks for
    #[serde(rename = "m")]
    #[strum(to_string = "m")]
    Metre,
}

impl LengthUnit {
    /// One unit in mm.
    pub fn mm(self) -> f64 {
        match self {
            LengthUnit::Micrometre => 1e-3,
            LengthUnit::Millimetre => 1.0,
            LengthUnit::Centimetre => 10.0,
            LengthUnit::Metre => 1000.0,
        }
    }
}
