//! Whether shares of light are written in per cent.

/// What is said of a number in per cent, after its name and value.
pub const SENTENCE: &str = "looks like per cent; add --percent";

/// No share of a leaf's light is larger, as a fraction: 1 for a sum of all directions, and a little more with noise.
const LARGEST: f64 = 1.5;
/// No share is larger than this in per cent.
const LARGEST_PERCENT: f64 = 150.0;

/// Whether readings are plainly in per cent: at least half of them are larger than 1.5, which no leaf's reflectance and
/// transmittance are, and none is above 150. A single wrong number makes no table one of per cent.
pub fn looks(values: &[f64]) -> bool {
    let above = values.iter().filter(|v| **v > LARGEST).count();
    above > 0 && 2 * above >= values.len() && values.iter().all(|v| *v <= LARGEST_PERCENT)
}

/// Whether a single number can only be in per cent.
pub fn must_be(value: f64) -> bool {
    value > LARGEST && value <= LARGEST_PERCENT
}

/// Whether readings are plainly fractions of 1: there are some, and none is above 1.
pub fn are_fractions(values: &[f64]) -> bool {
    !values.is_empty() && values.iter().all(|v| *v <= 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn per_cent_is_told_by_many_numbers() {
        // Dark leaves transmit less than 1.5 %, but reflect more.
        assert!(looks(&[5.3, 0.4, 9.1, 1.2, 4.0, 0.1]));
        assert!(looks(&[45.2]));
        assert!(!looks(&[0.05, 0.07, 0.4, 0.5, 5.3]) && !looks(&[0.1, 0.15, 11.4, 0.15]), "one wrong number");
        assert!(!looks(&[0.05, 0.5]) && !looks(&[]) && !looks(&[500.0, 600.0]));
        assert!(are_fractions(&[0.05, 0.5]) && !are_fractions(&[]) && !are_fractions(&[0.5, 5.0]));
    }
}
