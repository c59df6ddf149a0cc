//! What readings of a quantity can be, so that a number outside this range is recognised as one that stands for a
//! missing reading.

use super::cell::Possible;
use std::collections::HashMap;

/// Some columns of one quantity, and the range in which its readings are.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PhysicalRange {
    /// Names of the columns; those that the table lacks are passed over.
    pub columns: Vec<String>,
    /// The least and the largest reading.
    pub range: [f64; 2],
}

impl PhysicalRange {
    /// Columns of shares of light, as fractions or in per cent. Noise may make them a little less than 0.
    pub fn shares(columns: Vec<String>) -> PhysicalRange {
        PhysicalRange { columns, range: [-0.9, 200.0] }
    }

    /// Columns of what cannot be negative: standard errors, thicknesses, wavelengths.
    pub fn not_negative(columns: Vec<String>) -> PhysicalRange {
        PhysicalRange { columns, range: [0.0, f64::INFINITY] }
    }

    /// Columns of angles (degrees).
    pub fn degrees(columns: Vec<String>) -> PhysicalRange {
        PhysicalRange { columns, range: [-360.0, 720.0] }
    }
}

/// A value is taken for one that stands for a missing reading where it stands in this many cells.
const OFTEN: usize = 3;

/// The one value outside `range` that is repeated among readings inside it. Where there are different values outside,
/// none of them is a mark.
pub(super) fn repeated(range: [f64; 2], values: impl Iterator<Item = f64>) -> Option<f64> {
    let possible = Possible::within(range);
    let (mut inside, mut outside) = (0, HashMap::new());
    for v in values.filter(|v| v.is_finite() && !possible.is_missing(*v)) {
        if possible.holds(v) {
            inside += 1;
        } else {
            *outside.entry(v.to_bits()).or_insert(0) += 1;
        }
    }
    match (outside.len(), outside.into_iter().next()) {
        (1, Some((bits, count))) if count >= OFTEN && inside > 0 => Some(f64::from_bits(bits)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_value_that_is_repeated_outside_the_range_is_a_mark() {
        let mark = |values: &[f64]| repeated([0.0, 100.0], values.iter().copied());
        assert_eq!(mark(&[0.1, -1.0, 0.2, -1.0, -1.0]), Some(-1.0));
        assert_eq!(mark(&[0.1, -1.0, -999.0, -1.0, -1.0]), Some(-1.0), "−999 is known without it");
        for none in [&[0.1, -1.0, -1.0][..], &[0.1, -1.0, -1.0, -1.0, -2.0], &[-1.0; 5], &[0.1, 0.2, 0.3, 0.3, 0.3]] {
            assert_eq!(mark(none), None, "{none:?}");
        }
    }
}
