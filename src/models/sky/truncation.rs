//! What a few bands of harmonics miss of a sky's radiance. Light on matte surfaces hardly notices, because the cosine
//! forgets the higher bands; a picture of the sky does.

use super::harmonics::{HarmonicBasis, HarmonicCoefficients};
use super::{Sky, quadrature};
use std::f64::consts::TAU;

/// Error of radiance, relative, over red, green and blue together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadianceError {
    /// Over the upper hemisphere: the root mean square of the difference over that of the sky.
    pub dome: f64,
    /// The same over the horizon alone.
    pub horizon: f64,
}

impl RadianceError {
    /// The larger error of each kind.
    pub fn or_worse(self, other: RadianceError) -> RadianceError {
        RadianceError { dome: self.dome.max(other.dome), horizon: self.horizon.max(other.horizon) }
    }
}

/// Heights and azimuths of the rule; twice as many change no digit that is shown.
const HEIGHTS: usize = 48;
const AZIMUTHS: usize = 128;

/// The error of harmonics against the sky that they stand for.
pub fn radiance_error(c: &HarmonicCoefficients, sky: &dyn Sky) -> RadianceError {
    let basis = HarmonicBasis::new(c.bands().max(1));
    let ring = |z: f64| {
        let s = (1.0 - z * z).max(0.0).sqrt();
        let mut sums = [0.0; 2];
        for k in 0..AZIMUTHS {
            let phi = TAU * (k as f64 + 0.5) / AZIMUTHS as f64;
            let d = [s * phi.cos(), s * phi.sin(), z];
            let (got, want) = (basis.sum(c, d), sky.rgb(d));
            for k in 0..3 {
                sums[0] += (got[k] - want[k]).powi(2);
                sums[1] += want[k] * want[k];
            }
        }
        sums
    };
    let mut dome = [0.0; 2];
    for &(x, w) in quadrature::gauss(HEIGHTS).iter() {
        let sums = ring(0.5 * (1.0 + x));
        (0..2).for_each(|k| dome[k] += w * sums[k]);
    }
    let share = |[off, all]: [f64; 2]| (off / all).sqrt();
    RadianceError { dome: share(dome), horizon: share(ring(0.0)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::projection::direct;
    use crate::{Preetham, Sky};
    use std::f64::consts::PI;

    /// A sky that is made of two harmonics of the whole sphere: nothing is missing where both are given, and exactly
    /// the second where it is not.
    #[test]
    fn what_is_left_out_is_what_is_missed() {
        #[derive(Debug)]
        struct Two;
        impl Sky for Two {
            fn sun_zenith(&self) -> f64 {
                0.0
            }
            fn xyz_near_sun(&self, _: [f64; 3], _: f64) -> [f64; 3] {
                [0.0; 3]
            }
            fn rgb(&self, d: [f64; 3]) -> [f64; 3] {
                [2.0 + 0.5 * d[2], 1.0, 1.0]
            }
        }
        let mut c = HarmonicCoefficients::zero(2);
        let even = (4.0 * PI).sqrt();
        c.values_mut()[0] = [2.0 * even, even, even];
        c.values_mut()[2] = [0.5 * (4.0 * PI / 3.0).sqrt(), 0.0, 0.0];
        let none = radiance_error(&c, &Two);
        assert!(none.dome < 1e-14 && none.horizon < 1e-14, "{none:?}");
        let missed = radiance_error(&c.truncated(1), &Two);
        // ∫ (z/2)² over ∫ (2 + z/2)² + 2, z even over 0 … 1; the horizon has z = 0
        let want = ((1.0 / 12.0) / (4.0 + 1.0 + 1.0 / 12.0 + 2.0f64)).sqrt();
        assert!((missed.dome - want).abs() < 1e-13 && missed.horizon < 1e-14, "{missed:?} {want}");
    }

    /// More bands miss less of the dome. At the jump of the horizon the series is half the sky, so that about half is
    /// missing there with any number of them.
    #[test]
    fn bands_help_the_dome_and_not_the_horizon() {
        let sky = Preetham.at(0.9, 3.0).unwrap();
        let [few, more, many] = [4, 7, 16].map(|n| radiance_error(&direct(&sky, n), &sky));
        assert!(few.dome > more.dome && more.dome > many.dome, "{few:?} {more:?} {many:?}");
        assert!([few, more, many].iter().all(|e| (0.35..0.65).contains(&e.horizon)), "{few:?} {more:?} {many:?}");
    }
}
