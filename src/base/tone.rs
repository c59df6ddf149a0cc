//! From radiance to the picture: exposure · L, Reinhard's x/(1 + x) for each channel, sRGB encoding (IEC 61966-2-1), 8
//! bits. Pictures for people to look at may have a film's curve instead of Reinhard's, and may show the bands of a leaf
//! as colours.

use serde::{Deserialize, Serialize};

/// How a picture is shown. Radiance is the same whatever it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PictureDisplay {
    /// The curve from radiance to what a screen can show.
    pub curve: ToneCurve,
    /// What red, green and blue of the surfaces are.
    pub channels: PictureChannels,
}

/// What the three channels of a scene's surfaces are.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    Serialize,
    Deserialize,
    strum::Display,
    strum::EnumString,
    strum::EnumIter,
    strum::IntoStaticStr,
    strum::EnumMessage,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "kebab-case")]
pub enum PictureChannels {
    /// Linear sRGB: a picture shows them as they are.
    #[default]
    Srgb,
    /// The bands of 650, 550 and 450 nm, as leaves are measured: a picture shows [`SRGB_OF_BANDS`] of them.
    Bands,
}

/// Linear sRGB of a leaf under daylight (CIE D65, 2° observer) from its bands of 650, 550 and 450 nm. Rows are red,
/// green and blue of sRGB, and each sums to 1, so that grey stays grey.
///
/// The numbers are the least squares over made-up leaves; `tests/models/channels` finds them again, and judges them by
/// measured leaves (`docs/evidence/colours.md`).
pub const SRGB_OF_BANDS: [[f64; 3]; 3] =
    [[1.1145, 0.2050, -0.3195], [0.1544, 0.8087, 0.0369], [0.0502, -0.0839, 1.0337]];

impl PictureChannels {
    /// Rows of the matrix from the channels of a surface to linear sRGB.
    pub fn to_srgb(self) -> [[f64; 3]; 3] {
        match self {
            PictureChannels::Srgb => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            PictureChannels::Bands => SRGB_OF_BANDS,
        }
    }
}

impl PictureDisplay {
    /// From radiance to display values in [0, 1]. `surface` is the share of the pixel that surfaces cover; the rest is
    /// sky or background, which is linear sRGB whatever the channels of surfaces are.
    pub fn display(self, radiance: [f64; 3], surface: f64, exposure: f64) -> [f64; 3] {
        let shown = match self.channels {
            PictureChannels::Srgb => radiance,
            PictureChannels::Bands => {
                let rows = self.channels.to_srgb();
                std::array::from_fn(|c| {
                    let mapped: f64 = (0..3).map(|k| rows[c][k] * radiance[k]).sum();
                    radiance[c] + surface * (mapped - radiance[c])
                })
            }
        };
        shown.map(|v| self.curve.display(v, exposure))
    }
}

/// How radiance is pressed into what a screen can show.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    Serialize,
    Deserialize,
    strum::Display,
    strum::EnumString,
    strum::EnumIter,
    strum::IntoStaticStr,
    strum::EnumMessage,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "kebab-case")]
pub enum ToneCurve {
    /// x/(1 + x) a channel: what both renderers draw, and what checks compare.
    #[default]
    Reinhard,
    /// A film's: dark below, steep in the middle, with a long shoulder (Narkowicz 2015, "ACES filmic tone mapping
    /// curve", with its factor of .6), a channel each.
    Film,
}

impl ToneCurve {
    /// From radiance to a display value in [0, 1]. Negative radiance and NaN are black.
    pub fn display(self, radiance: f64, exposure: f64) -> f64 {
        match self {
            ToneCurve::Reinhard => display(radiance, exposure),
            ToneCurve::Film => {
                let x = 0.6 * exposure * radiance;
                if x.is_nan() || x <= 0.0 {
                    return 0.0;
                }
                // Beyond this value the curve is white.
                let x = x.min(1e6);
                encode((x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).min(1.0))
            }
        }
    }
}

/// sRGB's encoding of a linear value in [0, 1].
fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// From radiance to a display value in [0, 1]. Negative radiance and NaN are black.
pub fn display(radiance: f64, exposure: f64) -> f64 {
    let x = exposure * radiance;
    if x.is_nan() || x <= 0.0 {
        return 0.0;
    }
    let mapped = if x.is_infinite() { 1.0 } else { x / (1.0 + x) };
    encode(mapped)
}

/// d(display)/d(radiance), which converts a standard error of the radiance into one of the picture.
pub fn display_slope(radiance: f64, exposure: f64) -> f64 {
    let x = (exposure * radiance).max(0.0);
    let mapped = x / (1.0 + x);
    let encode = if mapped <= 0.003_130_8 { 12.92 } else { 1.055 / 2.4 * mapped.powf(1.0 / 2.4 - 1.0) };
    encode * exposure / ((1.0 + x) * (1.0 + x))
}

/// From a display value to 8 bits, rounded to nearest.
pub fn quantise(display: f64) -> u8 {
    (display.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values_and_slope() {
        assert_eq!(display(-1.0, 1.0), 0.0);
        assert_eq!(display(f64::NAN, 1.0), 0.0);
        assert!((display(f64::INFINITY, 1.0) - 1.0).abs() < 1e-15);
        // x/(1+x) = .214 041 140 is mid-grey .5 in sRGB (the inverse of IEC 61966-2-1 at .5).
        let linear = ((0.5f64 + 0.055) / 1.055).powf(2.4);
        assert!((display(linear / (1.0 - linear), 1.0) - 0.5).abs() < 1e-12);
        assert_eq!(quantise(0.5), 128);
        for x in [1e-4, 0.01, 0.3, 2.0] {
            let h = 1e-6 * x;
            let slope = (display(x + h, 1.7) - display(x - h, 1.7)) / (2.0 * h);
            assert!((slope / display_slope(x, 1.7) - 1.0).abs() < 1e-6, "{x}");
        }
    }

    /// Grey stays grey, what surfaces do not cover stays as it is, and the map of a mixture is the mixture of the maps.
    #[test]
    fn bands_are_mapped_where_surfaces_are() {
        assert!(SRGB_OF_BANDS.iter().all(|row| (row.iter().sum::<f64>() - 1.0).abs() < 1e-12));
        let bands = PictureDisplay { channels: PictureChannels::Bands, ..PictureDisplay::default() };
        let plain = PictureDisplay::default();
        let leaf = [0.05, 0.12, 0.04];
        let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close(bands.display([0.3; 3], 1.0, 2.0), plain.display([0.3; 3], 1.0, 2.0)));
        assert!(close(bands.display(leaf, 0.0, 2.0), plain.display(leaf, 0.0, 2.0)));
        assert_eq!(plain.display(leaf, 1.0, 2.0), leaf.map(|v| display(v, 2.0)));
        let mapped = SRGB_OF_BANDS.map(|row| (0..3).map(|k| row[k] * leaf[k]).sum::<f64>());
        assert!(close(bands.display(leaf, 1.0, 2.0), plain.display(mapped, 1.0, 2.0)));
        // A leaf is less emerald: red comes nearer to green.
        assert!(mapped[0] > leaf[0] && mapped[1] < leaf[1]);
        let half = [0, 1, 2].map(|c| 0.5 * (leaf[c] + mapped[c]));
        assert!(close(bands.display(leaf, 0.5, 2.0), plain.display(half, 1.0, 2.0)));
    }

    /// The curve rises from black to white without a decrease. Mid-grey stays a middle tone, and values that Reinhard's
    /// curve keeps below white are white.
    #[test]
    fn a_films_curve_rises_from_black_to_white() {
        let values: Vec<f64> = (0..2000).map(|k| ToneCurve::Film.display(1.01f64.powi(k - 1000), 1.0)).collect();
        assert!(values.windows(2).all(|w| w[0] <= w[1]) && values[0] < 1e-3);
        assert!((values[1999] - 1.0).abs() < 1e-12);
        assert_eq!(ToneCurve::Film.display(f64::NAN, 1.0), 0.0);
        assert!((ToneCurve::Film.display(f64::INFINITY, 1.0) - 1.0).abs() < 1e-12);
        let grey = ToneCurve::Film.display(0.18, 1.0);
        assert!((0.35..0.5).contains(&grey), "{grey}");
        assert_eq!(ToneCurve::Film.display(0.09, 2.0), grey);
    }
}
