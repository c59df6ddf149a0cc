//! What a leaf is made of, from photographs of the light that comes through it: σa and σs′ = (1 − g)σs a channel, and
//! one factor on its thickness.
//!
//! Photographs of the unlit side under a few lights of known direction are compared with the very model that renders
//! (H9 Eq. 3.14, the thin form): seen = exit · A_p Σ_i T(|x_o − x_i|, f·d_i) E(x_i, ω). How much comes through tells
//! one number a channel and thickness; how far it spreads, in texels of known size, tells a length; together they
//! separate absorption from scattering and both from the thickness. The cost is ½ Σ ((model − seen)/sd)², its gradient
//! that of the discretised model, by correlation ([`mesophyll_translucency::tangent`]); argmin's L-BFGS
//! minimises it in the logarithms, in coordinates that the Gauss–Newton matrix at each round's start makes round. sd is
//! that of the *modelled* value (a reading's own would pull the fit low), renewed every round.
//!
//! **g is not among the unknowns**: the model holds scattering only as σs′, in its kernel, its unscattered light and
//! its totals alike. Units: mm, 1/mm.
//!
//! Standard errors hold the noise of the readings and the errors that the leaf fit states of its thickness map
//! ([`thickness`]).
//!
//! Limits: what diffusion and the normal-incidence kernel leave out is not in the standard errors; where the residuals
//! exceed what noise and thickness explain, errors are scaled by them. Texels near a border that the leaf goes on
//! beyond have to be left out by the caller.

mod certainty;
mod compare;
mod folder;
mod model;
mod rounds;
pub mod run;
pub mod synthetic;
mod thickness;

pub use certainty::Certainty;
pub use model::logarithms;
pub use rounds::fit;
pub use thickness::ThicknessErrors;

use mesophyll_record::Residuals;
use mesophyll_solve::{Termination, Trace};
use mesophyll_translucency::convolve::Totals;

/// One channel of one photograph, in the lit side's columns, row by row.
#[derive(Debug, Clone)]
pub struct Image {
    /// Which of the thickness maps the light enters.
    pub map: usize,
    /// Irradiance that enters, per irradiance of a plane that faces the light.
    pub light: Vec<f64>,
    /// Cosine of the light to the blade's normal, above 0 to 1.
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
pub struct Channel {
    /// Name of the channel: `R`, `G` or `B`.
    pub name: String,
    /// Boundary term A ≥ 1.
    pub a: f64,
    /// This channel of every photograph.
    pub images: Vec<Image>,
}

/// Everything that was measured.
#[derive(Debug, Clone)]
pub struct Measured {
    /// Columns of every photograph and map.
    pub width: usize,
    /// Size of a texel on the blade (mm).
    pub texel_mm: f64,
    /// Thickness (mm) in the columns of each lit side, 0 off the leaf.
    pub thickness: Vec<Vec<f64>>,
    /// What is known of the errors of these maps.
    pub thickness_errors: ThicknessErrors,
    /// What was read, a channel each.
    pub channels: Vec<Channel>,
    /// Noise of the readings.
    pub noise: Noise,
}

/// Noise of a reading: its standard deviation is √((relative·value)² + floor²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// The part that grows with the reading, as a share of it.
    pub relative: f64,
    /// The part that every reading has, in the unit of the readings (1 is a white sheet that faces the beam).
    pub floor: f64,
    /// Whether these are the noise, or only weights whose level the residuals tell.
    pub known: bool,
}

impl Noise {
    /// For exact values: all texels count alike, relatively.
    pub const EXACT: Noise = Noise { relative: 0.01, floor: 0.0, known: false };
}

/// What a fit begins with, or a truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Tissues {
    /// Absorption coefficient σa (1/mm), a channel each.
    pub sigma_a: Vec<f64>,
    /// Reduced scattering coefficient σs′ = (1 − g) σs (1/mm), a channel each.
    pub reduced: Vec<f64>,
    /// Factor on the thickness map.
    pub scale: f64,
}

/// How the fit is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Thickness levels.
    pub levels: usize,
    /// What the share of the light that comes through in all is taken from.
    pub totals: Totals,
    /// With the transport equation's totals: of a beam at each light's own incidence, else of one along the normal (as
    /// renderers have it).
    pub slant: bool,
    /// Take the thickness map to be right as it is, and fit no factor on it.
    pub fix_scale: bool,
    /// Rounds of descent at most.
    pub rounds: usize,
    /// Says on stderr how far it is, round by round.
    pub told: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options { levels: 8, totals: Totals::Transport, slant: true, fix_scale: false, rounds: 12, told: false }
    }
}

/// What came out.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The coefficients and the thickness scale that fit best.
    pub tissues: Tissues,
    /// In the logarithms: σa, σs′ of each channel, then the scale unless it was fixed.
    pub certainty: Certainty,
    /// How the search ended.
    pub termination: Termination,
    /// The steps of the search, each with its cost.
    pub trace: Trace,
    /// The parameters (not their logarithms) of each row of the trace.
    pub points: Vec<Tissues>,
    /// Costs with gradient, and Jacobians.
    pub evaluations: usize,
    /// A channel each, in their order.
    pub residuals: Vec<Residuals>,
    /// χ² of all readings over the degrees of freedom; to be compared with `expected_chi2`.
    pub reduced_chi2: f64,
    /// Reduced χ² that the noise of the readings and the stated errors of the thickness maps lead to expect.
    pub expected_chi2: f64,
}

#[cfg(test)]
mod tests;
