//! The absorption of a mesophyll, computed from its contents: a = Σ ξ C over thickness, where ξ is the specific
//! absorption of each substance and C its content per leaf area.

/// The substances, in the order of all arrays here.
pub const SUBSTANCES: [&str; 5] = ["chlorophyll", "carotenoid", "protein", "cellulose_lignin", "water"];

/// What a leaf contains per area: µg/cm² of the first four [`SUBSTANCES`], g/cm² of water.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafContents {
    /// In the order of [`SUBSTANCES`].
    pub per_area: [f64; 5],
    /// Factor on the chlorophyll; veins have a tenth (B1).
    pub scale: f64,
}

/// Optical constants at one wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpticalConstants {
    /// Specific absorption in the order of [`SUBSTANCES`]: cm²/g, water in 1/cm.
    pub specific: [f64; 5],
    /// Refractive indices of cuticle, mesophyll and antidermal wall.
    pub indices: [f64; 3],
}

impl OpticalConstants {
    /// How much one unit of each content adds to absorption times thickness. A column of water of 1 g/cm² is 1 cm long.
    pub fn per_content(&self) -> [f64; 5] {
        let [a, b, c, d, water] = self.specific;
        [a * 1e-6, b * 1e-6, c * 1e-6, d * 1e-6, water]
    }

    /// Absorption times thickness of a crossing.
    pub fn depth(&self, contents: &LeafContents) -> f64 {
        let per = self.per_content();
        let [chlorophyll, others @ ..] = contents.per_area;
        let rest: f64 = per[1..].iter().zip(others).map(|(x, c)| x * c).sum();
        per[0] * chlorophyll * contents.scale + rest
    }
}

/// Optical constants over wavelength.
#[derive(Debug, Clone, PartialEq)]
pub struct OpticalSpectrum {
    /// Wavelengths (nm), ascending, with the constants at each; at least one.
    pub points: Vec<(f64, OpticalConstants)>,
}

impl OpticalSpectrum {
    /// First and last wavelength (nm).
    pub fn range(&self) -> [f64; 2] {
        [self.points.first(), self.points.last()].map(|p| p.map_or(f64::NAN, |p| p.0))
    }

    /// The constants at a wavelength (nm), linear between points; `None` outside the table.
    pub fn at(&self, wavelength: f64) -> Option<OpticalConstants> {
        let [first, last] = self.range();
        if !(first <= wavelength && wavelength <= last) {
            return None;
        }
        let k = self.points.partition_point(|p| p.0 < wavelength);
        let (high, b) = self.points[k];
        if high == wavelength {
            return Some(b);
        }
        let (low, a) = self.points[k - 1];
        let t = (wavelength - low) / (high - low);
        let between = |x: f64, y: f64| x + t * (y - x);
        Some(OpticalConstants {
            specific: std::array::from_fn(|k| between(a.specific[k], b.specific[k])),
            indices: std::array::from_fn(|k| between(a.indices[k], b.indices[k])),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_are_linear_between_points_and_end_with_the_table() {
        let of = |x: f64| OpticalConstants { specific: [x; 5], indices: [1.0 + 0.1 * x; 3] };
        let spectrum = OpticalSpectrum { points: vec![(400.0, of(1.0)), (405.0, of(2.0)), (410.0, of(4.0))] };
        assert_eq!(spectrum.at(405.0), Some(of(2.0)));
        let middle = spectrum.at(409.0).unwrap();
        assert!((middle.specific[3] - 3.6).abs() < 1e-12 && (middle.indices[1] - 1.36).abs() < 1e-12);
        assert_eq!([spectrum.at(399.9), spectrum.at(410.1), spectrum.at(f64::NAN)], [None; 3]);
        // 40 µg/cm² of 1e4 cm²/g, and 0.01 g/cm² of water of 2/cm
        let constants = OpticalConstants { specific: [1e4, 0.0, 0.0, 0.0, 2.0], indices: [1.5; 3] };
        let contents = LeafContents { per_area: [40.0, 1.0, 1.0, 1.0, 0.01], scale: 0.1 };
        assert!((constants.depth(&contents) - 0.06).abs() < 1e-15);
    }
}
