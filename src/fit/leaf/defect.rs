//! What can be wrong with a texel, by name. `mask.Y` holds 1 for a good texel, 0 outside the leaf, and these codes
//! otherwise.

use crate::gloss::{NO_LIGHT, TexelFit};

/// A standard error of ρd from which on the traces say nothing of it: half of all the light.
const UNKNOWN: f64 = 0.5;

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Defect {
    /// Too few readings: dead, or saturated in every exposure.
    NoReading,
    /// The gloss fit did not converge.
    NotConverged,
    /// γρd + ρt above 1 by more than the noise: more light leaves than arrives.
    Energy,
    /// The light box gives no transmittance between 0 and 1, or three that no thickness of this leaf has.
    Transmission,
    /// Too dark in every channel to say how thick it is.
    ThicknessUndetermined,
    /// No thickness within a factor of twelve of h gives this transmittance.
    ThicknessRange,
    /// The traces do not tell ρd from gloss: a texel that faces away from the camera or the tube, or one that two lobes
    /// fit equally well.
    Ambiguous,
    /// Dark within the noise in every channel and frame: it faces away from the camera, or lies in a shadow.
    NoLight,
    /// The traces differ from every texel's by more than noise can (χ²): a hot pixel, dust on the leaf, something in
    /// the light's way.
    Unexplained,
    /// Far brighter or darker than this leaf is anywhere else, in a way that no vein is: something lies on it.
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

    /// Whether the reading failed and not the leaf: then its neighbours' values are the best guess of what would have
    /// been read.
    pub fn failed_reading(self) -> bool {
        use Defect::{Energy, Foreign, NoReading, NotConverged, ThicknessRange, Transmission, Unexplained};
        matches!(self, NoReading | NotConverged | Energy | Transmission | ThicknessRange | Unexplained | Foreign)
    }

    /// Whether what comes through was misread, so that it says nothing of the texel.
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
