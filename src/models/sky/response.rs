//! Spectral responses that are published, by name: what three bands see of light that a surface sends back or lets
//! through, over wavelength.
//!
//! The light is CIE standard illuminant D65 (CIE 15, 10 nm steps). A band's value is the integral of spectrum, light
//! and response over that of light and response, so a perfect white is the response's white. It is a sum of readings
//! with weights that do not depend on them: readings count as joined by straight lines.

use crate::colour::rgb_from_xyz;
use crate::sun::matching;

/// A response by its name.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::Display,
    strum::EnumString,
    strum::EnumIter,
    strum::EnumMessage,
    strum::IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
pub enum ObserverResponse {
    /// Linear sRGB (IEC 61966-2-1), unclamped; white is 1, 1, 1
    Srgb,
    /// X, Y, Z of the CIE 1931 standard observer; Y of white is 1
    #[strum(to_string = "cie-1931")]
    Cie1931,
}

/// CIE D65 from 380 to 780 nm, a value every 10 nm.
const D65: [f64; 41] = [
    49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811,
    109.354, 107.802, 104.790, 107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856, 90.0062, 89.5991,
    87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.3490, 61.6040, 69.8856,
    75.0870, 63.5927, 46.4182, 66.8054, 63.3828,
];
/// Its first and last wavelength (nm).
const RANGE: [f64; 2] = [380.0, 780.0];
/// Share of a band that readings may leave out; there the nearest reading counts.
const LEFT_OUT: f64 = 0.01;
/// Widest gap between neighbouring readings where a band sees (nm).
const WIDEST: f64 = 20.0;
/// Between these wavelengths lies nearly all that a band sees.
const SEEN: [f64; 2] = [400.0, 700.0];

/// The light of D65.
fn d65(nm: f64) -> f64 {
    let x = ((nm - RANGE[0]) / 10.0).clamp(0.0, (D65.len() - 1) as f64);
    let i = (x as usize).min(D65.len() - 2);
    D65[i] + (x - i as f64) * (D65[i + 1] - D65[i])
}

impl ObserverResponse {
    /// The letters of its bands.
    pub fn letters(self) -> [&'static str; 3] {
        match self {
            ObserverResponse::Srgb => ["r", "g", "b"],
            ObserverResponse::Cie1931 => ["x", "y", "z"],
        }
    }

    /// The three weights of each reading at these wavelengths (nm), which ascend.
    ///
    /// # Errors
    /// A sentence where the readings do not cover what the bands see, or lie too far apart.
    pub fn weights(self, wavelengths: &[f64]) -> std::result::Result<Vec<[f64; 3]>, String> {
        let n = wavelengths.len();
        let (Some(first), Some(last)) = (wavelengths.first(), wavelengths.last()) else {
            return Err("no reading".into());
        };
        let seen = |pair: &&[f64]| pair[1] > SEEN[0] && pair[0] < SEEN[1];
        if let Some(pair) = wavelengths.windows(2).filter(seen).find(|pair| pair[1] - pair[0] > WIDEST) {
            let (a, b) = (pair[0], pair[1]);
            return Err(format!("no reading between {a} and {b} nm; expected one every {WIDEST} nm"));
        }
        let (mut weights, mut white) = (vec![[0.0; 3]; n], [0.0; 3]);
        let (mut beyond, mut all) = ([0.0; 3], [0.0; 3]);
        for step in 0..=(RANGE[1] - RANGE[0]) as usize {
            let nm = RANGE[0] + step as f64;
            let xyz = matching(nm).map(|v| v * d65(nm));
            let at = wavelengths.partition_point(|w| *w <= nm).clamp(1, n.max(2) - 1);
            let (low, high) = (at - 1, at.min(n - 1));
            let span = wavelengths[high] - wavelengths[low];
            let t = if span > 0.0 { ((nm - wavelengths[low]) / span).clamp(0.0, 1.0) } else { 0.0 };
            for c in 0..3 {
                weights[low][c] += (1.0 - t) * xyz[c];
                weights[high][c] += t * xyz[c];
                white[c] += xyz[c];
                all[c] += xyz[c].abs();
                beyond[c] += if nm < *first || nm > *last { xyz[c].abs() } else { 0.0 };
            }
        }
        if (0..3).any(|c| beyond[c] > LEFT_OUT * all[c]) {
            let [low, high] = SEEN;
            return Err(format!("readings from {first} to {last} nm; expected {low} to {high} nm at least"));
        }
        let [_, y, _] = white;
        let scaled = weights.into_iter().map(|w| w.map(|v| v / y));
        Ok(match self {
            ObserverResponse::Cie1931 => scaled.collect(),
            ObserverResponse::Srgb => {
                // The white of the closed forms is that of sRGB to a few thousandths; it becomes 1, 1, 1.
                let by = rgb_from_xyz(white.map(|v| v / y));
                scaled.map(rgb_from_xyz).map(|w| [0, 1, 2].map(|c| w[c] / by[c])).collect()
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(response: ObserverResponse, wavelengths: &[f64], of: impl Fn(f64) -> f64) -> [f64; 3] {
        let weights = response.weights(wavelengths).unwrap();
        [0, 1, 2].map(|c| weights.iter().zip(wavelengths).map(|(w, nm)| w[c] * of(*nm)).sum())
    }

    fn every(step: usize) -> Vec<f64> {
        (380..=780).step_by(step).map(|nm| nm as f64).collect()
    }

    /// Values of the CIE's own tables: of the colour matching functions, and of the chromaticity of D65.
    #[test]
    fn observer_and_light_are_the_ones_that_are_published() {
        for (nm, want) in [
            (450.0, [0.3362, 0.0380, 1.7721]),
            (500.0, [0.0049, 0.3230, 0.2720]),
            (555.0, [0.5121, 1.0000, 0.0057]),
            (600.0, [1.0622, 0.6310, 0.0008]),
            (650.0, [0.2835, 0.1070, 0.0000]),
        ] {
            let found = matching(nm);
            assert!((0..3).all(|c| (found[c] - want[c]).abs() < 0.025), "{nm}: {found:?} {want:?}");
        }
        let [x, y, z] = seen(ObserverResponse::Cie1931, &every(5), |_| 1.0);
        assert!((y - 1.0).abs() < 1e-12);
        let sum = x + y + z;
        assert!((x / sum - 0.31272).abs() < 1.5e-3 && (y / sum - 0.32903).abs() < 1.5e-3, "{} {}", x / sum, y / sum);
    }

    /// White is white; readings every 20 nm do as well as every nanometre for a smooth spectrum; long wavelengths alone
    /// are red, and a share of white is that share.
    #[test]
    fn colours_are_those_of_the_spectrum() {
        let white = seen(ObserverResponse::Srgb, &every(10), |_| 0.37);
        assert!(white.iter().all(|v| (v - 0.37).abs() < 1e-12), "{white:?}");
        let leaf =
            |nm: f64| 0.05 + 0.1 * (-((nm - 550.0) / 40.0).powi(2)).exp() + 0.4 / (1.0 + (-(nm - 700.0) / 8.0).exp());
        let (fine, coarse) =
            (seen(ObserverResponse::Srgb, &every(1), leaf), seen(ObserverResponse::Srgb, &every(20), leaf));
        assert!(fine[1] > fine[0] && fine[0] > fine[2], "{fine:?}");
        assert!((0..3).all(|c| (fine[c] - coarse[c]).abs() < 2e-3), "{fine:?} {coarse:?}");
        let red = seen(ObserverResponse::Srgb, &every(1), |nm| if nm > 620.0 { 1.0 } else { 0.0 });
        assert!(red[0] > 0.3 && red[1].abs() < 0.05 && red[2].abs() < 0.05, "{red:?}");
    }

    #[test]
    fn readings_that_do_not_cover_the_bands_are_refused() {
        let said = |list: &[f64]| ObserverResponse::Srgb.weights(list).unwrap_err();
        assert!(said(&[]).contains("no reading"));
        assert!(said(&[450.0, 550.0, 650.0]).contains("between 450 and 550 nm"));
        let narrow: Vec<f64> = (450..=650).step_by(10).map(f64::from).collect();
        assert!(said(&narrow).contains("from 450 to 650 nm"));
        let enough: Vec<f64> = (400..=700).step_by(10).map(f64::from).collect();
        assert!(ObserverResponse::Srgb.weights(&enough).is_ok());
    }
}
