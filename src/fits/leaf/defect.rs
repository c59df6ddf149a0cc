//! The defects that a scan under a linear light source can have, and how they are told.

use crate::gloss::{GlossTexelFit, NO_LIGHT};
use mesophyll_optics::defect::Defect;

/// Where the standard error of ρd is larger than this, half of all the light, the traces say nothing about the texel.
const UNKNOWN: f64 = 0.5;

/// Every defect that a scan can have.
pub const OF_SCANS: [Defect; 10] = [
    Defect::NoReading,
    Defect::NotConverged,
    Defect::Energy,
    Defect::Transmission,
    Defect::ThicknessUndetermined,
    Defect::ThicknessRange,
    Defect::Ambiguous,
    Defect::NoLight,
    Defect::Unexplained,
    Defect::Foreign,
];

/// Whether the reading failed rather than the leaf. Then the values of the neighbours are the best guess of what would
/// have been read.
pub fn failed_reading(defect: Defect) -> bool {
    use Defect::{Energy, Foreign, NoReading, NotConverged, ThicknessRange, Transmission, Unexplained};
    matches!(defect, NoReading | NotConverged | Energy | Transmission | ThicknessRange | Unexplained | Foreign)
}

/// Whether the transmittance was misread, so that it says nothing about the texel.
pub fn of_light_box(defect: Defect) -> bool {
    matches!(defect, Defect::Transmission | Defect::ThicknessRange)
}

/// The defect of a texel whose gloss fit ended badly.
pub fn of_texel(fit: &GlossTexelFit) -> Option<Defect> {
    if fit.defect == Some(NO_LIGHT) {
        Some(Defect::NoLight)
    } else if fit.samples < fit.parameters + 3 || fit.rho_d.iter().any(|v| v.is_nan()) {
        Some(Defect::NoReading)
    } else if !fit.termination.converged() {
        Some(Defect::NotConverged)
    } else if fit.rho_d_err.iter().any(|e| !(*e < UNKNOWN)) || fit.rho_d.iter().all(|v| *v == 0.0) {
        Some(Defect::Ambiguous)
    } else {
        None
    }
}
