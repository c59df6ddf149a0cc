//! How the scene's plants move: what every branch carries, how far its load and the wind move it, and when.
//!
//! A branch is an oscillator ([`crate::placed::sway`]). The wind's force on everything that it carries is proportional
//! to the wind's speed (Eq. 4.19). Gusts come from motion textures. H9 has one for each level of branching, and a
//! branch with another resonance runs faster through it. The branch's spectrum would then be right only if the wind's
//! spectrum were a power of the frequency, which it is not. Here, branches share a texture if their resonances are
//! within [`crate::placed::sway::ALIKE`] of each other, whatever their level.

mod limits;

use crate::manifest::{SceneManifest, StatedFlutter};
use crate::placed::flutter::{FlutterGusts, PlacedFlutter, TEXTURES};
use crate::placed::groups::PlantGroups;
use crate::placed::ledger::Ledger;
use crate::placed::plant::PlacedPlant;
use crate::placed::sections::PlantSections;
use crate::placed::sway::{MOTION_SIDE, alike, leads, sways, variance};
use crate::placed::{Error, Result};
use glam::{DMat3, DMat4, DVec3};
use limits::{bounded, flutters, held};
use mesophyll_fits::branch::beam::basis;
use mesophyll_plants::form::Branch;
use mesophyll_plants::mechanics::motion::{MotionTexture, TextureCell, Trajectory};
use mesophyll_plants::mechanics::motion_spectrum::SpectrumMethod;
use mesophyll_plants::mechanics::wind::{Sway, Wind};
use mesophyll_plants::pose::{self, LengthConstraint, Limb, Pose, RestPose, RigidMotion};
use rayon::prelude::*;
use std::sync::{Arc, Mutex};

/// How one branch responds to the wind.
#[derive(Debug, Clone, PartialEq)]
pub struct WindResponse {
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

/// A `[[plant]]` that moves, with all its places.
#[derive(Debug)]
pub struct SwayingPlant {
    /// Its branches, in the plant's frame.
    pub limbs: RestPose,
    /// The response of each branch; `None` for one without length.
    pub answers: Vec<Option<WindResponse>>,
    /// The sections that carry its leaves and its bark.
    pub sections: PlantSections,
    /// How its leaves flutter; `None` where the scene states no flutter.
    pub flutter: Option<PlacedFlutter>,
    /// For each branch, the amplitude of its stated load if it were horizontal.
    loads: Vec<f64>,
    /// For each pose, the direction that the wind blows to, and the world's up; in the plant's frame.
    towards: Vec<[DVec3; 2]>,
    /// How its plants share poses; `None` where each place has its own.
    groups: Option<PlantGroups>,
    seed: u64,
}

/// What bends a branch at one place.
struct Swing {
    /// The amplitude by its stated load.
    weight: [f64; 2],
    gusts: Option<Gusty>,
}

/// The wind's part of it.
struct Gusty {
    /// The amplitude in a wind without gusts.
    steady: [f64; 2],
    /// The motion texture, the line through it, and the amplitude for 1 in it.
    texture: usize,
    gain: f64,
    line: Trajectory,
    /// The time after which the gusts arrive (s).
    delay: f64,
}

impl Swing {
    /// Amplitude of a branch towards r and s of its limb where the motion texture has the value `gust`.
    fn amplitude(&self, gust: [f64; 2]) -> [f64; 2] {
        let Some(Gusty { steady, gain, .. }) = &self.gusts else { return self.weight };
        [0, 1].map(|c| self.weight[c] + (steady[c] + gain * gust[c]))
    }
}

/// The number of branches whose amplitudes are worth a thread of their own. For fewer, to wake another takes as long.
const SWINGS: usize = 2048;

/// The largest number of motion textures (8 MB each) of branches and leaves. More are more likely an error of a file
/// than a real plant.
const MOST_TEXTURES: usize = 64;
/// All sections of all plants at a time (s).
#[derive(Debug)]
struct PosedSections {
    lengths: LengthConstraint,
    time: f64,
    sections: Arc<Vec<RigidMotion>>,
}

/// All plants of a scene that move: in its wind, and by loads that the scene states.
#[derive(Debug)]
pub struct SwayingPlants {
    /// The plants, in the manifest's order; `None` for a plant that nothing moves.
    pub plants: Vec<Option<SwayingPlant>>,
    /// The motion textures.
    pub motions: Vec<MotionTexture>,
    /// The gusts for leaves, for each kind of flutter.
    pub gusts: Vec<Arc<FlutterGusts>>,
    /// The places of plants that share poses and are near to the cameras, one `[[plant]]` after the other.
    pub frames: Vec<DMat4>,
    /// The sections at the last times that were requested.
    last: Mutex<Vec<PosedSections>>,
}

impl SwayingPlants {
    /// How the plants move; `None` where none does.
    ///
    /// # Errors
    /// [`Error::Input`] where a stated load bends a branch too far, where a sway or a flutter has no spectrum, where
    /// leaves should flutter on branches that do not sway, and for too many textures, cross-sections or vertices of
    /// bark.
    pub fn new(manifest: &SceneManifest, planted: &[PlacedPlant], ledger: &Ledger) -> Result<Option<SwayingPlants>> {
        let wind = manifest.wind.as_ref().filter(|w| w.speed_m_s > 0.0);
        let seed = wind.map_or(0, |w| w.seed);
        let mean = wind
            .map_or(Wind { speed: 0.0, turbulence: 0.0 }, |w| Wind { speed: w.speed_m_s, turbulence: w.turbulence });
        let sways: Vec<Vec<Option<(Sway, f64)>>> =
            manifest.plants.iter().zip(planted).map(|(said, p)| sways(said, mean, &p.plant)).collect();
        let flutters = if wind.is_some() { flutters(manifest, planted, &sways)? } else { Vec::new() };
        let loaded = |p: &PlacedPlant| p.plant.branches.iter().any(|b| b.bending_load != 0.0);
        let moves: Vec<bool> =
            planted.iter().zip(&sways).map(|(p, of)| loaded(p) || of.iter().any(Option::is_some)).collect();
        if !moves.contains(&true) {
            return Ok(None);
        }
        // The coefficients of all tapers are fitted at most once during a run of the program.
        if ledger.count("fit", "beam") == 0 {
            ledger.note("fit", "beam", 0, basis::smooth);
        }
        let leads = leads(sways.iter().flatten().flatten().map(|(sway, _)| *sway).collect());
        let of_leaves = TEXTURES * flutters.len();
        if leads.len() + of_leaves > MOST_TEXTURES {
            let what = format!(
                "a need of {} motion textures for the sway of branches, whose resonances and dampings differ so much, \
                 and of {of_leaves} for the flutter of leaves",
                leads.len()
            );
            let expected = format!(
                "at most {MOST_TEXTURES} in all; resonances follow from lengths (mm, times `scale`) or are stated, and \
                 plants whose `flutter` is the same share textures"
            );
            return Err(Error::unexpected(&manifest.path, "plant", what, expected));
        }
        let bytes = (leads.len() * MOTION_SIDE * MOTION_SIDE * 8) as u64;
        let make = |(k, lead): (usize, &Sway)| {
            let seed = seed.wrapping_add((k as u64) << 48);
            MotionTexture::new(|f| lead.spectrum(f), lead.highest(), MOTION_SIDE, seed, SpectrumMethod::Directed)
        };
        let all = || leads.par_iter().enumerate().map(make).collect::<Option<Vec<MotionTexture>>>();
        let made = match leads.is_empty() {
            true => Some(Vec::new()),
            false => ledger.note("make", "motion texture", bytes, all),
        };
        let motions = made.ok_or_else(|| {
            Error::field(&manifest.path, "wind", "the plants' sway has no spectrum that is positive and finite")
        })?;
        let of_kind = |(k, said): (usize, &&StatedFlutter)| {
            let seed = seed.wrapping_add((1 + k as u64) << 40);
            let what = "the leaves' flutter has no spectrum that is positive and finite";
            FlutterGusts::new(said, mean, seed, ledger)
                .map(Arc::new)
                .ok_or_else(|| Error::field(&manifest.path, "plant", what))
        };
        let gusts: Vec<Arc<FlutterGusts>> = flutters.iter().enumerate().map(of_kind).collect::<Result<_>>()?;
        let mut first = 0;
        let of_lead: Vec<f64> = leads.iter().map(variance).collect();
        let plants = planted.iter().zip(sways).enumerate().map(|(index, (p, sways))| {
            let limbs = RestPose::new(&p.plant, basis::shape);
            let answer = |(k, sway): (usize, Option<(Sway, f64)>)| {
                let ((sway, mass), limb) = (sway?, &limbs.0[k]);
                let texture = leads.iter().position(|lead| alike(lead, &sway))?;
                let faster = sway.oscillator.resonance / leads[texture].oscillator.resonance;
                let gain = (variance(&sway) / of_lead[texture]).sqrt() / limb.tip;
                Some(WindResponse { sway, mass, texture, faster, gain })
            };
            let answers = sways.into_iter().enumerate().map(answer).collect();
            let world = wind.map_or(DVec3::X, crate::manifest::SceneWind::direction);
            let own = |m: &DMat4, v: DVec3| (DMat3::from_mat4(*m).transpose() * v).normalize_or_zero();
            let leaders = p.groups.as_ref().map_or(&p.places, |groups| &groups.leaders);
            let towards = leaders.iter().map(|m| [own(m, world), own(m, DVec3::Z)]).collect();
            let load = |(b, limb): (&Branch, &Limb)| if limb.length > 0.0 { b.bending_load / limb.length } else { 0.0 };
            let loads = p.plant.branches.iter().zip(&limbs.0).map(load).collect();
            let seed = seed.wrapping_add((1 + index as u64) << 40);
            moves[index].then(|| {
                let sections = PlantSections::new(p, first);
                first = sections.end();
                let kind = manifest.plants[index].flutter.as_ref().and_then(|f| flutters.iter().position(|g| *g == f));
                let flutter = kind.map(|kind| PlacedFlutter::new(gusts[kind].clone(), world, p));
                let groups = p.groups.clone();
                SwayingPlant { limbs, answers, sections, flutter, loads, towards, groups, seed }
            })
        });
        let plants: Vec<Option<SwayingPlant>> = plants.collect();
        bounded(manifest, planted, &plants)?;
        held(manifest, planted, &plants)?;
        let near = |p: &PlacedPlant| -> Vec<DMat4> {
            p.groups.iter().flat_map(|g| g.near.iter().map(|place| p.places[*place])).collect()
        };
        let frames = planted.iter().flat_map(near).collect();
        Ok(Some(SwayingPlants { plants, motions, gusts, frames, last: Mutex::default() }))
    }

    /// Whether anything moves with time. Where it does not, plants are only bent by their loads.
    pub fn sways(&self) -> bool {
        !self.motions.is_empty()
    }

    /// The pose of a plant at one of its places under its loads alone, without a wind; `None` where nothing moves it.
    pub fn loaded(&self, plant: usize, place: usize) -> Option<Pose<'_>> {
        let swaying = self.plants.get(plant)?.as_ref()?;
        let place = swaying.pose_of(place);
        Some(swaying.limbs.pose(|branch| swaying.weight(place, branch)))
    }

    /// What bends a branch at a place, which is one of the poses where plants share them.
    fn swing(&self, plant: &SwayingPlant, place: usize, branch: usize) -> Swing {
        let weight = plant.weight(place, branch);
        let Some(answer) = &plant.answers[branch] else { return Swing { weight, gusts: None } };
        let (limb, motion) = (&plant.limbs.0[branch], &self.motions[answer.texture]);
        let [_, r, s] = limb.axes;
        let still = answer.sway.steady(plant.towards[place][0].to_array(), r.to_array(), s.to_array());
        // Groups have the same gusts, one after the other.
        let (own, delay) = plant.groups.as_ref().map_or((place, 0.0), |groups| (0, groups.delays[place]));
        let seed = plant.seed.wrapping_add(((own as u64) << 20) + 1 + branch as u64);
        let line = motion.trajectory(seed, answer.faster);
        let steady = still.map(|c| c / limb.tip);
        Swing { weight, gusts: Some(Gusty { steady, texture: answer.texture, gain: answer.gain, line, delay }) }
    }

    /// Amplitude of a branch towards r and s of its limb at a time (s).
    fn amplitude(&self, swing: &Swing, time: f64) -> [f64; 2] {
        let gust = |of: &Gusty| self.motions[of.texture].sample(of.line.at(time - of.delay));
        swing.amplitude(swing.gusts.as_ref().map_or([0.0; 2], gust))
    }

    /// The amplitude towards r and s of every branch of every plant at every place, as poses hold it ([`pose::held`]).
    /// The branches of a plant follow each other, place after place. What does not change with time is worked out once.
    pub fn amplitudes(self: &Arc<SwayingPlants>) -> impl Fn(f64) -> Vec<[f32; 2]> + Send + Sync + use<> {
        let winds = self.clone();
        let of = |(_, swaying, place): (usize, &SwayingPlant, usize)| -> Vec<(Swing, f64)> {
            let limbs = swaying.limbs.0.iter().enumerate();
            limbs.map(|(k, limb)| (self.swing(swaying, place, k), limb.beam_tip())).collect()
        };
        let swings: Vec<(Swing, f64)> = self.places().flat_map(of).collect();
        move |time| swings.par_chunks(SWINGS).flat_map_iter(|some| winds.amplitudes_of(some, time)).collect()
    }

    /// The amplitudes at a time of some branches, each of which comes with its [`Limb::beam_tip`]. First the place of
    /// every texel is worked out, then all texels are read. A texture is larger than the cache, so each reading waits
    /// for memory; side by side they wait together.
    fn amplitudes_of(&self, swings: &[(Swing, f64)], time: f64) -> Vec<[f32; 2]> {
        let cell = |(swing, _): &(Swing, f64)| {
            let of = swing.gusts.as_ref()?;
            Some((&self.motions[of.texture], self.motions[of.texture].cell(of.line.at(time - of.delay))))
        };
        let cells: Vec<Option<(&MotionTexture, TextureCell)>> = swings.iter().map(cell).collect();
        let texels = |of: &Option<(&MotionTexture, TextureCell)>| of.as_ref().map(|(motion, cell)| motion.texels(cell));
        let texels: Vec<Option<[[f32; 2]; 4]>> = cells.iter().map(texels).collect();
        let gusts = cells.iter().zip(&texels).map(|both| match both {
            (Some((_, cell)), Some(texels)) => cell.between(texels),
            _ => [0.0; 2],
        });
        let one =
            |((swing, tip), gust): (&(Swing, f64), [f64; 2])| pose::held(swing.amplitude(gust), *tip).map(|c| c as f32);
        swings.iter().zip(gusts).map(one).collect()
    }

    /// Every plant that moves at each of its places: its index, the plant, and the index of the place. Of plants that
    /// share poses, each pose counts as a place.
    pub fn places(&self) -> impl Iterator<Item = (usize, &SwayingPlant, usize)> {
        let plants = self.plants.iter().enumerate().filter_map(|(k, plant)| Some((k, plant.as_ref()?)));
        plants.flat_map(|(k, plant)| (0..plant.towards.len()).map(move |place| (k, plant, place)))
    }

    /// The pose of a plant at one of its places and a time (s), in its own frame; `None` where nothing moves it.
    pub fn pose(&self, plant: usize, place: usize, time: f64) -> Option<Pose<'_>> {
        let pose = self.plants.get(plant)?.as_ref()?.pose_of(place);
        self.pose_with(LengthConstraint::Kept, plant, pose, time)
    }

    fn pose_with(&self, lengths: LengthConstraint, plant: usize, place: usize, time: f64) -> Option<Pose<'_>> {
        let swaying = self.plants.get(plant)?.as_ref()?;
        let amplitude = |branch| self.amplitude(&self.swing(swaying, place, branch), time);
        let pose = swaying.limbs.pose_with(lengths, amplitude);
        Some(match &swaying.flutter {
            Some(flutter) => pose.with_leaves(flutter.turns(place, time)),
            None => pose,
        })
    }
}

impl SwayingPlant {
    /// The pose of a place: its number among the poses that plants share, or the place itself.
    pub fn pose_of(&self, place: usize) -> usize {
        self.groups.as_ref().map_or(place, |groups| groups.of_place[place] as usize)
    }

    /// Number of poses.
    pub fn poses(&self) -> usize {
        self.towards.len()
    }

    /// Amplitude of a branch towards r and s of its limb by its stated load. Only the part of the weight across the
    /// branch bends it.
    fn weight(&self, place: usize, branch: usize) -> [f64; 2] {
        let [_, r, s] = self.limbs.0[branch].axes;
        [r, s].map(|across| -across.dot(self.towards[place][1]) * self.loads[branch])
    }
}

/// Number of times whose sections are kept. A scene has few views.
const KEPT: usize = 4;

impl SwayingPlants {
    /// Number of sections of all plants together.
    pub fn section_count(&self) -> usize {
        self.plants.iter().flatten().map(|s| s.sections.end()).max().unwrap_or(0)
    }

    /// All sections of all plants at a time (s), in world space.
    pub fn sections(&self, time: f64) -> Arc<Vec<RigidMotion>> {
        self.sections_with(LengthConstraint::Kept, time)
    }

    /// The same, with lengths of branches kept in this way.
    pub fn sections_with(&self, lengths: LengthConstraint, time: f64) -> Arc<Vec<RigidMotion>> {
        let same = |l: &&PosedSections| (l.lengths, l.time) == (lengths, time);
        let known = |last: &Vec<PosedSections>| last.iter().find(same).map(|l| l.sections.clone());
        if let Some(found) = self.last.lock().ok().and_then(|last| known(&last)) {
            return found;
        }
        let of_place = |(plant, swaying, place): (usize, &SwayingPlant, usize)| {
            let pose = self.pose_with(lengths, plant, place, time);
            pose.map_or_else(Vec::new, |pose| swaying.sections.at(place, &pose))
        };
        let all: Vec<(usize, &SwayingPlant, usize)> = self.places().collect();
        let parts: Vec<Vec<RigidMotion>> = all.into_par_iter().map(of_place).collect();
        let made = Arc::new(parts.concat());
        if let Ok(mut last) = self.last.lock() {
            last.truncate(KEPT - 1);
            last.insert(0, PosedSections { lengths, time, sections: made.clone() });
        }
        made
    }
}

#[cfg(test)]
pub(crate) mod tests;
