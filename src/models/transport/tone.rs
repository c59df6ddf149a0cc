//! From radiance to the picture: exposure · L, Reinhard's x/(1 + x) for each channel, sRGB encoding (IEC 61966-2-1), 8
//! bits. Pictures for people to look at may have a film's curve instead of Reinhard's.

/// How radiance is pressed into what a screen can show.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    strum::Display,
    strum::EnumString,
    strum::EnumIter,
    strum::IntoStaticStr,
    strum::EnumMessage,
)]
#[strum(serialize_all = "kebab-case")]
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
pub(crate) fn display_slope(radiance: f64, exposure: f64) -> f64 {
    let x = (exposure * radiance).max(0.0);
    let mapped = x / (1.0 + x);
    let encode = if mapped <= 0.003_130_8 { 12.92 } else { 1.055 / 2.4 * mapped.powf(1.0 / 2.4 - 1.0) };
    encode * exposure / ((1.0 + x) * (1.0 + x))
}

/// From a display value to 8 bits, rounded to nearest.
pub(crate) fn quantise(display: f64) -> u8 {
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
