//! How the wind leans a lawn: a map of gusts that repeats and moves with the wind (H9 §2.3.2).
//!
//! Blades are light and follow the wind immediately. The lean of a blade, which is the displacement of a point over its
//! height, is proportional to the wind's speed (Eq. 4.19), whose spectrum is Eq. 4.15. The map is an isotropic motion
//! texture with this spectrum, with one channel along the wind and one across it. It moves with the wind without
//! changing (Taylor's hypothesis), so that a gust reaches one blade after the other. Its shortest wave is [`WAVES`]
//! times the height of the tallest lawn in the scene. Shorter waves would bend single blades back and forth (H9 §4.7.2
//! uses 4 lengths of a leaf). Its longest wave follows from the size of the texture. All lawns of a scene have the same
//! gusts.

use super::flutter::unrepeated;
use super::sway::MOTION_SIDE;
use crate::manifest::SceneManifest;
use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use glam::{DVec2, DVec3};
use mesophyll_plants::mechanics::motion::MotionTexture;
use mesophyll_plants::mechanics::motion_spectrum::SpectrumMethod;
use mesophyll_plants::mechanics::wind::Wind;
use std::sync::Arc;

/// Length of the shortest wave, relative to the height of the tallest lawn.
pub const WAVES: f64 = 4.0;
/// Number of iterations for a blade's place. Each divides its error by at least 6 in the strongest gust.
const ROUNDS: usize = 16;

/// The gusts of a scene (m/s).
#[derive(Debug)]
pub struct LawnGusts {
    /// The mean wind and its turbulence.
    pub wind: Wind,
    /// The variation of the wind, along it and across it.
    pub motion: MotionTexture,
    /// The direction that the wind blows to, changed slightly so that a line along it does not return soon.
    pub way: DVec2,
}

/// How a lawn leans in the gusts.
#[derive(Debug, Clone)]
pub struct LawnLean {
    /// The gusts that lean it.
    pub gusts: Arc<LawnGusts>,
    /// The displacement of a point over its height, for each m/s.
    pub lean_per_m_s: f64,
}

impl LawnGusts {
    /// The gusts for lawns whose tallest has this height (mm); `None` without a wind.
    ///
    /// # Errors
    /// [`Error::Input`] where the wind's spectrum is not positive and finite.
    pub fn new(manifest: &SceneManifest, tallest: f64, ledger: &Ledger) -> Result<Option<Arc<LawnGusts>>> {
        let Some(said) = manifest.wind.as_ref().filter(|w| w.speed_m_s > 0.0) else { return Ok(None) };
        let wind = Wind { speed: said.speed_m_s, turbulence: said.turbulence };
        let highest = wind.speed / (WAVES * tallest / 1e3);
        let seed = said.seed.wrapping_add(1 << 60);
        let bytes = (MOTION_SIDE * MOTION_SIDE * 8) as u64;
        let make = || MotionTexture::new(|f| wind.spectrum(f), highest, MOTION_SIDE, seed, SpectrumMethod::InverseAbel);
        let motion = ledger.note("make", "map of gusts over lawns", bytes, make).ok_or_else(|| {
            Error::field(&manifest.path, "wind", "the gusts over lawns have no spectrum that is positive and finite")
        })?;
        let way = unrepeated(said.direction().truncate());
        Ok(Some(Arc::new(LawnGusts { wind, motion, way })))
    }

    /// Sides of the map for each mm along x and along y.
    pub fn turn(&self) -> [DVec2; 2] {
        let side = self.motion.speed() / self.wind.speed / 1e3;
        // The map moves with the wind, so a gust arrives later at a place that is further along the wind.
        [DVec2::X, DVec2::Y]
            .map(|axis| side * (axis.dot(self.way.perp()) * self.way.perp() - axis.dot(self.way) * self.way))
    }

    /// Sides of the map for each second.
    pub fn drift(&self) -> DVec2 {
        self.motion.speed() * self.way
    }

    /// The wind at a place (mm) and a time (s), along x and y (m/s).
    pub fn at(&self, place: DVec2, time: f64) -> DVec2 {
        let turn = self.turn();
        let at = turn[0] * place.x + turn[1] * place.y + self.drift() * time;
        self.way * self.wind.speed + self.across(self.motion.sample(at.to_array()))
    }

    /// Both channels of the map as a vector along x and y.
    pub fn across(&self, channels: [f64; 2]) -> DVec2 {
        self.way * channels[0] + self.way.perp() * channels[1]
    }

    /// The strongest wind (m/s) that is taken into account: four standard deviations above the mean.
    pub fn strongest(&self) -> f64 {
        self.wind.speed + 4.0 * self.motion.rms()[0]
    }
}

impl LawnLean {
    /// The lean of a blade's point along x and y, at its moved place (mm) and a time (s).
    pub fn at(&self, place: DVec2, time: f64) -> DVec2 {
        self.lean_per_m_s * self.gusts.at(place, time)
    }

    /// The place and the normal in the wind of a blade's point that is at `point` without wind (mm, z over the lawn's
    /// ground). A point below the ground does not move.
    pub fn bent(&self, point: DVec3, normal: DVec3, time: f64) -> (DVec3, DVec3) {
        let height = point.z.max(0.0);
        let rest = point.truncate();
        let mut to = rest;
        for _ in 0..ROUNDS {
            let next = rest + height * self.at(to, time);
            let done = next.distance_squared(to) < 1e-18;
            to = next;
            if done {
                break;
            }
        }
        let turned = normal - DVec3::Z * self.at(to, time).dot(normal.truncate());
        (to.extend(point.z), turned.normalize_or(normal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};
    use std::sync::LazyLock;

    /// All tests share one map, which takes seconds.
    static GUSTS: LazyLock<Arc<LawnGusts>> = LazyLock::new(|| {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/scenes/plant.toml");
        let mut manifest = SceneManifest::read(&path).unwrap();
        manifest.wind = Some(crate::manifest::SceneWind {
            speed_m_s: 3.0,
            azimuth_deg: 30.0,
            turbulence: 0.3,
            seed: 7,
            time_s: 0.0,
            simplified: false,
        });
        let made = LawnGusts::new(&manifest, 60.0, &Ledger::new()).unwrap().unwrap();
        manifest.wind.as_mut().unwrap().speed_m_s = 0.0;
        assert!(LawnGusts::new(&manifest, 60.0, &Ledger::new()).unwrap().is_none());
        made
    });

    /// The wind at a blade over time has the spectrum of Eq. 4.15, along the wind and across it, by a discrete Fourier
    /// transform of segments. An isotropic texture itself deviates by .08 in log10. 16 segments with at least 8 bins
    /// scatter by at most 9 % (.04).
    #[test]
    fn a_blade_feels_the_wind_of_chapter_four() {
        let gusts = &GUSTS;
        let (dt, segment) = (0.125 / gusts.motion.highest, 1024);
        let place = DVec2::new(310.0, -70.0);
        let felt: Vec<DVec2> = (0..16 * segment).map(|k| gusts.at(place, k as f64 * dt)).collect();
        let step = 1.0 / (segment as f64 * dt);
        for (axis, mean) in [(gusts.way, gusts.wind.speed), (gusts.way.perp(), 0.0)] {
            for [low, high] in [[8, 16], [16, 32], [32, 64], [64, 112]] {
                let (mut have, mut want) = (0.0, 0.0);
                for bin in low..high {
                    want += gusts.wind.spectrum(f64::from(bin) * step);
                    for part in felt.chunks(segment) {
                        let (mut re, mut im) = (0.0, 0.0);
                        for (n, v) in part.iter().enumerate() {
                            let window = (PI * n as f64 / segment as f64).sin().powi(2);
                            let (sin, cos) = (TAU * f64::from(bin) * n as f64 / segment as f64).sin_cos();
                            re += window * (v.dot(axis) - mean) * cos;
                            im += window * (v.dot(axis) - mean) * sin;
                        }
                        // Hann's window keeps 3/8 of the power.
                        have += 2.0 * dt * (re * re + im * im) / (0.375 * segment as f64) / 16.0;
                    }
                }
                let off = (have / want).log10();
                println!("{:.2} to {:.2} Hz: {off:.3}", f64::from(low) * step, f64::from(high) * step);
                assert!(off.abs() < 0.12, "{off} in log10 from {} Hz", f64::from(low) * step);
            }
        }
    }

    /// A gust arrives later at a place further along the wind, and is unchanged. The map is several lawns wide.
    #[test]
    fn gusts_move_with_the_wind() {
        let gusts = &GUSTS;
        for (k, seconds) in [0.1, 1.7, 12.0].into_iter().enumerate() {
            let place = DVec2::new(100.0 * k as f64, 37.0);
            let on = gusts.at(place + 1e3 * seconds * gusts.wind.speed * gusts.way, 2.0 + seconds);
            assert!(on.distance(gusts.at(place, 2.0)) < 1e-6);
        }
        let side = 1.0 / gusts.turn()[0].length();
        assert!(side > 10_000.0, "{side} mm");
        assert!(gusts.way.angle_to(DVec2::from_angle(30f64.to_radians())).abs() < 0.17);
    }

    /// A bent point is where the lean at that place puts it. Roots do not move, and normals stay at right angles to the
    /// blade.
    #[test]
    fn blades_lean_as_the_field_says_where_they_are() {
        let leaning = LawnLean { gusts: Arc::clone(&GUSTS), lean_per_m_s: 0.1 };
        for k in 0..50 {
            let point = DVec3::new(31.0 * f64::from(k), -17.0 * f64::from(k), 1.2 * f64::from(k));
            let (normal, along) = (DVec3::new(0.6, -0.48, 0.64), DVec3::new(0.8, 0.36, -0.48));
            let (to, turned) = leaning.bent(point, normal, 3.0);
            let lean = leaning.at(to.truncate(), 3.0);
            assert!((to - (lean * point.z).extend(0.0)).distance(point) < 1e-6, "{point}");
            assert!(turned.dot(along + (lean * along.z).extend(0.0)).abs() < 1e-12);
            assert!(k > 0 || to == point);
        }
    }
}
