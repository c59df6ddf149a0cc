//! Direct sunlight on a surface that faces the sun, under the same air as Preetham's sky (Preetham, Shirley and Smits
//! 1999, appendix A.1).
//!
//! Unit: klx, as linear sRGB (so that a radiance in kcd/m² and this irradiance are in one system). The sun above the
//! air is a black body of 5772 K (IAU 2015) that gives 133.1 klx; its light passes molecules (Rayleigh), haze
//! (Ångström's formula with the exponent 1.3, its β from turbidity) and ozone (.35 cm). Limits: mixed gases and water
//! vapour are left out, for they absorb beyond 690 nm, where the eye hardly sees; refraction is in the relative air
//! mass alone. Channels that would be negative (a deep red sun lies outside sRGB) are 0.

use super::colour;
use std::sync::OnceLock;

/// Illuminance above the air at the mean distance (klx).
const ABOVE: f64 = 133.1;
/// Angle from the centre of the sun's disk to its edge (degrees), at the mean distance.
pub const RADIUS_DEG: f64 = 0.2666;
/// Effective temperature (K) and second radiation constant (nm K).
const TEMPERATURE: f64 = 5772.0;
const SECOND: f64 = 1.438_776_877e7;
/// Ozone (cm).
const OZONE: f64 = 0.35;
/// Ozone's absorption coefficient (1/cm), 450 to 780 nm in steps of 10 (Leckner 1978).
const ABSORPTION: [f64; 34] = [
    0.003, 0.006, 0.009, 0.014, 0.021, 0.030, 0.040, 0.048, 0.063, 0.075, 0.085, 0.103, 0.120, 0.120, 0.115, 0.125,
    0.120, 0.105, 0.090, 0.079, 0.067, 0.057, 0.048, 0.036, 0.028, 0.023, 0.018, 0.014, 0.011, 0.010, 0.009, 0.007,
    0.004, 0.0,
];

/// Air mass on the way of the light, relative to that overhead (Kasten 1966, as in appendix A.1); `sun_zenith` from 0
/// to π/2.
pub(crate) fn air_mass(sun_zenith: f64) -> f64 {
    let z = sun_zenith.clamp(0.0, std::f64::consts::FRAC_PI_2);
    1.0 / (z.cos() + 0.15 * (93.885 - z.to_degrees()).powf(-1.253))
}

/// Ångström's β of the haze.
fn haze(turbidity: f64) -> f64 {
    (0.04608 * turbidity - 0.04586).max(0.0)
}

/// Optical depths of one air mass at the wavelength `nm`: of molecules and ozone, and of haze of β = 1.
fn depths(nm: f64) -> [f64; 2] {
    let um = nm / 1000.0;
    let x = ((nm - 450.0) / 10.0).clamp(0.0, 33.0);
    let i = (x as usize).min(32);
    let ozone =
        if nm < 450.0 { 0.0 } else { OZONE * (ABSORPTION[i] + (x - i as f64) * (ABSORPTION[i + 1] - ABSORPTION[i])) };
    [0.008735 * um.powf(-4.08) + ozone, um.powf(-1.3)]
}

/// Share of the light of wavelength `nm` that comes through.
pub fn transmittance(nm: f64, sun_zenith: f64, turbidity: f64) -> f64 {
    let [clear, hazy] = depths(nm);
    (-air_mass(sun_zenith) * (clear + haze(turbidity) * hazy)).exp()
}

/// CIE 1931 colour matching functions, the closed forms of Wyman, Sloan and Shirley 2013, Eq. 4.
pub(crate) fn matching(nm: f64) -> [f64; 3] {
    let bell = |at: f64, below: f64, above: f64| {
        let t = (nm - at) * if nm < at { below } else { above };
        (-0.5 * t * t).exp()
    };
    [
        0.362 * bell(442.0, 0.0624, 0.0374) + 1.056 * bell(599.8, 0.0264, 0.0323) - 0.065 * bell(501.1, 0.0490, 0.0382),
        0.821 * bell(568.8, 0.0213, 0.0247) + 0.286 * bell(530.9, 0.0613, 0.0322),
        1.217 * bell(437.0, 0.0845, 0.0278) + 0.681 * bell(459.0, 0.0385, 0.0725),
    ]
}

/// One wavelength of sunlight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunLine {
    /// XYZ above the air (Y in klx), on a surface that faces the sun.
    pub above: [f64; 3],
    /// Optical depths of one air mass: of molecules and ozone, and of haze of β = 1.
    pub depths: [f64; 2],
}

/// The wavelengths that sunlight is summed over.
pub fn lines() -> &'static [SunLine] {
    static LINES: OnceLock<Vec<SunLine>> = OnceLock::new();
    LINES.get_or_init(|| {
        let each: Vec<(f64, [f64; 3])> = (0..=80)
            .map(|k| {
                let nm = 380.0 + 5.0 * f64::from(k);
                let power = (nm / 560.0).powi(-5) / ((SECOND / (nm * TEMPERATURE)).exp() - 1.0);
                (nm, matching(nm).map(|eye| power * eye))
            })
            .collect();
        let seen: f64 = each.iter().map(|(_, xyz)| xyz[1]).sum();
        each.into_iter().map(|(nm, xyz)| SunLine { above: xyz.map(|v| ABOVE * v / seen), depths: depths(nm) }).collect()
    })
}

/// XYZ (Y in klx) on a surface that faces the sun.
pub fn xyz(sun_zenith: f64, turbidity: f64) -> [f64; 3] {
    let (mass, haze) = (air_mass(sun_zenith), haze(turbidity));
    let mut sum = [0.0; 3];
    for line in lines() {
        let through = (-mass * (line.depths[0] + haze * line.depths[1])).exp();
        (0..3).for_each(|c| sum[c] += through * line.above[c]);
    }
    sum
}

/// Linear sRGB (klx) on a surface that faces the sun; not negative.
pub fn irradiance(sun_zenith: f64, turbidity: f64) -> [f64; 3] {
    colour::rgb_from_xyz(xyz(sun_zenith, turbidity)).map(|v| v.max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    /// Known of clear air: one air mass overhead and about 38 at the horizon; molecules take a tenth of the green
    /// overhead (Bucholtz 1995: optical depth .0984 at 550 nm), and a clear noon sun gives about 100 klx.
    #[test]
    fn what_is_known_of_clear_air() {
        assert!((air_mass(0.0) - 1.0).abs() < 2e-3 && (30.0..40.0).contains(&air_mass(FRAC_PI_2)));
        assert!((air_mass(1.0) * 1.0f64.cos() - 1.0).abs() < 0.01);
        let clear = transmittance(550.0, 0.0, 0.995) / (-OZONE * 0.085f64 * air_mass(0.0)).exp();
        assert!((-clear.ln() / 0.0984 - 1.0).abs() < 0.03, "{}", -clear.ln());
        let noon = xyz(0.3, 2.5)[1];
        assert!((95.0..115.0).contains(&noon), "{noon}");
    }

    /// Equal-energy light integrates to x = y = 1/3 and to the area of ȳ, 106.86 nm: the closed forms of the eye are
    /// whole.
    #[test]
    fn the_eye_sees_equal_energy_white() {
        let sum = (0..=800)
            .map(|k| matching(380.0 + 0.5 * f64::from(k)))
            .fold([0.0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
        assert!(
            (sum[1] * 0.5 / 106.86 - 1.0).abs() < 0.01
                && (sum[0] / sum[1] - 1.0).abs() < 0.01
                && (sum[2] / sum[1] - 1.0).abs() < 0.01
        );
    }

    #[test]
    fn lower_and_hazier_suns_are_redder_and_dimmer() {
        let all = |z: f64, t: f64| xyz(z, t);
        for t in [2.0, 4.0, 6.0] {
            let steps: Vec<[f64; 3]> = (0..=15).map(|k| all(FRAC_PI_2 * f64::from(k) / 15.0, t)).collect();
            assert!(steps.windows(2).all(|w| w[1][1] < w[0][1] && w[1][0] / w[1][2] > w[0][0] / w[0][2]), "{t}");
        }
        assert!(all(0.8, 5.0)[1] < all(0.8, 2.5)[1]);
        let [r, _, b] = irradiance(1.5, 3.0);
        assert!(r > 3.0 * b, "{r} {b}");
        assert!(irradiance(FRAC_PI_2, 6.0).iter().all(|v| *v >= 0.0));
    }
}
