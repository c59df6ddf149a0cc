//! The daylight sky of Preetham, Shirley and Smits 1999 ("A practical analytic model for daylight"), with the paper's
//! own four-decimal numbers; no smoothing at the horizon, no clamp.
//!
//! The luminance Y and the chromaticities x and y are each v(θ, γ) = v_z F(θ, γ)/F(0, θs), where F = (1 + A
//! e^(B/cosθ))(1 + C e^(Dγ) + E cos²γ) (Perez 1993) and A … E are linear in the turbidity τ, θ is the angle from the
//! zenith, γ that from the sun, θs the sun's zenith angle and v_z the value at the zenith. Unit: kcd/m². Limits: the
//! luminance factor 1 + A e^B is zero at τ = 1.643, and below that the horizon is negative, so τ is accepted from 1.7
//! to 10. The paper fitted 2 to 6, and below 2.5 the horizon is too bright (Zotti et al. 2007).

use super::{Sky, SkyFamily, SkyRefusal, check};

/// The model; it has no parameters besides sun and turbidity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Preetham;

/// Turbidities accepted.
pub const TURBIDITIES: [f64; 2] = [1.7, 10.0];
/// Turbidities of the dissertation's fit (Habel 2009, §5.2.2).
pub const TRUSTED: [f64; 2] = [2.5, 6.0];

/// Perez coefficients A … E as slope and offset in turbidity, for Y, x and y (Preetham et al., appendix A.2).
pub const PEREZ: [[[f64; 2]; 5]; 3] = [
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
    [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
];
/// Zenith chromaticities: rows τ², τ, 1; columns θs³, θs², θs, 1.
pub const ZENITH_X: [[f64; 4]; 3] =
    [[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]];
/// The same for the chromaticity y.
pub const ZENITH_Y: [[f64; 4]; 3] =
    [[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]];

/// Everything that depends on the turbidity alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreethamTurbidity {
    /// Turbidity: 1 is pure air, 6 is hazy.
    pub turbidity: f64,
    /// A … E for Y, x, y.
    perez: [[f64; 5]; 3],
    /// Polynomials of the zenith chromaticities in θs, highest power first.
    chroma: [[f64; 4]; 2],
    /// 1 + A e^B: the horizon factor at the zenith.
    overhead: [f64; 3],
}

impl PreethamTurbidity {
    /// `turbidity` is not checked here; see [`Preetham::at`].
    pub fn new(turbidity: f64) -> PreethamTurbidity {
        let t = turbidity;
        let perez = PEREZ.map(|row| row.map(|[slope, offset]| slope * t + offset));
        let chroma = [ZENITH_X, ZENITH_Y].map(|m| std::array::from_fn(|k| (m[0][k] * t + m[1][k]) * t + m[2][k]));
        let overhead = perez.map(|p| 1.0 + p[0] * p[1].exp());
        PreethamTurbidity { turbidity, perez, chroma, overhead }
    }

    /// A … E for Y, x, y.
    pub fn perez(&self) -> [[f64; 5]; 3] {
        self.perez
    }

    /// 1 + A e^(B/cosθ) for Y, x, y, which depends only on the view's zenith angle. `mu` is cosθ; 0 and below give the
    /// limit at the horizon.
    #[inline]
    pub fn horizon(&self, mu: f64) -> [f64; 3] {
        let inverse = if mu > 0.0 { 1.0 / mu } else { f64::INFINITY };
        // B < 0 for every turbidity accepted: the exponential vanishes at the horizon.
        self.perez.map(|p| 1.0 + p[0] * (p[1] * inverse).exp())
    }

    /// 1 + C e^(Dγ) + E cos²γ for Y, x, y, which depends only on the angle to the sun.
    #[inline]
    pub fn glow(&self, gamma: f64) -> [f64; 3] {
        let cos = gamma.cos();
        self.perez.map(|p| 1.0 + p[2] * (p[3] * gamma).exp() + p[4] * cos * cos)
    }

    /// Zenith luminance (kcd/m²) and chromaticities x, y.
    #[inline]
    pub fn zenith(&self, sun_zenith: f64) -> [f64; 3] {
        let t = self.turbidity;
        let chi = (4.0 / 9.0 - t / 120.0) * (std::f64::consts::PI - 2.0 * sun_zenith);
        let luminance = (4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192;
        let [x, y] = self.chroma.map(|c| ((c[0] * sun_zenith + c[1]) * sun_zenith + c[2]) * sun_zenith + c[3]);
        [luminance, x, y]
    }

    /// v_z / F(0, θs) for Y, x, y, which depends on the sun's height and the turbidity but not on the direction.
    #[inline]
    pub fn scale(&self, sun_zenith: f64) -> [f64; 3] {
        let (zenith, glow) = (self.zenith(sun_zenith), self.glow(sun_zenith));
        std::array::from_fn(|c| zenith[c] / (self.overhead[c] * glow[c]))
    }

    /// The factors that multiply the three separable functions Y, Y/y and Y·x/y of [`separable`].
    #[inline]
    pub fn prefactors(&self, sun_zenith: f64) -> [f64; 3] {
        let [l, x, y] = self.scale(sun_zenith);
        [l, l / y, l * x / y]
    }

    /// The three functions of direction without their prefactors, each a function of θ times a function of γ: F_Y,
    /// F_Y/F_y, F_Y F_x/F_y.
    #[inline]
    pub fn separable(&self, mu: f64, gamma: f64) -> [f64; 3] {
        let (f, g) = (self.horizon(mu), self.glow(gamma));
        let v: [f64; 3] = std::array::from_fn(|c| f[c] * g[c]);
        let ratio = v[0] / v[2];
        [v[0], ratio, ratio * v[1]]
    }
}

/// XYZ from (Y, Y/y, Y·x/y): linear.
#[inline]
pub fn xyz_from_separable(s: [f64; 3]) -> [f64; 3] {
    [s[2], s[0], s[1] - s[2] - s[0]]
}

/// One Preetham sky.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreethamSky {
    turbid: PreethamTurbidity,
    sun_zenith: f64,
    prefactors: [f64; 3],
}

impl PreethamSky {
    /// Zenith luminance (kcd/m²) and chromaticities x, y.
    pub fn zenith(&self) -> [f64; 3] {
        self.turbid.zenith(self.sun_zenith)
    }
    /// Factors of the three separable functions: see [`PreethamTurbidity::prefactors`].
    pub fn prefactors(&self) -> [f64; 3] {
        self.prefactors
    }
    /// What depends on the turbidity alone.
    pub fn turbid(&self) -> &PreethamTurbidity {
        &self.turbid
    }
}

impl Sky for PreethamSky {
    fn sun_zenith(&self) -> f64 {
        self.sun_zenith
    }
    fn xyz_near_sun(&self, d: [f64; 3], gamma: f64) -> [f64; 3] {
        let s = self.turbid.separable(d[2], gamma);
        xyz_from_separable(std::array::from_fn(|k| self.prefactors[k] * s[k]))
    }
}

impl Preetham {
    /// The sky with these parameters, by its own type.
    ///
    /// # Errors
    /// As [`SkyFamily::sky`].
    pub fn at(self, sun_zenith: f64, turbidity: f64) -> Result<PreethamSky, SkyRefusal> {
        let sun_zenith = check(sun_zenith, turbidity, TURBIDITIES)?;
        let turbid = PreethamTurbidity::new(turbidity);
        Ok(PreethamSky { turbid, sun_zenith, prefactors: turbid.prefactors(sun_zenith) })
    }
}

impl SkyFamily for Preetham {
    fn name(&self) -> &'static str {
        "preetham"
    }
    fn turbidities(&self) -> [f64; 2] {
        TURBIDITIES
    }
    fn trusted(&self) -> [f64; 2] {
        TRUSTED
    }
    fn sky(&self, sun_zenith: f64, turbidity: f64) -> Result<Box<dyn Sky>, SkyRefusal> {
        Ok(Box::new(self.at(sun_zenith, turbidity)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{angle_to_sun, sun_direction};
    use std::f64::consts::FRAC_PI_2;

    /// xyY written out from the paper's formulas, without the grouping that the code uses.
    fn by_the_book(theta_s: f64, t: f64, d: [f64; 3]) -> [f64; 3] {
        let theta = d[2].acos();
        let gamma = angle_to_sun(theta_s, d);
        let f = |p: [f64; 5], theta: f64, gamma: f64| {
            (1.0 + p[0] * (p[1] / theta.cos()).exp()) * (1.0 + p[2] * (p[3] * gamma).exp() + p[4] * gamma.cos().powi(2))
        };
        let p_lum = [
            0.1787 * t - 1.4630,
            -0.3554 * t + 0.4275,
            -0.0227 * t + 5.3251,
            0.1206 * t - 2.5771,
            -0.0670 * t + 0.3703,
        ];
        let p_x = [
            -0.0193 * t - 0.2592,
            -0.0665 * t + 0.0008,
            -0.0004 * t + 0.2125,
            -0.0641 * t - 0.8989,
            -0.0033 * t + 0.0452,
        ];
        let p_y = [
            -0.0167 * t - 0.2608,
            -0.0950 * t + 0.0092,
            -0.0079 * t + 0.2102,
            -0.0441 * t - 1.6537,
            -0.0109 * t + 0.0529,
        ];
        let chi = (4.0 / 9.0 - t / 120.0) * (std::f64::consts::PI - 2.0 * theta_s);
        let lum = (4.0453 * t - 4.9710) * chi.tan() - 0.2155 * t + 2.4192;
        let (t2, s, s2, s3) = (t * t, theta_s, theta_s.powi(2), theta_s.powi(3));
        let x = t2 * (0.00166 * s3 - 0.00375 * s2 + 0.00209 * s)
            + t * (-0.02903 * s3 + 0.06377 * s2 - 0.03202 * s + 0.00394)
            + (0.11693 * s3 - 0.21196 * s2 + 0.06052 * s + 0.25886);
        let y = t2 * (0.00275 * s3 - 0.00610 * s2 + 0.00317 * s)
            + t * (-0.04214 * s3 + 0.08970 * s2 - 0.04153 * s + 0.00516)
            + (0.15346 * s3 - 0.26756 * s2 + 0.06670 * s + 0.26688);
        let at = |z: f64, p| z * f(p, theta, gamma) / f(p, 0.0, theta_s);
        let (lum, x, y) = (at(lum, p_lum), at(x, p_x), at(y, p_y));
        [x / y * lum, lum, (1.0 - x - y) / y * lum]
    }

    #[test]
    fn agrees_with_the_formulas_as_printed() {
        for t in [1.7, 2.5, 4.0, 10.0] {
            for s in [0.0, 0.7, 1.3, FRAC_PI_2] {
                let sky = Preetham.at(s, t).unwrap();
                for (theta, phi) in [(0.0, 0.0), (0.7, 0.0), (1.2, 2.0), (1.5, 3.1)] {
                    let (theta, phi): (f64, f64) = (theta, phi);
                    let d = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
                    let (got, want) = (sky.xyz(d), by_the_book(s, t, d));
                    for c in 0..3 {
                        assert!((got[c] / want[c] - 1.0).abs() < 1e-12, "τ {t} θs {s} {d:?}: {got:?} {want:?}");
                    }
                }
            }
        }
    }

    /// At the zenith the model is its zenith value: F(0, θs)/F(0, θs) = 1.
    #[test]
    fn the_zenith_is_the_zenith() {
        let sky = Preetham.at(0.9, 3.0).unwrap();
        let [l, x, y] = sky.zenith();
        let xyz = sky.xyz([0.0, 0.0, 1.0]);
        assert!((xyz[1] / l - 1.0).abs() < 1e-13 && (xyz[0] / (xyz[0] + xyz[1] + xyz[2]) - x).abs() < 1e-13);
        assert!((xyz[1] / (xyz[0] + xyz[1] + xyz[2]) - y).abs() < 1e-13);
    }

    /// The zero of the luminance factor lies where the limits say.
    #[test]
    fn the_pole_is_at_1_643() {
        assert!(PreethamTurbidity::new(1.6425).overhead[0] > 0.0 || PreethamTurbidity::new(1.6435).overhead[0] > 0.0);
        assert!(PreethamTurbidity::new(1.6425).overhead[0] * PreethamTurbidity::new(1.6435).overhead[0] < 0.0);
    }

    #[test]
    fn outside_is_refused_or_warned_by_name() {
        for (s, t, word) in [
            (0.5, 1.69, "turbidity is 1.69"),
            (0.5, 10.01, "turbidity"),
            (0.5, f64::NAN, "turbidity"),
            (1.58, 3.0, "below the horizon"),
            (-0.1, 3.0, "sun_zenith is -0.1"),
            (f64::INFINITY, 3.0, "sun_zenith"),
        ] {
            assert!(Preetham.sky(s, t).is_err_and(|e| e.to_string().contains(word)), "{s} {t}");
        }
        // π/2 rounded up to five digits
        assert_eq!(Preetham.at(FRAC_PI_2 + 3.7e-6, 3.0), Preetham.at(FRAC_PI_2, 3.0));
        assert!(Preetham.sky(FRAC_PI_2, 10.0).is_ok() && Preetham.sky(0.0, 1.7).is_ok());
        assert!(Preetham.warning(2.4).is_some() && Preetham.warning(6.1).is_some() && Preetham.warning(2.5).is_none());
    }

    #[test]
    fn the_sun_side_is_the_brighter_one() {
        let sky = Preetham.at(1.0, 3.0).unwrap();
        let sun = sun_direction(1.0);
        assert!(sky.rgb(sun)[1] > 2.0 * sky.rgb([-sun[0], 0.0, sun[2]])[1]);
    }
}
