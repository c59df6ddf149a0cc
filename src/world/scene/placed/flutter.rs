//! Torsional flutter of a plant's leaves. Each turns back and forth about its own axis, from the place where it hangs
//! to its tip.
//!
//! The angle comes from three motion textures (H9 §4.6), in the planes xy, yz and xz. The wind moves them, so that a
//! gust reaches one leaf after the other. A leaf's place determines where it reads them. The weights are those of Eq.
//! 4.27, [normalised](mesophyll_plants::mechanics::wind::leaf_weights), and then divided by their root sum of squares.
//! So three independent fields together have the power of one. Each plane is crossed at the textures' own speed,
//! whatever the wind's component in it, so that its frequencies are right.
//!
//! Like a branch, a leaf is an oscillator (Eq. 4.16). Its angle follows the wind's speed with a mean of 0, and without
//! wind nothing moves. The textures hold frequencies from 1/64 of a leaf's resonance to twice the resonance.

use super::plant::PlacedPlant;
use crate::manifest::StatedFlutter;
use crate::placed::ledger::Ledger;
use glam::{DMat3, DMat4, DVec2, DVec3};
use mesophyll_plants::form::Plant;
use mesophyll_plants::mechanics::motion::MotionTexture;
use mesophyll_plants::mechanics::motion_spectrum::SpectrumMethod;
use mesophyll_plants::mechanics::wind::{Oscillator, Sway, Wind, leaf_weights};
use mesophyll_plants::pose::{RigidMotion, limited};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Texels along a side of a texture.
const SIDE: usize = 1024;
/// Angles (rad) are unchanged up to the first limit, and approach the second one above.
const FREE: f64 = 0.8;
const FURTHEST: f64 = 1.4;

/// Number of textures for one kind of flutter (8 MB each).
pub const TEXTURES: usize = 3;

/// The gusts for all leaves of a scene with the same flutter.
#[derive(Debug)]
pub struct FlutterGusts {
    /// The spectrum of the angle (rad).
    pub sway: Sway,
    textures: [MotionTexture; TEXTURES],
}

impl FlutterGusts {
    /// Makes the gusts; `None` where the spectrum is not finite and positive.
    pub fn new(said: &StatedFlutter, wind: Wind, seed: u64, ledger: &Ledger) -> Option<FlutterGusts> {
        let resonance = said.resonance_hz;
        let oscillator = Oscillator { resonance, damping: said.damping * 2.0 * TAU * resonance };
        let sway = Sway { wind, oscillator, lean: said.deg_per_m_s.to_radians() * wind.speed };
        let make = |plane: u64| {
            let seed = seed.wrapping_add((1 + plane) << 56);
            MotionTexture::new(|f| sway.spectrum(f), sway.highest(), SIDE, seed, SpectrumMethod::InverseAbel)
        };
        let made = ledger.note("make", "motion textures of leaves", (TEXTURES * SIDE * SIDE * 8) as u64, || {
            Some([make(0)?, make(1)?, make(2)?])
        });
        Some(FlutterGusts { sway, textures: made? })
    }
}

/// The flutter of a plant's leaves.
#[derive(Debug)]
pub struct PlacedFlutter {
    gusts: Arc<FlutterGusts>,
    /// Weights of the textures. The sum of their squares is 1.
    weights: [f64; 3],
    /// For each plane, the direction in which a leaf moves through the texture.
    ways: [DVec2; 3],
    /// For each leaf, in the plant's frame, the place where it hangs and its axis.
    hangs: Vec<(DVec3, DVec3)>,
    places: Vec<DMat4>,
}

impl PlacedFlutter {
    /// The flutter in a wind that blows `towards` (a unit vector).
    pub fn new(gusts: Arc<FlutterGusts>, towards: DVec3, planted: &PlacedPlant) -> PlacedFlutter {
        let weights = leaf_weights(towards.to_array());
        let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
        let ways = planes(towards).map(|within| unrepeated(within.normalize_or(DVec2::X)));
        let places = planted.groups.as_ref().map_or(&planted.places, |groups| &groups.leaders);
        let (hangs, places) = (hangs(&planted.plant), places.clone());
        PlacedFlutter { gusts, weights: weights.map(|w| w / norm), ways, hangs, places }
    }

    /// The angle (rad) of a leaf at a place and a time (s), with the spectrum above.
    pub fn angle(&self, place: usize, leaf: usize, time: f64) -> f64 {
        let point = self.places[place].transform_point3(self.hangs[leaf].0) / 1e3;
        let speed = self.gusts.sway.wind.speed;
        let mut sum = 0.0;
        for (((motion, weight), way), within) in
            self.gusts.textures.iter().zip(self.weights).zip(self.ways).zip(planes(point))
        {
            if weight > 0.0 {
                // The field moves with the wind, and the leaf stays at its place.
                let along = time - within.dot(way) / speed;
                let across = within.dot(way.perp()) / speed;
                let at = motion.speed() * (along * way + across * way.perp());
                sum += weight * motion.sample(at.to_array())[0];
            }
        }
        sum
    }

    /// The angle (rad) by which a leaf turns at a place and a time (s): [`PlacedFlutter::angle`] within its limits.
    pub fn turn(&self, place: usize, leaf: usize, time: f64) -> f64 {
        let angle = self.angle(place, leaf, time);
        limited(angle.abs(), FREE, FURTHEST).copysign(angle)
    }

    /// The place where a leaf hangs and the unit vector about which it turns, in the plant's frame.
    pub fn hang(&self, leaf: usize) -> (DVec3, DVec3) {
        self.hangs[leaf]
    }

    /// Number of leaves.
    pub fn leaves(&self) -> usize {
        self.hangs.len()
    }

    /// The rotation from rest of every leaf of the plant at a place and a time (s), in the plant's frame.
    pub fn turns(&self, place: usize, time: f64) -> Vec<RigidMotion> {
        let turn = |(leaf, (hang, axis)): (usize, &(DVec3, DVec3))| {
            let turn = DMat3::from_axis_angle(*axis, self.turn(place, leaf, time));
            RigidMotion { from: *hang, to: *hang, turn }
        };
        self.hangs.iter().enumerate().map(turn).collect()
    }
}

/// The components of a vector in the planes xy, yz and xz.
fn planes(v: DVec3) -> [DVec2; 3] {
    [DVec2::new(v.x, v.y), DVec2::new(v.y, v.z), DVec2::new(v.x, v.z)]
}

/// The place where each leaf hangs on its branch, and the unit direction from there to the blade's tip.
fn hangs(plant: &Plant) -> Vec<(DVec3, DVec3)> {
    let one = |leaf: &mesophyll_plants::form::Leaf| {
        let (hang, along) = plant.hang(leaf);
        (hang, along.try_normalize().unwrap_or(leaf.transform.x_axis.truncate().normalize_or(DVec3::X)))
    };
    plant.leaves.iter().map(one).collect()
}

/// The number of passages of a texture in which a line through it should not come near itself. It is ten minutes for
/// leaves with the highest resonance that a scene may have ([`crate::manifest::MOST_LEAF_RESONANCE`]).
const PASSAGES: i32 = 60;

/// The direction near `way` whose line stays away from itself longest. The textures repeat, so a line along x would
/// return after one passage.
pub(super) fn unrepeated(way: DVec2) -> DVec2 {
    let mut best = (way, back(way));
    for k in 1..=40 {
        if best.1 >= f64::from(PASSAGES) {
            break;
        }
        for sign in [1.0, -1.0] {
            let turned = DVec2::from_angle(sign * 0.004 * f64::from(k)).rotate(way);
            let found = back(turned);
            if found > best.1 {
                best = (turned, found);
            }
        }
    }
    best.0
}

/// The number of passages after which a line returns near its beginning, at most [`PASSAGES`].
fn back(d: DVec2) -> f64 {
    // The width of a wave with the highest frequency.
    let apart = mesophyll_plants::mechanics::motion::TEXELS_A_CYCLE as f64 / SIDE as f64;
    let all = (-PASSAGES..=PASSAGES).flat_map(|p| (-PASSAGES..=PASSAGES).map(move |q| (p, q)));
    all.filter(|(p, q)| (*p, *q) != (0, 0))
        .map(|(p, q)| DVec2::new(f64::from(p), f64::from(q)))
        .filter(|v| v.perp_dot(d).abs() < 0.5 * apart && v.dot(d) > 0.0)
        .map(|v| v.length())
        .fold(f64::from(PASSAGES), f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::SceneManifest;

    fn fluttering(speed: f64, azimuth: f64) -> (PlacedPlant, PlacedFlutter) {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../data/scenes/plant.toml");
        let manifest = SceneManifest::read(&root).unwrap();
        let planted = super::super::plant::planted(&manifest, &Ledger::new()).unwrap().remove(0);
        let said = StatedFlutter { deg_per_m_s: 4.0, resonance_hz: 4.0, damping: 0.3 };
        let towards = DVec3::new(f64::cos(azimuth), f64::sin(azimuth), 0.0);
        let wind = Wind { speed, turbulence: 0.3 };
        let gusts = FlutterGusts::new(&said, wind, 7, &Ledger::new()).unwrap();
        let flutter = PlacedFlutter::new(Arc::new(gusts), towards, &planted);
        (planted, flutter)
    }

    /// For all directions of the wind, leaves with the highest resonance that a scene may have do not repeat within ten
    /// minutes. A wind without gusts gives no textures.
    #[test]
    fn lines_in_all_directions_stay_away_from_themselves() {
        let resonance_hz = crate::manifest::MOST_LEAF_RESONANCE;
        let said = StatedFlutter { deg_per_m_s: 4.0, resonance_hz, damping: 0.3 };
        let gusts = FlutterGusts::new(&said, Wind { speed: 4.0, turbulence: 0.3 }, 7, &Ledger::new()).unwrap();
        let passage = 1.0 / gusts.textures[0].speed();
        for k in 0..360 {
            let way = DVec2::from_angle(f64::from(k).to_radians());
            let found = unrepeated(way);
            let seconds = back(found) * passage;
            assert!(seconds > 599.999 && found.angle_to(way).abs() < 0.02, "{k} degrees: {seconds} s");
        }
        assert!((gusts.textures[0].lowest * 64.0 / resonance_hz - 1.0).abs() < 1e-12);
        assert!(FlutterGusts::new(&said, Wind { speed: 1e-150, turbulence: 0.3 }, 7, &Ledger::new()).is_none());
    }

    /// The spectrum of the leaves' angles over nine thousand periods, by a discrete Fourier transform of segments,
    /// agrees with the formula. An isotropic texture itself deviates by .08 in log10 (see
    /// `lines_have_the_wanted_spectrum`).
    #[test]
    fn leaves_have_the_spectrum_of_their_resonance() {
        let (_, flutter) = fluttering(4.0, 0.5);
        let (dt, segment) = (0.03, 512);
        let step = 1.0 / (segment as f64 * dt);
        let mut readings: Vec<Vec<f64>> = Vec::new();
        for leaf in [0, 40, 80, 120, 160] {
            let line = (0..30 * segment).map(|n| flutter.angle(0, leaf, 20.0 + n as f64 * dt)).collect::<Vec<_>>();
            readings.extend(line.chunks(segment).map(<[f64]>::to_vec));
        }
        let (mut squares, mut bands) = (0.0, 0.0);
        for band in [[4, 8], [8, 14], [14, 22], [22, 32], [32, 44], [44, 56], [56, 66], [66, 80], [80, 100]] {
            let (mut have, mut want) = (0.0, 0.0);
            for bin in band[0]..band[1] {
                let f = f64::from(bin) * step;
                want += flutter.gusts.sway.spectrum(f);
                for part in &readings {
                    let (mut re, mut im) = (0.0, 0.0);
                    for (n, v) in part.iter().enumerate() {
                        let window = (std::f64::consts::PI * n as f64 / segment as f64).sin().powi(2);
                        let (sin, cos) = (TAU * f * dt * n as f64).sin_cos();
                        re += window * v * cos;
                        im += window * v * sin;
                    }
                    // Hann's window keeps 3/8 of the power.
                    have += 2.0 * dt * (re * re + im * im) / (0.375 * segment as f64) / readings.len() as f64;
                }
            }
            println!("{:.2} Hz: {:.3}", f64::from(band[0] + band[1]) * 0.5 * step, have / want);
            squares += f64::log10(have / want).powi(2);
            bands += 1.0;
        }
        let rms = f64::sqrt(squares / bands);
        println!("RMS log10 deviation {rms:.3}");
        assert!(rms < 0.1, "{rms}");
    }

    #[test]
    fn leaves_turn_about_their_axes_and_the_wind_decides_how_far() {
        let (planted, flutter) = fluttering(4.0, 0.0);
        let plant = &planted.plant;
        let rms = |flutter: &PlacedFlutter| {
            let n = 400;
            let sum: f64 = (0..n).map(|k| flutter.angle(0, k % 100, 0.37 * k as f64).powi(2)).sum();
            (sum / n as f64).sqrt()
        };
        // The plane that the wind crosses at a right angle gets nothing. The others together have the power of one.
        assert!(flutter.weights[1] == 0.0 && (flutter.weights[0].hypot(flutter.weights[2]) - 1.0).abs() < 1e-12);
        for (leaf, turn) in plant.leaves.iter().zip(flutter.turns(0, 3.0)) {
            let hang = plant.branches[leaf.joint.branch].point(leaf.joint.at).0;
            assert!(turn.place(hang).distance(hang) < 1e-9);
            let tip = plant.blades[leaf.blade].mesh.positions.iter().map(|p| p.x).fold(0.0, f64::max);
            let tip = leaf.transform.transform_point3(DVec3::X * tip);
            assert!(turn.place(tip).distance(tip) < 1e-9);
        }
        // Spectra are proportional to the cube of the speed at low frequencies, and grow less above.
        let (weak, strong) = (rms(&fluttering(1.0, 0.0).1), rms(&flutter));
        assert!(strong > 2.0 * weak && strong < 12.0 * weak && strong > 0.02, "{weak} {strong}");
        // A storm turns no leaf upside down.
        let (_, storm) = fluttering(60.0, 0.3);
        assert!((0..20).flat_map(|k| storm.turns(0, f64::from(k))).all(|t| t.turn.z_axis.is_finite()));
        let most = (0..20).flat_map(|k| storm.turns(0, f64::from(k)));
        let most = most.map(|t| ((t.turn.x_axis.x + t.turn.y_axis.y + t.turn.z_axis.z - 1.0) / 2.0).acos());
        assert!(most.fold(0.0, f64::max) <= FURTHEST + 1e-6);
    }

    /// No line comes near itself for ten minutes, not even along the axes.
    #[test]
    fn flutter_does_not_repeat_within_ten_minutes() {
        let (_, flutter) = fluttering(4.0, 0.0);
        let (dt, n) = (0.07, 20_000);
        let line: Vec<f64> = (0..n).map(|k| flutter.angle(0, 3, f64::from(k) * dt)).collect();
        let square: f64 = line.iter().map(|v| v * v).sum::<f64>() / f64::from(n);
        let worst = ((10.0 / dt) as usize..(600.0 / dt) as usize)
            .map(|lag| {
                let pairs = line.len() - lag;
                (0..pairs).map(|k| line[k] * line[k + lag]).sum::<f64>().abs() / (pairs as f64 * square)
            })
            .fold(0.0, f64::max);
        println!("largest correlation between 10 s and 10 min {worst:.2}");
        assert!(worst < 0.4, "{worst}");
    }
}
