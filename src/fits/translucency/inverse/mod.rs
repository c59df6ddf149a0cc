//! Finds what a leaf is made of from photographs of the light that comes through it: absorption σa and reduced
//! scattering σs′ = (1 − g)σs in each channel, and one factor on its thickness.
//!
//! Photographs of the unlit side under a few lights of known direction are compared with the same model that renders
//! (H9 Eq. 3.14, the thin form): seen = exit · A_p Σ_i T(|x_o − x_i|, f·d_i) E(x_i, ω). E is the irradiance that enters
//! texel i, d_i its thickness, f the factor, A_p a texel's area and T the kernel. How much light comes through tells
//! one number for each channel and thickness. How far it spreads, in texels of known size, tells a length. Together
//! they separate absorption from scattering, and both from the thickness. The cost is ½ Σ ((model − seen)/sd)². Its
//! gradient is that of the discretised model, by correlation ([`mesophyll_optics::translucency::tangent`]). argmin's
//! L-BFGS minimises it in the logarithms, in coordinates in which the Gauss–Newton matrix at each round's start is
//! close to the identity. sd is that of the *modelled* value (a reading's own sd would bias the fit low) and is renewed
//! in every round.
//!
//! **g is not among the unknowns**: the model contains scattering only as σs′, in its kernel, its unscattered light and
//! its totals. Units: mm, 1/mm.
//!
//! Standard errors include the noise of the readings and the errors that the leaf fit states for its thickness map
//! ([`thickness`]).
//!
//! Limits: the errors of diffusion and of the kernel for normal incidence are not in the standard errors. Where the
//! residuals exceed what noise and thickness explain, errors are scaled by them. The caller has to leave out texels
//! near a border of the picture that the leaf extends beyond.

mod certainty;
mod comparison;
mod folder;
mod model;
mod rounds;
pub mod run;
pub mod synthetic;
mod thickness;

pub use certainty::TissueCertainty;
pub use model::logarithms;
pub use rounds::fit;
pub use thickness::ThicknessErrors;

use crate::record::ResidualStatistics;
use mesophyll_base::solvers::{Termination, Trace};
use mesophyll_optics::translucency::convolution::TotalsSource;

/// One channel of one photograph, in the lit side's columns, row by row.
#[derive(Debug, Clone)]
pub struct TissueImage {
    /// Which of the thickness maps the light enters.
    pub map: usize,
    /// Irradiance that enters, relative to that of a plane that faces the light.
    pub light: Vec<f64>,
    /// Cosine of the angle between the light and the blade's normal, above 0 to 1.
    pub cosine: f64,
    /// Share of the inner light that leaves through the seen side.
    pub exit: Vec<f64>,
    /// The photograph's values (1 = a white sheet that faces the light); not read where not used.
    pub seen: Vec<f64>,
    /// Texels that count.
    pub used: Vec<bool>,
}

/// The photographs of one wavelength.
#[derive(Debug, Clone)]
pub struct TissueChannel {
    /// Name of the channel: `R`, `G` or `B`.
    pub name: String,
    /// Boundary term A ≥ 1.
    pub a: f64,
    /// This channel of every photograph.
    pub images: Vec<TissueImage>,
}

/// Everything that was measured.
#[derive(Debug, Clone)]
pub struct TissueMeasurement {
    /// Columns of every photograph and map.
    pub width: usize,
    /// Size of a texel on the blade (mm).
    pub texel_mm: f64,
    /// Thickness (mm) in the columns of each lit side, 0 off the leaf.
    pub thickness: Vec<Vec<f64>>,
    /// The known errors of these maps.
    pub thickness_errors: ThicknessErrors,
    /// The readings, a channel each.
    pub channels: Vec<TissueChannel>,
    /// Noise of the readings.
    pub noise: TissueNoise,
}

/// Noise of a reading: its standard deviation is √((relative·value)² + floor²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TissueNoise {
    /// The part that grows with the reading, as a share of it.
    pub relative: f64,
    /// The part that every reading has, in the unit of the readings (1 is a white sheet that faces the beam).
    pub floor: f64,
    /// Whether these numbers are the noise; otherwise they are only weights, and the residuals tell the level.
    pub known: bool,
}

impl TissueNoise {
    /// For exact values: all texels have the same relative weight.
    pub const EXACT: TissueNoise = TissueNoise { relative: 0.01, floor: 0.0, known: false };
}

/// The start of a fit, or a truth.
#[derive(Debug, Clone, PartialEq)]
pub struct TissueCoefficients {
    /// Absorption coefficient σa (1/mm), a channel each.
    pub sigma_a: Vec<f64>,
    /// Reduced scattering coefficient σs′ = (1 − g) σs (1/mm), a channel each.
    pub reduced: Vec<f64>,
    /// Factor on the thickness map.
    pub scale: f64,
}

/// The incidence for which the total transmittance of a beam is computed.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::Display,
    strum::EnumIter,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
pub enum BeamIncidence {
    /// Each beam's own
    Slant,
    /// Along the normal for every beam, as the renderers assume
    Normal,
}

/// How the fit is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Thickness levels.
    pub levels: usize,
    /// Where the total transmittance is taken from.
    pub totals: TotalsSource,
    /// With the transport equation's totals: the incidence for which they are computed.
    pub incidence: BeamIncidence,
    /// Takes the thickness map as it is and fits no factor on it.
    pub fix_scale: bool,
    /// Largest number of rounds of descent.
    pub rounds: usize,
    /// Reports progress on stderr, round by round.
    pub told: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            levels: 8,
            totals: TotalsSource::Transport,
            incidence: BeamIncidence::Slant,
            fix_scale: false,
            rounds: 12,
            told: false,
        }
    }
}

/// The result of the fit.
#[derive(Debug, Clone)]
pub struct TissueFit {
    /// The coefficients and the thickness scale that fit best.
    pub tissues: TissueCoefficients,
    /// Certainty of the logarithms: σa and σs′ of each channel, then the scale unless it was fixed.
    pub certainty: TissueCertainty,
    /// How the search ended.
    pub termination: Termination,
    /// The steps of the search, each with its cost.
    pub trace: Trace,
    /// The parameters (not their logarithms) of each row of the trace.
    pub points: Vec<TissueCoefficients>,
    /// How often the cost was evaluated with its gradient, plus the number of Jacobians.
    pub evaluations: usize,
    /// Residuals of each channel, in the order of the channels.
    pub residuals: Vec<ResidualStatistics>,
    /// χ² of all readings over the degrees of freedom; to be compared with `expected_chi2`.
    pub reduced_chi2: f64,
    /// Reduced χ² that is expected from the noise of the readings and the stated errors of the thickness maps.
    pub expected_chi2: f64,
}

#[cfg(test)]
mod tests;
