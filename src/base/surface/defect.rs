//! The defects that a texel of a measured leaf can have, by name. A mask holds [`GOOD`] for a good texel, [`OUTSIDE`]
//! for one beside the leaf, and the code of the defect otherwise. A name has the same code in every kind of fit; each
//! kind can find only some of them.

/// A named defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::IntoStaticStr, strum::EnumIter)]
#[strum(serialize_all = "snake_case")]
pub enum Defect {
    /// Too few readings: dead, or saturated in every exposure.
    NoReading,
    /// The fit of the texel's readings did not converge.
    NotConverged,
    /// More light leaves than arrives: diffuse reflectance and transmittance sum to more than 1 by more than the noise.
    Energy,
    /// A transmittance outside 0 to 1, or three transmittances that belong to no thickness of this leaf.
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
    /// A photograph reads its full scale or more here.
    Saturated,
    /// A height scan has no number here, on either side; the maps hold values from its neighbours.
    Hole,
    /// The two heights leave no thickness above 0.
    Thickness,
    /// Once the highlight is subtracted, the albedo is below 0 in some channel by more than three standard errors.
    Dark,
    /// So close to the outline that pixels of the photographs mix leaf and surroundings.
    Edge,
}

/// Mask of a texel beside the leaf.
pub const OUTSIDE: i16 = 0;
/// Mask of a texel on the leaf with nothing wrong.
pub const GOOD: i16 = 1;

impl Defect {
    /// Its code in masks: −1 and down.
    pub fn code(self) -> i16 {
        -1 - self as i16
    }

    /// Its name in messages and in `fit.toml`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The defect of a mask's code.
    pub fn from_code(code: i16) -> Option<Defect> {
        <Defect as strum::IntoEnumIterator>::iter().find(|d| d.code() == code)
    }
}
