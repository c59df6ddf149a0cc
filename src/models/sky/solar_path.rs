//! Where the sun stands by hour, latitude and season. The sun is a point at infinity without refraction, which would
//! lift it by half a degree at the horizon.

use std::f64::consts::TAU;

/// Most that the sun's declination differs from 0 (degrees).
pub const MOST_DECLINATION_DEG: f64 = 23.45;
/// Most that [`declination_deg`] is off between 2001 and 2050 (degrees).
pub const DECLINATION_ERROR_DEG: f64 = 0.81;

/// Zenith angle and azimuth (rad) of the sun at a solar hour, 12 is noon. +x is east and +y is north. The zenith angle
/// is above π/2 where the sun is below the horizon. Where the sun stands straight above or below, its azimuth means
/// nothing.
pub fn sun_place(latitude_deg: f64, declination_deg: f64, solar_hour: f64) -> (f64, f64) {
    let (sin_d, cos_d) = declination_deg.to_radians().sin_cos();
    let (sin_l, cos_l) = latitude_deg.to_radians().sin_cos();
    let (sin_h, cos_h) = ((solar_hour - 12.0) * 15.0).to_radians().sin_cos();
    let (east, north, up) =
        (-cos_d * sin_h, cos_l * sin_d - sin_l * cos_d * cos_h, sin_l * sin_d + cos_l * cos_d * cos_h);
    // An arc cosine has half the digits where the sun stands overhead.
    (east.hypot(north).atan2(up), north.atan2(east))
}

/// Declination of the sun (degrees) on a day of the year, 1 is the first of January: the series of Spencer (1971),
/// "Fourier series representation of the position of the sun". It knows no year: leap years, and the drift since its
/// own year, are its error.
pub fn declination_deg(day_of_year: f64) -> f64 {
    let at = TAU * (day_of_year - 1.0) / 365.0;
    let series = 0.006918 - 0.399912 * at.cos() + 0.070257 * at.sin() - 0.006758 * (2.0 * at).cos()
        + 0.000907 * (2.0 * at).sin()
        - 0.002697 * (3.0 * at).cos()
        + 0.00148 * (3.0 * at).sin();
    series.to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Declination (degrees) some days after noon of the first of January 2000, by the Astronomical Almanac's formulas
    /// of low precision, which are right to 0.01 degrees.
    fn almanac(days: f64) -> f64 {
        let longitude = 280.460 + 0.9856474 * days;
        let anomaly = (357.528 + 0.9856003 * days).to_radians();
        let ecliptic = longitude + 1.915 * anomaly.sin() + 0.020 * (2.0 * anomaly).sin();
        let tilt = (23.439 - 4e-7 * days).to_radians();
        (tilt.sin() * ecliptic.to_radians().sin()).asin().to_degrees()
    }

    #[test]
    fn declinations_are_the_almanacs_within_the_stated_error() {
        let (mut worst, mut day) = (0.0f64, 366.0);
        for year in 2001..=2050 {
            for of_year in 1..=if year % 4 == 0 { 366 } else { 365 } {
                for part in [-0.5, 0.0, 0.5] {
                    worst = worst.max((declination_deg(f64::from(of_year)) - almanac(day + part)).abs());
                }
                day += 1.0;
            }
        }
        assert!(worst < DECLINATION_ERROR_DEG && worst > 0.9 * DECLINATION_ERROR_DEG, "{worst}");
    }

    /// By a rotation about the axis of the earth, which is not how the formula says it.
    #[test]
    fn the_sun_turns_about_the_pole() {
        for (latitude, declination, hour) in [(50.0f64, 0.0f64, 9.0f64), (-33.0, 23.4, 15.5), (78.0, -12.0, 2.0)] {
            let (l, d) = (latitude.to_radians(), declination.to_radians());
            // East, north, up.
            let pole = [0.0, l.cos(), l.sin()];
            let noon = [0.0, -(l - d).sin(), (l - d).cos()];
            // The sun goes from east over south to west where the pole is in the north: clockwise about the pole.
            let (s, c) = (-(hour - 12.0) / 24.0 * TAU).sin_cos();
            let along: f64 = (0..3).map(|k| pole[k] * noon[k]).sum();
            let cross = [
                pole[1] * noon[2] - pole[2] * noon[1],
                pole[2] * noon[0] - pole[0] * noon[2],
                pole[0] * noon[1] - pole[1] * noon[0],
            ];
            let want = [0, 1, 2].map(|k| noon[k] * c + cross[k] * s + pole[k] * along * (1.0 - c));
            let (zenith, azimuth) = sun_place(latitude, declination, hour);
            let found = [zenith.sin() * azimuth.cos(), zenith.sin() * azimuth.sin(), zenith.cos()];
            assert!((0..3).all(|k| (found[k] - want[k]).abs() < 1e-12), "{found:?} {want:?}");
        }
    }
}
