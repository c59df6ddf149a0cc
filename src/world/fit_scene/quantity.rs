//! The kinds of unknown numbers, and the scales on which they are judged.

/// Standard errors beyond which a reflectance, or another number over its own size, counts as not determined. If all
/// reflectances from 0 to 1 were as likely, that of one that nothing shows would be 0.29.
pub const UNKNOWN: f64 = 0.25;
/// Standard errors to the bound below which a number lies with a probability of 95 %.
const BELOW: f64 = 1.645;

/// An area this close to a limit is there.
const LIMIT: f64 = 1e-6;

/// The channels' names.
pub const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// What an unknown belongs to.
#[derive(Debug, Clone, PartialEq)]
pub enum UnknownKind {
    /// ρd of a leaf of the world, of the back or the front.
    RhoD(usize, bool),
    /// ρd of a leaf of discs, whose two sides nothing tells apart.
    RhoDBoth(usize),
    /// ρt of a leaf.
    RhoT(usize),
    /// ρs of a leaf.
    RhoS(usize),
    /// m of a leaf.
    Slope(usize),
    /// A number of the slab that a leaf is.
    Slab(usize, SlabNumber),
    /// A factor on maps of a leaf.
    Factor(usize, MappedNumber),
    /// The absorptions of one crossing of a leaf of layers.
    Absorption(usize),
    /// A content of a leaf of layers, by its index in the list of substances.
    Content(usize, usize),
    /// How many there are of a leaf of the world, over what the scene states.
    Area(usize),
    /// Albedo of the ground, by its leaf of the world.
    Ground(usize),
    /// Irradiance of the sun.
    Sun,
    /// Factor of the sky's radiance.
    SkyScale,
    /// Turbidity of a physical sky.
    Turbidity,
    /// Factor of the pictures with this name.
    Exposure(String),
}

/// A number of a slab.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlabNumber {
    /// σa (1/mm).
    SigmaA,
    /// σs (1/mm).
    SigmaS,
    /// The thickness (mm).
    Thickness,
}

/// What a factor is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MappedNumber {
    /// ρd of the back or the front.
    RhoD(bool),
    /// ρt of both directions.
    RhoT,
    /// ρs of both sides.
    RhoS,
    /// m of both sides.
    M,
}

/// An unknown: a number for each channel (or band), or one for all channels.
#[derive(Debug, Clone, PartialEq)]
pub struct UnknownQuantity {
    /// What it is.
    pub kind: UnknownKind,
    /// Its name; a channel's number has `.R`, `.G` or `.B` after it, a band's its wavelength, as `.865nm`.
    pub name: String,
    /// One number, or one a channel.
    pub at: Vec<f64>,
    /// The least value, and the largest of each number.
    pub low: f64,
    /// See `low`.
    pub high: Vec<f64>,
    /// The least amount that counts as much, for numbers that are judged relative to their own size; `None` for
    /// reflectances, of which 1 is much.
    pub scale: Option<f64>,
}

impl UnknownQuantity {
    /// The unit in which a number of this kind is uncertain at the start: 1 for a reflectance, its own size for
    /// factors, lengths and coefficients.
    pub fn unit(&self, at: f64) -> f64 {
        self.scale.map_or(1.0, |least| at.abs().max(least))
    }

    /// The largest standard error with which a number counts as determined. A reflectance lies between 0 and 1, and one
    /// of 0.02 ± 0.03 is known as dark. A number that nothing bounds from above, and that is no larger than its error,
    /// is not known: it is found to be small, which is said as a bound.
    pub fn limit(&self, at: f64) -> f64 {
        let most = UNKNOWN * self.unit(at);
        if self.scale.is_some() { most.min(at.abs()) } else { most }
    }

    /// Why a number with this standard error is not determined; `None` where it is. `due` says what makes an error as
    /// large as the number.
    pub fn open(&self, at: f64, error: f64, due: &str) -> Option<String> {
        if let Some(needed) = self.ended(at) {
            return Some(needed);
        }
        match error {
            error if error <= self.limit(at) => None,
            error if error <= UNKNOWN * self.unit(at) => Some(format!("at most {:.3e}", at + BELOW * error)),
            _ => Some(due.into()),
        }
    }

    /// What an area needs whose search ended at a limit; `None` elsewhere.
    pub fn ended(&self, at: f64) -> Option<String> {
        let (low, high) = (self.low, *self.high.first()?);
        let needed = match self.kind {
            UnknownKind::Area(_) if at >= high - LIMIT => "more",
            UnknownKind::Area(_) if at <= low + LIMIT => "fewer",
            _ => return None,
        };
        Some(format!(
            "found at {at}, where the search ends, expected an area between {low} and {high}; state a list of {needed} \
             discs"
        ))
    }

    /// The largest change of a number in one step.
    pub fn reach(&self, at: f64) -> f64 {
        if self.scale.is_some() { 0.6 * self.unit(at) } else { 0.3 }
    }

    /// Names of its numbers, where the channels have these names.
    pub fn names(&self, channels: &[String]) -> Vec<String> {
        let shared = matches!(self.kind, UnknownKind::Area(_));
        match self.at.len() == channels.len() && !shared {
            true => channels.iter().map(|c| format!("{}.{c}", self.name)).collect(),
            false => vec![self.name.clone()],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_larger_than_its_error_is_not_determined() {
        let of = |scale| UnknownQuantity {
            kind: UnknownKind::Sun,
            name: "a".into(),
            at: vec![0.0],
            low: 0.0,
            high: vec![f64::INFINITY],
            scale,
        };
        // A reflectance is bounded; a coefficient of which 0.5 is much is known as small, or not at all.
        let (reflectance, coefficient) = (of(None), of(Some(0.5)));
        let due = "it is";
        assert_eq!(reflectance.open(0.02, 0.03, due), None);
        assert!(reflectance.open(0.02, 0.26, due).is_some() && reflectance.open(0.9, f64::NAN, due).is_some());
        assert_eq!(coefficient.open(0.02, 0.015, due), None);
        assert_eq!(coefficient.open(0.02, 0.03, due).unwrap(), "at most 6.935e-2");
        assert_eq!(coefficient.open(0.0, 0.03, due).unwrap(), "at most 4.935e-2");
        assert_eq!(coefficient.open(2.0, 0.4, due), None);
        assert_eq!(coefficient.open(2.0, 0.6, due).unwrap(), due);
    }
}
