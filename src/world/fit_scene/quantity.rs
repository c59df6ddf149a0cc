//! The kinds of unknown numbers, and the scales on which they are judged.

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

    /// The largest change of a number in one step.
    pub fn reach(&self, at: f64) -> f64 {
        if self.scale.is_some() { 0.6 * self.unit(at) } else { 0.3 }
    }

    /// Names of its numbers, where the channels have these names.
    pub fn names(&self, channels: &[String]) -> Vec<String> {
        match self.at.len() == channels.len() {
            true => channels.iter().map(|c| format!("{}.{c}", self.name)).collect(),
            false => vec![self.name.clone()],
        }
    }
}
