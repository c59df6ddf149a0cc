//! What a map of a leaf holds, and the names of its channels: `rho_d.R`, `normal.X`, `thickness.Y`. Fits, the truth of
//! synthetic captures and exports take the names of their channels only from this list.

use crate::image::ChannelMaps;
use crate::{Error, Result};
use std::path::Path;

/// A quantity that maps hold, texel by texel.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, strum::IntoStaticStr, strum::EnumString, strum::EnumIter,
)]
#[strum(serialize_all = "snake_case")]
pub enum Quantity {
    /// Diffuse reflectance.
    RhoD,
    /// Transmittance of a beam along the normal.
    RhoT,
    /// Transmittance as the camera sees it, with light that came sideways through the leaf.
    Transmittance,
    /// Specular reflectance.
    RhoS,
    /// Roughness of the gloss: the root mean square slope.
    M,
    /// Unit normal: x right, y up, z out of the side.
    Normal,
    /// Thickness h + δ (mm).
    Thickness,
    /// Diffuse reflectance over that of the leaf's mean slab at the texel's thickness.
    Gamma,
    /// Absorption (1/mm).
    SigmaA,
    /// Scattering (1/mm).
    SigmaS,
    /// Absorption of the mesophyll of a leaf made of layers (1/mm).
    Absorption,
    /// Chlorophyll of a leaf made of layers (µg/cm²).
    Chlorophyll,
    /// Carotenoids of a leaf made of layers (µg/cm²).
    Carotenoid,
    /// 1 where the texel was fitted, 0 beside the leaf, and a negative code for each named defect.
    Mask,
    /// χ² of the texel's readings over their degrees of freedom.
    #[strum(serialize = "reduced_chi2")]
    ReducedChi2,
    /// χ² of the texel's readings.
    Chi2,
    /// Degrees of freedom of the texel's readings.
    Freedom,
    /// Code of the reason why the texel's fit ended.
    Termination,
    /// 1 where the texel's gloss is not determined.
    Undetermined,
    /// Share of the light that a dome's picture shows as highlight.
    Highlight,
    /// Height over the plane of the photographs (mm).
    Height,
}

/// Names of colour channels.
pub const RGB: [&str; 3] = ["R", "G", "B"];
/// Names of the components of a direction.
pub const XYZ: [&str; 3] = ["X", "Y", "Z"];

impl Quantity {
    /// The name in parameters and pictures: `sigma_a`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Letters of its channels: R, G, B of a colour, X, Y, Z of a direction, Y of a single number.
    pub fn letters(self) -> &'static [&'static str] {
        use Quantity::{Absorption, Gamma, Normal, RhoD, RhoS, RhoT, SigmaA, SigmaS, Transmittance};
        match self {
            RhoD | RhoT | RhoS | Gamma | SigmaA | SigmaS | Transmittance | Absorption => &RGB,
            Normal => &XYZ,
            _ => &["Y"],
        }
    }

    /// Name of channel `c`: `sigma_a.G`.
    pub fn channel(self, c: usize) -> String {
        format!("{}.{}", self.name(), self.letters()[c])
    }

    /// Names of all its channels, in order.
    pub fn channels(self) -> impl Iterator<Item = String> {
        (0..self.letters().len()).map(move |c| self.channel(c))
    }
}

/// Splits a channel's name: `sigma_a.G` → (`sigma_a`, `G`), `thickness.Y` → (`thickness`, no letter), because the only
/// channel of a number has no name of its own.
pub fn split(channel: &str) -> (&str, &str) {
    match channel.rsplit_once('.') {
        Some((q, "Y")) if q != Quantity::Normal.name() => (q, ""),
        Some((q, c)) => (q, c),
        None => (channel, ""),
    }
}

/// Names of the channels of several quantities, in order.
pub fn channels(quantities: &[Quantity]) -> Vec<String> {
    quantities.iter().flat_map(|q| q.channels()).collect()
}

impl ChannelMaps {
    /// Channel `c` of a quantity, where there is one.
    pub fn plane(&self, quantity: Quantity, c: usize) -> Option<&[f32]> {
        self.get(&quantity.channel(c))
    }

    /// Channel `c` of a quantity, to be changed.
    pub fn plane_mut(&mut self, quantity: Quantity, c: usize) -> Option<&mut [f32]> {
        let name = quantity.channel(c);
        self.channels.iter_mut().find(|(n, _)| *n == name).map(|(_, plane)| &mut plane[..])
    }

    /// The three channels of a colour or a direction, where all are there.
    pub fn three(&self, quantity: Quantity) -> Option<[&[f32]; 3]> {
        Some([self.plane(quantity, 0)?, self.plane(quantity, 1)?, self.plane(quantity, 2)?])
    }

    /// The only channel of a quantity that is a single number, where there is one.
    pub fn scalar(&self, quantity: Quantity) -> Option<&[f32]> {
        self.plane(quantity, 0)
    }

    /// As [`ChannelMaps::three`].
    ///
    /// # Errors
    /// [`Error::Input`] that names the file, the channel that is missing and those that are there.
    pub fn require_three(&self, path: &Path, quantity: Quantity) -> Result<[&[f32]; 3]> {
        let plane = |c| self.require(path, &quantity.channel(c));
        Ok([plane(0)?, plane(1)?, plane(2)?])
    }

    /// As [`ChannelMaps::scalar`].
    ///
    /// # Errors
    /// As [`ChannelMaps::require_three`].
    pub fn require_scalar(&self, path: &Path, quantity: Quantity) -> Result<&[f32]> {
        self.require(path, &quantity.channel(0))
    }

    /// The channels of several quantities, one after another, to be changed.
    ///
    /// # Errors
    /// As [`ChannelMaps::require_three`].
    pub fn require_planes(&self, path: &Path, quantities: &[Quantity]) -> Result<Vec<Vec<f32>>> {
        channels(quantities).iter().map(|name| self.require(path, name).map(<[f32]>::to_vec)).collect()
    }

    /// Adds channel `c` of a quantity.
    pub fn add(&mut self, quantity: Quantity, c: usize, samples: Vec<f32>) {
        self.push(quantity.channel(c), samples);
    }

    /// Puts `samples` in the place of channel `c` of a quantity; adds it where it was not there.
    pub fn replace(&mut self, quantity: Quantity, c: usize, samples: Vec<f32>) {
        match self.plane_mut(quantity, c) {
            Some(plane) => plane.copy_from_slice(&samples),
            None => self.add(quantity, c, samples),
        }
    }

    /// Names of the channels it holds, separated by commas.
    pub(crate) fn held(&self) -> String {
        self.channels.iter().map(|(n, _)| n.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// Refuses maps of another size than `width` × `height`.
    ///
    /// # Errors
    /// [`Error::Input`] that names the file and both sizes.
    pub fn require_size(&self, path: &Path, width: usize, height: usize) -> Result<()> {
        if (self.width, self.height) == (width, height) {
            return Ok(());
        }
        let found = format!("found {}x{} texels", self.width, self.height);
        Err(Error::input(path, format!("{found}, expected {width}x{height} as of the leaf's other maps")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use strum::IntoEnumIterator;

    #[test]
    fn a_quantity_is_told_by_its_name_and_a_channel_by_its_letter() {
        assert_eq!(channels(&[Quantity::SigmaA, Quantity::M]), ["sigma_a.R", "sigma_a.G", "sigma_a.B", "m.Y"]);
        assert_eq!(Quantity::Normal.channel(2), "normal.Z");
        let parts = ["sigma_a.G", "thickness.Y", "normal.Y", "odd"].map(split);
        assert_eq!(parts, [("sigma_a", "G"), ("thickness", ""), ("normal", "Y"), ("odd", "")]);
        assert_eq!(Quantity::ReducedChi2.channel(0), "reduced_chi2.Y");
        assert!(Quantity::iter().all(|q| q.name().parse() == Ok(q)));
        let mut maps = ChannelMaps::new(1, 1);
        for c in 0..3 {
            maps.add(Quantity::RhoD, c, vec![c as f32]);
        }
        maps.replace(Quantity::RhoD, 1, vec![7.0]);
        assert_eq!(maps.three(Quantity::RhoD), Some([&[0.0][..], &[7.0], &[2.0]]));
        let missing = maps.require_scalar(Path::new("a.exr"), Quantity::Thickness).unwrap_err().to_string();
        assert!(missing.contains("thickness.Y") && missing.contains("rho_d.R, rho_d.G, rho_d.B"), "{missing}");
    }
}
