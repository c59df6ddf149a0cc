//! How the scene's plants sway: what every branch carries, how far the wind moves it, and when.
//!
//! A branch is an oscillator ([`super::sways`]). The wind's force on everything that it carries is proportional to the
//! wind's speed (Eq. 4.19). Gusts come from motion textures. H9 has one for each level of branching, and a branch with
//! another resonance runs faster through it. The branch's spectrum would then be right only if the wind's spectrum were
//! a power of the frequency, which it is not. Here, branches share a texture if their resonances are within
//! [`super::sways::ALIKE`] of each other, whatever their level.

use super::branch::{MOTION_SIDE, variance, wind_direction};
use super::flutter::{Fluttering, Gusts, TEXTURES};
use super::plant::Planted;
use super::sections::Sections;
use super::sways::{alike, leads, sways};
use crate::ledger::Ledger;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use mesophyll_fit_branch::beam::basis;
use mesophyll_flora::pose::{Limbs, Pose, Rigid};
use mesophyll_manifest::{Flutter, Manifest};
use mesophyll_plant::motion::Motion;
use mesophyll_plant::motion_spectrum::Method;
use mesophyll_plant::wind::{Sway, Wind};
use rayon::prelude::*;
use std::sync::{Arc, Mutex};

/// How one branch responds to the wind.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Wind, resonance, damping and lean.
    pub sway: Sway,
    /// Mass (kg) of everything that it carries.
    pub mass: f64,
    /// Index of its motion texture.
    texture: usize,
    /// Its resonance over that of the texture.
    faster: f64,
    /// Amplitude for 1 in the texture.
    gain: f64,
}

/// A `[[plant]]` that sways, with all its places.
#[derive(Debug)]
pub struct Swaying {
    /// Its branches, in the plant's frame.
    pub limbs: Limbs,
    /// The response of each branch; `None` for one without length.
    pub answers: Vec<Option<Answer>>,
    /// The sections that carry its leaves and its bark.
    pub sections: Sections,
    /// How its leaves flutter; `None` where the scene states no flutter.
    pub flutter: Option<Fluttering>,
    /// For each place, the direction that the wind blows to, in the plant's frame.
    towards: Vec<DVec3>,
    seed: u64,
}

/// The largest number of motion textures (8 MB each) of branches and leaves. More are more likely an error of a file
/// than a real plant.
const MOST_TEXTURES: usize = 64;
/// The largest number of cross-sections of all plants together, which an adapter's table can hold.
const MOST_SECTIONS: usize = 4_000_000;
/// The largest number of vertices of bark of all plants together. Every place counts separately.
const MOST_BARK: usize = 20_000_000;

/// All plants of a scene in its wind.
#[derive(Debug)]
pub struct Winds {
    /// The plants, in the manifest's order; `None` for a plant that no wind moves.
    pub plants: Vec<Option<Swaying>>,
    /// The motion textures.
    pub motions: Vec<Motion>,
    /// The gusts for leaves, for each kind of flutter.
    pub gusts: Vec<Arc<Gusts>>,
    /// The sections at the last times that were requested.
    last: Mutex<Vec<(f64, Arc<Vec<Rigid>>)>>,
}

impl Winds {
    /// How the plants sway; `None` where none does.
    ///
    /// # Errors
    /// [`Error::Input`] where a sway or a flutter has no spectrum, where leaves should flutter on branches that do not
    /// sway, and for too many textures, cross-sections or vertices of bark.
    pub fn new(manifest: &Manifest, planted: &[Planted], ledger: &Ledger) -> Result<Option<Winds>> {
        let Some(wind) = manifest.wind.as_ref().filter(|w| w.speed_m_s > 0.0) else { return Ok(None) };
        let moves = |said: &mesophyll_manifest::Plant| said.drag_n_s_m3 > 0.0;
        if !manifest.plants.iter().any(moves) {
            return Ok(None);
        }
        if ledger.count("fit", "beam") == 0 {
            ledger.note("fit", "beam", 0, basis::smooth);
        }
        let mean = Wind { speed: wind.speed_m_s, turbulence: wind.turbulence };
        let sways: Vec<Vec<Option<(Sway, f64)>>> =
            manifest.plants.iter().zip(planted).map(|(said, p)| sways(said, mean, &p.plant)).collect();
        let flutters = flutters(manifest, planted, &sways)?;
        if sways.iter().flatten().all(Option::is_none) {
            return Ok(None);
        }
        let leads = leads(sways.iter().flatten().flatten().map(|(sway, _)| *sway).collect());
        let of_leaves = TEXTURES * flutters.len();
        if leads.len() + of_leaves > MOST_TEXTURES {
            let what = format!(
                "a need of {} motion textures for the sway of branches, whose lengths differ so much, and of \
                 {of_leaves} for the flutter of leaves",
                leads.len()
            );
            let expected = format!(
                "at most {MOST_TEXTURES} in all; lengths are in mm, `scale` multiplies them, and plants whose `flutter` \
                 is the same share textures"
            );
            return Err(Error::unexpected(&manifest.path, "plant", what, expected));
        }
        let bytes = (leads.len() * MOTION_SIDE * MOTION_SIDE * 8) as u64;
        let make = |(k, lead): (usize, &Sway)| {
            let seed = wind.seed.wrapping_add((k as u64) << 48);
            Motion::new(|f| lead.spectrum(f), lead.highest(), MOTION_SIDE, seed, Method::Directed)
        };
        let made = ledger.note("make", "motion textures of plants", bytes, || {
            leads.par_iter().enumerate().map(make).collect::<Option<Vec<Motion>>>()
        });
        let motions = made.ok_or_else(|| {
            Error::field(&manifest.path, "wind", "the plants' sway has no spectrum that is positive and finite")
        })?;
        let of_kind = |(k, said): (usize, &&Flutter)| {
            let seed = wind.seed.wrapping_add((1 + k as u64) << 40);
            let what = "the leaves' flutter has no spectrum that is positive and finite";
            Gusts::new(said, mean, seed, ledger)
                .map(Arc::new)
                .ok_or_else(|| Error::field(&manifest.path, "plant", what))
        };
        let gusts: Vec<Arc<Gusts>> = flutters.iter().enumerate().map(of_kind).collect::<Result<_>>()?;
        let sways_somewhere: Vec<bool> = sways.iter().map(|of| of.iter().any(Option::is_some)).collect();
        let mut first = 0;
        let of_lead: Vec<f64> = leads.iter().map(variance).collect();
        let plants = planted.iter().zip(sways).enumerate().map(|(index, (p, sways))| {
            let limbs = Limbs::new(&p.plant, basis::shape);
            let answer = |(k, sway): (usize, Option<(Sway, f64)>)| {
                let ((sway, mass), limb) = (sway?, &limbs.0[k]);
                let texture = leads.iter().position(|lead| alike(lead, &sway))?;
                let faster = sway.oscillator.resonance / leads[texture].oscillator.resonance;
                let gain = (variance(&sway) / of_lead[texture]).sqrt() / limb.tip;
                Some(Answer { sway, mass, texture, faster, gain })
            };
            let answers = sways.into_iter().enumerate().map(answer).collect();
            let world = wind_direction(manifest);
            let towards = p.places.iter().map(|m| (DMat3::from_mat4(*m).transpose() * world).normalize_or_zero());
            let towards = towards.collect();
            let seed = wind.seed.wrapping_add((1 + index as u64) << 40);
            sways_somewhere[index].then(|| {
                let sections = Sections::new(p, first);
                first = sections.end();
                let kind = manifest.plants[index].flutter.as_ref().and_then(|f| flutters.iter().position(|g| *g == f));
                let flutter = kind.map(|kind| Fluttering::new(gusts[kind].clone(), world, p));
                Swaying { limbs, answers, sections, flutter, towards, seed }
            })
        });
        let plants: Vec<Option<Swaying>> = plants.collect();
        bounded(manifest, planted, &plants)?;
        Ok(Some(Winds { plants, motions, gusts, last: Mutex::default() }))
    }

    /// Amplitude of a branch towards r and s of its limb, at a place and a time (s).
    fn amplitude(&self, plant: &Swaying, place: usize, branch: usize, time: f64) -> [f64; 2] {
        let Some(answer) = &plant.answers[branch] else { return [0.0; 2] };
        let (limb, motion) = (&plant.limbs.0[branch], &self.motions[answer.texture]);
        let [_, r, s] = limb.axes;
        let still = answer.sway.steady(plant.towards[place].to_array(), r.to_array(), s.to_array());
        let seed = plant.seed.wrapping_add(((place as u64) << 20) + 1 + branch as u64);
        let gust = motion.sample(motion.trajectory(seed, answer.faster).at(time));
        [0, 1].map(|c| still[c] / limb.tip + answer.gain * gust[c])
    }

    /// The pose of a plant at one of its places and a time (s), in its own frame; `None` where no wind moves it.
    pub fn pose(&self, plant: usize, place: usize, time: f64) -> Option<Pose<'_>> {
        let swaying = self.plants.get(plant)?.as_ref()?;
        let pose = swaying.limbs.pose(|branch| self.amplitude(swaying, place, branch, time));
        Some(match &swaying.flutter {
            Some(flutter) => pose.with_leaves(flutter.turns(place, time)),
            None => pose,
        })
    }
}

/// All kinds of flutter of a scene, each once.
fn flutters<'a>(
    manifest: &'a Manifest,
    planted: &[Planted],
    sways: &[Vec<Option<(Sway, f64)>>],
) -> Result<Vec<&'a Flutter>> {
    let mut out: Vec<&Flutter> = Vec::new();
    for (k, ((said, one), sways)) in manifest.plants.iter().zip(planted).zip(sways).enumerate() {
        let Some(flutter) = said.flutter.as_ref().filter(|_| !one.plant.leaves.is_empty()) else { continue };
        if sways.iter().all(Option::is_none) {
            let what = "leaves cannot flutter where no branch sways; expected branches with a length and a mass";
            return Err(Error::field(&manifest.path, &format!("plant {}: flutter", k + 1), what));
        }
        if !out.contains(&flutter) {
            out.push(flutter);
        }
    }
    Ok(out)
}

/// Refuses too many cross-sections and vertices of bark before any of them are made.
fn bounded(manifest: &Manifest, planted: &[Planted], plants: &[Option<Swaying>]) -> Result<()> {
    let mut bark = 0usize;
    for (k, (one, swaying)) in planted.iter().zip(plants).enumerate() {
        let Some(swaying) = swaying else { continue };
        let wood: usize = one.plant.branches.iter().map(|b| b.wood.positions.len()).sum();
        bark = bark.saturating_add(wood.saturating_mul(one.places.len()));
        let sections = swaying.sections.end();
        if sections > MOST_SECTIONS || bark > MOST_BARK {
            let found =
                format!("plants in the wind with {sections} cross-sections and {bark} vertices of bark up to here");
            let expected = format!("at most {MOST_SECTIONS} and {MOST_BARK}");
            return Err(Error::unexpected(&manifest.path, &format!("plant {}: count", k + 1), found, expected));
        }
    }
    Ok(())
}

/// Number of times whose sections are kept. A scene has few views.
const KEPT: usize = 4;

impl Winds {
    /// Number of sections of all plants together.
    pub fn section_count(&self) -> usize {
        self.plants.iter().flatten().map(|s| s.sections.end()).max().unwrap_or(0)
    }

    /// All sections of all plants at a time (s), in world space.
    pub fn sections(&self, time: f64) -> Arc<Vec<Rigid>> {
        let known = |last: &Vec<(f64, Arc<Vec<Rigid>>)>| last.iter().find(|l| l.0 == time).map(|l| l.1.clone());
        if let Some(found) = self.last.lock().ok().and_then(|last| known(&last)) {
            return found;
        }
        let of_place = |(plant, place): (usize, usize)| {
            let (swaying, pose) = (self.plants[plant].as_ref(), self.pose(plant, place, time));
            swaying.zip(pose).map_or_else(Vec::new, |(s, pose)| s.sections.at(place, &pose))
        };
        let places = |(k, s): (usize, &Option<Swaying>)| {
            (0..s.as_ref().map_or(0, |s| s.towards.len())).map(move |place| (k, place)).collect::<Vec<_>>()
        };
        let all: Vec<(usize, usize)> = self.plants.iter().enumerate().flat_map(places).collect();
        let parts: Vec<Vec<Rigid>> = all.into_par_iter().map(of_place).collect();
        let made = Arc::new(parts.concat());
        if let Ok(mut last) = self.last.lock() {
            last.truncate(KEPT - 1);
            last.insert(0, (time, made.clone()));
        }
        made
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::f64::consts::TAU;

    pub fn scene(speed: f64) -> (Manifest, Vec<Planted>) {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/scenes/plant.toml");
        let mut manifest = Manifest::read(&root).unwrap();
        manifest.wind = Some(mesophyll_manifest::Wind {
            speed_m_s: speed,
            azimuth_deg: 30.0,
            turbulence: 0.3,
            seed: 7,
            time_s: 0.0,
        });
        let planted = super::super::plant::planted(&manifest, &Ledger::new()).unwrap();
        (manifest, planted)
    }

    fn winds(speed: f64) -> (Vec<Planted>, Winds) {
        let (manifest, planted) = scene(speed);
        let winds = Winds::new(&manifest, &planted, &Ledger::new()).unwrap().unwrap();
        println!("{} textures", winds.motions.len());
        (planted, winds)
    }

    /// The spectrum of every branch's deflection over three thousand periods, by a discrete Fourier transform of
    /// segments, agrees with the formula. Bands are at least a quarter octave wide, from a tenth of the resonance to
    /// one and a half times it.
    #[test]
    fn branches_have_the_spectra_of_their_own_resonance() {
        let (_, winds) = winds(4.0);
        let plant = winds.plants[0].as_ref().unwrap();
        let most = plant.answers.iter().flatten().map(|a| (a.faster - 1.0).abs()).fold(0.0, f64::max);
        assert!(most > 0.02 && most < 0.06, "{most}");
        let mut worst = 0.0f64;
        for k in [0, 14, 33] {
            let answer = plant.answers[k].as_ref().unwrap();
            let (f_h, tip) = (answer.sway.oscillator.resonance, plant.limbs.0[k].tip);
            // 128 segments of 512 readings, with eight readings in a period.
            let (dt, segment) = (0.125 / f_h, 512);
            let still = {
                let [_, r, s] = plant.limbs.0[k].axes.map(|v| v.to_array());
                answer.sway.steady(plant.towards[0].to_array(), r, s)
            };
            let readings: Vec<[f64; 2]> = (0..128 * segment)
                .map(|n| {
                    let a = winds.amplitude(plant, 0, k, 50.0 + n as f64 * dt);
                    [0, 1].map(|c| a[c] * tip - still[c])
                })
                .collect();
            let step = 1.0 / (segment as f64 * dt);
            for band in [[6, 12], [12, 24], [24, 44], [44, 60], [60, 70], [70, 96]] {
                let (mut have, mut want) = (0.0, 0.0);
                for bin in band[0]..band[1] {
                    let f = f64::from(bin) * step;
                    want += answer.sway.spectrum(f);
                    for part in readings.chunks(segment) {
                        for c in 0..2 {
                            let (mut re, mut im) = (0.0, 0.0);
                            let (sin, cos) = (TAU * f * dt).sin_cos();
                            let (mut x, mut y) = (1.0, 0.0);
                            for (n, v) in part.iter().enumerate() {
                                let window = (std::f64::consts::PI * n as f64 / segment as f64).sin().powi(2);
                                re += window * v[c] * x;
                                im += window * v[c] * y;
                                (x, y) = (x * cos - y * sin, x * sin + y * cos);
                            }
                            // Hann's window keeps 3/8 of the power.
                            have += 2.0 * dt * (re * re + im * im) / (0.375 * segment as f64) / 256.0;
                        }
                    }
                }
                // There are at least 6 bins of 256 values each, half of them independent, so a standard deviation is at
                // most 4 %. The texture's other resonance changes the spectrum by 4 %.
                worst = worst.max((have / want - 1.0).abs());
            }
        }
        println!("bands are off by {:.3} at most", worst);
        assert!(worst < 0.16, "{worst}");
    }

    /// Plants with the same flutter share textures. Too many kinds, and leaves on still branches, are refused.
    #[test]
    fn kinds_of_flutter_are_counted() {
        let (mut manifest, mut planted) = scene(4.0);
        let said = |k: usize| Some(Flutter { deg_per_m_s: 4.0, resonance_hz: 4.0 + 0.01 * k as f64, damping: 0.3 });
        manifest.plants[0].flutter = said(0);
        manifest.plants = vec![manifest.plants[0].clone(); 22];
        let one = planted.remove(0);
        planted = vec![one; 22];
        let winds = Winds::new(&manifest, &planted, &Ledger::new()).unwrap().unwrap();
        assert_eq!(winds.gusts.len(), 1);
        assert!(winds.plants.iter().flatten().all(|p| p.flutter.is_some()));
        (0..22).for_each(|k| manifest.plants[k].flutter = said(k));
        let error = Winds::new(&manifest, &planted, &Ledger::new()).unwrap_err().to_string();
        assert!(error.contains("and of 66 for the flutter of leaves, expected at most 64 in all"), "{error}");
        manifest.plants[0].drag_n_s_m3 = 0.0;
        let error = Winds::new(&manifest, &planted, &Ledger::new()).unwrap_err().to_string();
        assert!(error.contains("plant 1: flutter: leaves cannot flutter where no branch sways"), "{error}");
    }

    #[test]
    fn storms_and_far_times_have_a_pose() {
        let (planted, winds) = winds(60.0);
        for time in [3.0, 1e6, -1e6] {
            let pose = winds.pose(0, 0, time).unwrap();
            let posed = pose.plant(&planted[0].plant);
            for (rest, now) in planted[0].plant.branches.iter().zip(&posed.branches) {
                assert!((now.length() / rest.length() - 1.0).abs() < 1e-5, "{time} {}", rest.name);
            }
            // In a hundredth of a second, no tip moves by a fifth of the plant.
            let next = winds.pose(0, 0, time + 0.01).unwrap();
            assert!((0..posed.branches.len()).all(|k| pose.tip(k).distance(next.tip(k)) < 240.0), "{time}");
        }
        assert!(winds.pose(1, 0, 0.0).is_none());
    }
}
