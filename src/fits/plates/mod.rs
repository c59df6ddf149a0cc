//! Leaves as they are: contents from measured reflectance and transmittance, by a stack of plates whose specific
//! absorptions and indices were themselves fitted to leaves with measured contents.
//!
//! [`training::train`] makes [`PlateCoefficients`] of such a table, and [`table`] writes and reads them.
//! [`PlateFitModel`] fits a leaf with seven numbers: five contents, the number of plates and the surface's gloss. What
//! the model leaves of a leaf is structured over wavelength. So the errors are those of [`misfit::PlateMisfit`], which
//! was estimated from leaves of species that the coefficients had not seen.

mod answer;
mod banded;
pub mod calibration;
mod joint_step;
pub mod leaf;
pub mod misfit;
pub mod reading;
mod spectral_step;
pub mod table;
#[cfg(test)]
mod tests;
pub mod training;

pub use answer::PlateFitModel;

use misfit::PlateMisfit;

/// The name of the variant, as the file of coefficients states it.
pub const VARIANT: &str = "plates";
/// The free numbers of a leaf: how many.
pub const FREE: usize = 7;
/// The substances, in the order of all arrays here. Brown pigments are what nobody measures: whatever else absorbs.
pub const SUBSTANCES: [&str; 5] = ["chlorophyll", "carotenoid", "water", "dry", "brown"];
/// What is measured of a leaf and answered, with its unit.
pub const CONTENTS: [&str; 4] = ["chlorophyll_ug_cm2", "carotenoid_ug_cm2", "water_g_cm2", "dry_g_cm2"];
/// The contents of a usual leaf, in the units of [`CONTENTS`]. Inside, contents are in these units.
pub const USUAL: [f64; 5] = [50.0, 12.0, 0.01, 0.005, 1.0];
/// The wavelengths (nm) at which each of the [`SUBSTANCES`] may absorb. Pigments have bands in the visible, and below
/// 880 nm the water of a leaf absorbs less than can be measured. Without these ends the substances of a table of leaves
/// could stand for each other, because leaves with more of one have more of the other.
pub const REACH: [[f64; 2]; 5] = [[0.0, 780.0], [0.0, 580.0], [880.0, f64::MAX], [800.0, f64::MAX], [0.0, 1400.0]];

/// Where the two numbers after the contents stand among the free ones.
pub const PLATES: usize = 5;
/// The gloss of the surface.
pub const GLOSS: usize = 6;

/// The least and the most of each free number: contents in [`USUAL`] units, plates beyond the first one, gloss.
pub const LOWER: [f64; FREE] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0];
/// See [`LOWER`].
pub const UPPER: [f64; FREE] = [8.0, 12.0, 50.0, 16.0, 50.0, 9.0, 6.0];

/// The free numbers of a leaf that is lit from both sides: the same, the gloss of its lower side, and how much more of
/// what it absorbs lies in its upper half.
pub const SIDED: usize = FREE + 2;
/// Where the two further numbers stand.
pub const GLOSS_BELOW: usize = 7;
/// See [`GLOSS_BELOW`]; 0 is as much above as below, 1 is all above.
pub const LEAN: usize = 8;
/// The most of a lean.
pub const MOST_LEAN: f64 = 0.95;

/// The constants of one wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlatePoint {
    /// What one [`USUAL`] content of each substance absorbs.
    pub specific: [f64; 5],
    /// Refractive index of a plate.
    pub index: f64,
    /// What the plates beyond the first one count at this wavelength.
    pub growth: f64,
}

impl PlatePoint {
    /// The numbers in one array: specific absorptions, index, growth.
    pub fn all(&self) -> [f64; FREE] {
        let [a, b, c, d, e] = self.specific;
        [a, b, c, d, e, self.index, self.growth]
    }

    /// The inverse of [`PlatePoint::all`].
    pub fn of([a, b, c, d, e, index, growth]: [f64; FREE]) -> PlatePoint {
        PlatePoint { specific: [a, b, c, d, e], index, growth }
    }
}

/// What the leaves were like that the coefficients were made from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlatePopulation {
    /// Mean of each free number.
    pub mean: [f64; FREE],
    /// Its standard deviation.
    pub spread: [f64; FREE],
    /// Carotenoid per chlorophyll, and the standard deviation from that (µg/cm²).
    pub ratio: [f64; 2],
    /// What the model is off by in each of the [`CONTENTS`] of unseen species, as a share, beyond what the misfit says.
    pub off: [f64; 4],
    /// Median over leaves of unseen species of the root mean square of measured less computed R and T.
    pub rms: f64,
    /// How many leaves there were, and of how many species.
    pub counts: [usize; 2],
}

/// All that was learnt from a table of leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateCoefficients {
    /// Wavelengths (nm), ascending.
    pub wavelengths: Vec<f64>,
    /// The constants at each.
    pub points: Vec<PlatePoint>,
    /// Their standard errors, by leaving species out.
    pub errors: Vec<[f64; FREE]>,
    /// The leaves.
    pub population: PlatePopulation,
    /// What the model leaves unexplained.
    pub misfit: PlateMisfit,
}

impl PlateCoefficients {
    /// First and last wavelength (nm).
    pub fn range(&self) -> [f64; 2] {
        [self.wavelengths[0], self.wavelengths[self.wavelengths.len() - 1]]
    }

    /// Where a wavelength within the range lies: the point below it, and the share of the way to the next one.
    pub fn place(&self, wavelength: f64) -> (usize, f64) {
        let last = self.wavelengths.len() - 1;
        let above = self.wavelengths.partition_point(|w| *w <= wavelength).clamp(1, last.max(1)).min(last);
        let below = above.saturating_sub(1);
        let step = self.wavelengths[above] - self.wavelengths[below];
        (below, if step > 0.0 { (wavelength - self.wavelengths[below]) / step } else { 0.0 })
    }

    /// The constants at a wavelength within the range, linear between points.
    pub fn at(&self, wavelength: f64) -> PlatePoint {
        let (k, t) = self.place(wavelength);
        let (a, b) = (self.points[k].all(), self.points[(k + 1).min(self.points.len() - 1)].all());
        PlatePoint::of(std::array::from_fn(|j| a[j] + t * (b[j] - a[j])))
    }
}
