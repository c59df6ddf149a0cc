//! The sky of Hosek and Wilkie 2012 ("An analytic model for full spectral sky-dome radiance"), with ground albedo,
//! through the crate `hw-skymodel` (a port of the authors' RGB data; single precision, so about six digits).
//!
//! Unit: the data are W/(m² sr) integrated over the colour matching functions; 683 lm/W converts them to kcd/m² here.
//! Limits: turbidity 1 to 10, albedo 0 to 1. Towards the horizon radiance behaves like √cosθ, so quadrature converges
//! more slowly than for Preetham's sky.

use super::{Sky, SkyFamily, SkyRefusal, check, colour};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use std::f64::consts::FRAC_PI_2;

/// lm/W of the colour matching functions, in thousands.
const KILOLUMEN_PER_WATT: f64 = 0.683;

/// The model with one ground albedo a channel (R, G, B; 0 to 1).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HosekWilkie {
    /// Ground albedo a channel (R, G, B), 0 to 1.
    pub albedo: [f64; 3],
}

/// One Hosek–Wilkie sky.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HosekWilkieSky {
    state: SkyState,
    sun_zenith: f64,
}

impl HosekWilkieSky {
    fn rgb_at(&self, mu: f64, gamma: f64) -> [f64; 3] {
        let theta = mu.clamp(0.0, 1.0).acos() as f32;
        [Channel::R, Channel::G, Channel::B]
            .map(|c| KILOLUMEN_PER_WATT * f64::from(self.state.radiance(theta, gamma as f32, c)))
    }
}

impl Sky for HosekWilkieSky {
    fn sun_zenith(&self) -> f64 {
        self.sun_zenith
    }
    fn xyz_near_sun(&self, d: [f64; 3], gamma: f64) -> [f64; 3] {
        colour::xyz_from_rgb(self.rgb_at(d[2], gamma))
    }
    fn rgb(&self, d: [f64; 3]) -> [f64; 3] {
        self.rgb_at(d[2], super::angle_to_sun(self.sun_zenith, d))
    }
}

impl SkyFamily for HosekWilkie {
    fn name(&self) -> &'static str {
        "hosek-wilkie"
    }
    fn turbidities(&self) -> [f64; 2] {
        [1.0, 10.0]
    }
    fn trusted(&self) -> [f64; 2] {
        [1.0, 10.0]
    }
    fn sky(&self, sun_zenith: f64, turbidity: f64) -> Result<Box<dyn Sky>, SkyRefusal> {
        let sun_zenith = check(sun_zenith, turbidity, self.turbidities())?;
        if let Some(a) = self.albedo.iter().find(|a| !(0.0..=1.0).contains(*a)) {
            return Err(SkyRefusal(format!("albedo is {a}; expected 0 to 1")));
        }
        let params = SkyParams {
            // Single precision may round π/2 − θs to just above π/2.
            elevation: ((FRAC_PI_2 - sun_zenith) as f32).clamp(0.0, std::f32::consts::FRAC_PI_2),
            turbidity: turbidity as f32,
            albedo: self.albedo.map(|a| a as f32),
        };
        let state = SkyState::new(&params).map_err(|e| SkyRefusal(e.to_string()))?;
        Ok(Box::new(HosekWilkieSky { state, sun_zenith }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Measured illuminance on level ground under a clear sky is .8 + 15.5 √(sine of the sun's elevation) klx (IES
    /// Handbook, daylighting). A wrong unit would be far off.
    #[test]
    fn the_unit_is_klx_on_the_ground() {
        for s in [0.5, 0.9, 1.2f64] {
            let sky = HosekWilkie { albedo: [0.2; 3] }.sky(s, 3.0).unwrap();
            let rgb = crate::irradiance::on_level_ground(&crate::projection::direct(sky.as_ref(), 2));
            let (got, measured) = (colour::xyz_from_rgb(rgb)[1], 0.8 + 15.5 * s.cos().sqrt());
            println!("θs {s}: {got:.2} klx, measured {measured:.2}");
            assert!((0.6..1.7).contains(&(got / measured)), "θs {s}: {got} {measured}");
        }
    }

    #[test]
    fn brighter_ground_brightens_the_sky() {
        let at = |a: f64| HosekWilkie { albedo: [a; 3] }.sky(0.8, 3.0).unwrap().rgb([0.6, 0.0, 0.8]);
        let (dark, bright) = (at(0.0), at(1.0));
        assert!((0..3).all(|c| bright[c] > dark[c]), "{dark:?} {bright:?}");
    }

    #[test]
    fn outside_is_refused() {
        assert!(
            HosekWilkie::default().sky(0.3, 0.9).is_err()
                && HosekWilkie { albedo: [0.1, 1.1, 0.0] }.sky(0.3, 2.0).is_err()
        );
        assert!(HosekWilkie::default().sky(0.0, 10.0).is_ok() && HosekWilkie::default().sky(FRAC_PI_2, 1.0).is_ok());
    }
}
