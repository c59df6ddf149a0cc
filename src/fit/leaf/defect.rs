//! The defects that a texel can have, by name. `mask.Y` holds 1 for a good texel, 0 outside the leaf, and the code of
//! the defect otherwise.

use crate::gloss::{NO_LIGHT, TexelFit};

/// Where the standard error of ρd is larger than this, half of all the light, the traces say nothing about the texel.
const UNKNOWN: f64 = 0.5;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Defect {
    /// Too few readings: dead, or saturated in every exposure.
    NoReading,
    /// The gloss fit did not converge.
    NotConverged,
    /// γρd + ρt is above 1 by more than the noise: more light leaves than arrives.
    Energy,
    /// The light box gives a transmittance outside 0 to 1, or three transmittances that belong to no thickness of this
    /// leaf.
    Transmission,
    /// The texel is too dark in every channel to say how thick it is.
    ThicknessUndetermined,
    /// No thickness within a factor of twelve of h gives this transmittance.
    ThicknessRange,
    /// The traces do not tell ρd from gloss: a texel that faces away from the camera or the tube, or one that two lobes
    /// fit equally well.
    Ambiguous,
    /// Every reading in every channel and frame is dark within the noise: the texel faces away from the camera, or lies
    /// in a shadow.
    NoLight,
    /// The misfit (χ²) of the traces is larger than that of other texels by more than noise explains: a hot pixel, dust
    /// on the leaf, or something in the way of the light.
    Unexplained,
    /// Far brighter or darker than this leaf is anywhere else, and not in the way of a vein: something lies on the
    /// leaf.
    Foreign,
}

impl Defect {
    pub const ALL: [Defect; 10] = [
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

    pub fn code(self) -> i16 {
        match self {
            Defect::NoReading => -1,
            Defect::NotConverged => -2,
            Defect::Energy => -3,
            Defect::Transmission => -4,
            Defect::ThicknessUndetermined => -5,
            Defect::ThicknessRange => -6,
            Defect::Ambiguous => -7,
            Defect::NoLight => -8,
            Defect::Unexplained => -9,
            Defect::Foreign => -10,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Defect::NoReading => "no_reading",
            Defect::NotConverged => "not_converged",
            Defect::Energy => "energy",
            Defect::Transmission => "transmission",
            Defect::ThicknessUndetermined => "thickness_undetermined",
            Defect::ThicknessRange => "thickness_range",
            Defect::Ambiguous => "ambiguous",
            Defect::NoLight => "no_light",
            Defect::Unexplained => "unexplained",
            Defect::Foreign => "foreign",
        }
    }

    /// Whether the reading failed rather than the leaf. Then the values of the neighbours are the best guess of what
    /// would have been read.
    pub fn failed_reading(self) -> bool {
        use Defect::{Energy, Foreign, NoReading, NotConverged, ThicknessRange, Transmission, Unexplained};
        matches!(self, NoReading | NotConverged | Energy | Transmission | ThicknessRange | Unexplained | Foreign)
    }

    /// Whether the transmittance was misread, so that it says nothing about the texel.
    pub fn of_light_box(self) -> bool {
        matches!(self, Defect::Transmission | Defect::ThicknessRange)
    }

    /// The defect of a mask's code.
    pub fn from_code(code: i16) -> Option<Defect> {
        Defect::ALL.into_iter().find(|d| d.code() == code)
    }

    /// The defect of a texel whose gloss fit ended badly.
    pub fn of(fit: &TexelFit) -> Option<Defect> {
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
}
