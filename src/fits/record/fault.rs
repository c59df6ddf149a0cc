//! Faults of a measurement that its own data show: a frame of another brightness, a wrong angle of the camera, a
//! missing dark frame.

use serde::{Deserialize, Serialize};

/// How bad a fault is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FaultGrade {
    /// The numbers hold (the fit left out what is wrong, or its errors were widened); the measurement needs a look.
    #[default]
    Doubtful,
    /// The numbers that it spoils cannot be relied on.
    Wrong,
}

/// A fault with its cause, as the data show it. `[[faults]]` in `fit.toml`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MeasurementFault {
    /// Name of the kind of fault, such as `camera-angle`; the list is in `docs/good.md`.
    pub name: String,
    /// How bad it is.
    pub grade: FaultGrade,
    /// The sides that show it: `front`, `back`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sides: Vec<String>,
    /// The quantities that it makes wrong, by their names in the maps (`rho_s`, `normal`, `sigma_a`). Empty where all
    /// hold.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spoils: Vec<String>,
    /// One plain sentence: what is wrong, in which file or field, and the likely cause.
    pub says: String,
}

impl MeasurementFault {
    /// Whether it makes `quantity` of `side` wrong.
    pub fn spoils(&self, side: &str, quantity: &str) -> bool {
        self.sides.iter().any(|s| s == side) && self.spoils.iter().any(|s| s == quantity)
    }
}
