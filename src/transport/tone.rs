//! From radiance to the picture: exposure · L, Reinhard x/(1 + x) a channel, sRGB encoding (IEC 61966-2-1), 8 bits.

/// Radiance → display value in [0, 1]; negative radiance is black, NaN too.
pub fn display(radiance: f64, exposure: f64) -> f64 {
    let x = exposure * radiance;
    if x.is_nan() || x <= 0.0 {
        return 0.0;
    }
    let mapped = if x.is_infinite() { 1.0 } else { x / (1.0 + x) };
    if mapped <= 0.003_130_8 { 12.92 * mapped } else { 1.055 * mapped.powf(1.0 / 2.4) - 0.055 }
}

/// d(display)/d(radiance), for turning a standard error in radiance into one in the picture.
pub(crate) fn display_slope(radiance: f64, exposure: f64) -> f64 {
    let x = (exposure * radiance).max(0.0);
    let mapped = x / (1.0 + x);
    let encode = if mapped <= 0.003_130_8 { 12.92 } else { 1.055 / 2.4 * mapped.powf(1.0 / 2.4 - 1.0) };
    encode * exposure / ((1.0 + x) * (1.0 + x))
}

/// Display value → 8 bits, rounded to nearest.
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
        // x/(1+x) = .214 041 140 is sRGB mid-grey .5 (IEC 61966-2-1 inverted at .5)
        let linear = ((0.5f64 + 0.055) / 1.055).powf(2.4);
        assert!((display(linear / (1.0 - linear), 1.0) - 0.5).abs() < 1e-12);
        assert_eq!(quantise(0.5), 128);
        for x in [1e-4, 0.01, 0.3, 2.0] {
            let h = 1e-6 * x;
            let slope = (display(x + h, 1.7) - display(x - h, 1.7)) / (2.0 * h);
            assert!((slope / display_slope(x, 1.7) - 1.0).abs() < 1e-6, "{x}");
        }
    }
}
