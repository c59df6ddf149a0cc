//! Skies and their spherical harmonics: what a clear sky looks like in every direction, and the few numbers that light
//! a scene with it.
//!
//! Conventions, once for the whole program: z is up, the sun's azimuth is 0, which is +x; azimuth grows from +x to +y.
//! Angles in radians. Radiance is luminance-weighted: XYZ with Y in kcd/m², or linear sRGB in the same unit, not
//! clamped (blue may dip below zero). Harmonics are real, orthonormal, without the Condon–Shortley phase, at index
//! l(l+1)+m; a sky's coefficients are those of the upper hemisphere with zero below the horizon. The sun's disk is not
//! part of the sky.
//!
//! - To name a sky: [`SkyFamily`], [`Preetham`], [`HosekWilkie`]. `model.sky(sun_zenith, turbidity)` gives a [`Sky`],
//!   or a [`SkyRefusal`] that says why it cannot.
//! - To look at it in a direction (unit vector): [`Sky::xyz`], [`Sky::rgb`].
//! - To project it onto harmonics by quadrature: [`projection::direct`] (to 1e-9 of c00 and better), or
//!   [`projection::ProjectionRule`] for many turbidities at one sun.
//! - To evaluate fitted polynomials: [`polynomials::FoldedPolynomials`], with `coefficients(sun_zenith, turbidity)`, or
//!   `at(turbidity)` once the turbidity is fixed.
//! - To turn, evaluate and sum harmonics: [`harmonics::HarmonicBasis`], [`harmonics::rotate_z`],
//!   [`harmonics::evaluate`].
//! - To light a surface: [`irradiance::irradiance`] on a normal, [`irradiance::add_ground`] for the light from below.
//! - For the sun's own light through that air: [`sun::irradiance`].
//! - To know where the sun stands by hour, latitude and season: [`solar_path`].
//! - To know where a panorama looks: [`panorama`].
//! - To know what a few bands miss of the radiance: [`truncation`].
//! - To reduce the ringing of a truncated series: [`window`].
//!
//! Coefficients of a sky are a [`HarmonicCoefficients`]: N² values a channel. `project::direct(sky, 7)?` is the 49×3
//! numbers of a fixed sun and turbidity.

#![warn(missing_docs)]

pub mod colour;
pub mod harmonics;
pub mod hosek_wilkie;
pub mod irradiance;
pub mod panorama;
pub mod polynomials;
pub mod preetham;
pub mod projection;
pub mod quadrature;
pub mod response;
pub mod sensor;
pub mod solar_path;
pub mod sun;
pub mod truncation;
pub mod window;

pub use harmonics::HarmonicCoefficients;
pub use hosek_wilkie::HosekWilkie;
pub use preetham::Preetham;

use std::f64::consts::FRAC_PI_2;

/// Why there is no such sky: a sentence that names the parameter, its value and what was expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SkyRefusal(pub String);

/// One sky: its parameters are fixed, only the direction is free.
pub trait Sky: std::fmt::Debug + Send + Sync {
    /// Angle of the sun from the zenith, 0 … π/2.
    fn sun_zenith(&self) -> f64;

    /// XYZ radiance (kcd/m²) from the unit direction `d`, z > 0. On and below the horizon it is the model's limit from
    /// above the horizon.
    fn xyz(&self, d: [f64; 3]) -> [f64; 3] {
        self.xyz_near_sun(d, angle_to_sun(self.sun_zenith(), d))
    }

    /// As [`Sky::xyz`], where the angle γ between `d` and the sun is already known. Skies that do not depend on γ
    /// ignore it.
    fn xyz_near_sun(&self, d: [f64; 3], gamma: f64) -> [f64; 3];

    /// Linear sRGB radiance (kcd/m², not clamped) from the unit direction `d`.
    fn rgb(&self, d: [f64; 3]) -> [f64; 3] {
        colour::rgb_from_xyz(self.xyz(d))
    }
}

/// A family of skies over the sun's zenith angle and turbidity. Fits treat it as a black box.
pub trait SkyFamily: Send + Sync {
    /// Name in files and on the command line.
    fn name(&self) -> &'static str;

    /// Turbidities that the model accepts.
    fn turbidities(&self) -> [f64; 2];

    /// Turbidities for which the model's authors vouch; [`SkyFamily::warning`] warns outside of them.
    fn trusted(&self) -> [f64; 2];

    /// The sky with these parameters.
    ///
    /// # Errors
    /// [`SkyRefusal`] for a sun below the horizon, a turbidity outside [`SkyFamily::turbidities`], and values that are
    /// not finite.
    fn sky(&self, sun_zenith: f64, turbidity: f64) -> Result<Box<dyn Sky>, SkyRefusal>;

    /// A warning about an accepted turbidity, if there is one.
    fn warning(&self, turbidity: f64) -> Option<String> {
        let [low, high] = self.trusted();
        let outside = !(low..=high).contains(&turbidity);
        outside.then(|| {
            format!("turbidity is {turbidity}, outside the {low} to {high} for which {} is trusted", self.name())
        })
    }
}

/// The models by name.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    serde::Deserialize,
    strum::Display,
    strum::EnumString,
    strum::EnumIter,
    strum::IntoStaticStr,
    strum::EnumMessage,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum SkyModel {
    /// Preetham, Shirley and Smits (1999): any turbidity, no ground.
    #[default]
    Preetham,
    /// Hošek and Wilkie (2012): with light that the ground sends back.
    HosekWilkie,
}

impl SkyModel {
    /// The model over ground of this albedo, 0 to 1. Preetham's model knows no ground.
    ///
    /// # Errors
    /// [`SkyRefusal`] for another albedo.
    pub fn over(self, albedo: f64) -> Result<Box<dyn SkyFamily>, SkyRefusal> {
        if !(0.0..=1.0).contains(&albedo) {
            return Err(SkyRefusal(format!("albedo is {albedo}; expected 0 to 1")));
        }
        Ok(match self {
            SkyModel::Preetham => Box::new(Preetham),
            SkyModel::HosekWilkie => Box::new(HosekWilkie { albedo: [albedo; 3] }),
        })
    }
}

/// A sun that is at most this far below the horizon (rad; two arc seconds) counts as being on it, so that π/2 may be
/// written with five digits.
pub const HORIZON_ROUNDING: f64 = 1e-5;

/// Checks the two parameters that every model has. Returns the sun's zenith angle, at most π/2.
///
/// # Errors
/// As [`SkyFamily::sky`].
pub fn check(sun_zenith: f64, turbidity: f64, [low, high]: [f64; 2]) -> Result<f64, SkyRefusal> {
    if !(sun_zenith >= 0.0 && sun_zenith.is_finite()) {
        return Err(SkyRefusal(format!("sun_zenith is {sun_zenith}; expected 0 (zenith) to pi/2 (horizon)")));
    }
    if sun_zenith > FRAC_PI_2 + HORIZON_ROUNDING {
        return Err(SkyRefusal(format!(
            "sun_zenith is {sun_zenith} ({:.2}°): the sun is below the horizon; expected 0 to pi/2 (90°)",
            sun_zenith.to_degrees()
        )));
    }
    if !(low..=high).contains(&turbidity) {
        return Err(SkyRefusal(format!("turbidity is {turbidity}; expected {low} to {high}")));
    }
    Ok(sun_zenith.min(FRAC_PI_2))
}

/// Unit vector to a sun at this zenith angle: azimuth 0.
pub fn sun_direction(sun_zenith: f64) -> [f64; 3] {
    [sun_zenith.sin(), 0.0, sun_zenith.cos()]
}

/// Angle between the unit direction `d` and the sun, precise for small and large angles (an arc cosine of the dot
/// product would have half the digits).
pub fn angle_to_sun(sun_zenith: f64, d: [f64; 3]) -> f64 {
    let [sx, _, sz] = sun_direction(sun_zenith);
    let cross = [-sz * d[1], sz * d[0] - sx * d[2], sx * d[1]];
    let length = (cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]).sqrt();
    length.atan2(sx * d[0] + sz * d[2])
}
