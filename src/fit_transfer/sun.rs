//! Sharp sunlight: which share of the sun's disk the vertices of a scene see, worked out beforehand for every place
//! where the sun will stand (light-visibility convolution: Wang et al. 2005, §4).
//!
//! The meshes are made finer for it, so that penumbras fit between vertices. Everything else of the transfer is then of
//! the finer meshes too: they are the same surfaces.

use crate::Scene;
use glam::DVec3;
use mesophyll_error::{Error, Result};
use mesophyll_files::hash;
use mesophyll_transport::visibility::{AreaLight, CodedMaps, Collector, Directions, Receivers, Shadows};
use mesophyll_transport::world::World;
use std::path::Path;
use std::sync::{Arc, mpsc};

/// The file of all maps.
pub const SUN: &str = "sun.visibility";

/// Points that stand for the sun's disk: their mean is off by .013 in penumbras (docs/visibility.md).
const POINTS: usize = 64;
/// Edges of wood may be this much longer than those of leaves: it is a small part of the picture.
const WOOD: f64 = 4.0;

/// A sun whose shadows are worked out beforehand.
#[derive(Debug, Clone)]
pub struct Sun {
    /// Where its light is known: the vertices of the finer meshes.
    pub receivers: Arc<Receivers>,
    light: AreaLight,
    directions: Directions,
    /// Angular radius (rad).
    radius: f64,
}

/// Maps that were read.
#[derive(Debug, Clone)]
pub struct SunMaps {
    /// Where its light is known: the vertices of the finer meshes.
    pub receivers: Arc<Receivers>,
    /// What share of it is seen there, for every place of the sun.
    pub maps: CodedMaps,
    light: AreaLight,
}

/// Maps of a sun that moves freely, made by a thread of their own while the picture before is still shown.
#[derive(Debug)]
pub struct LiveSun {
    /// Towards the sun of the map that is wanted next; the thread ends where nobody can ask any more.
    ask: mpsc::Sender<DVec3>,
    made: mpsc::Receiver<(DVec3, Vec<u8>)>,
    /// Asked for last.
    wanted: DVec3,
    /// How many that were asked for have not come.
    waiting: bool,
}

impl Scene {
    /// The scene with meshes whose edges are at most `edge_mm` long, and a sun of angular `radius` (rad) whose shadows
    /// are worked out for these directions towards it. The ground stays as it is: a shadow on it is too small for
    /// vertices.
    ///
    /// # Errors
    /// [`Error::Usage`] for no direction, or a radius that no sun has; [`Error::Input`] for discs, and for edges that
    /// are too short for the machine.
    pub fn under_sun(self, radius: f64, directions: &[DVec3], edge_mm: f64) -> Result<Scene> {
        let ground = self.world.ground.map(|k| self.world.instances[k].leaf);
        let edge = |k: usize| match k {
            _ if Some(k) == ground => f64::INFINITY,
            k if k < self.leaves => edge_mm,
            _ => WOOD * edge_mm,
        };
        let edges: Vec<f64> = (0..self.world.leaves.len()).map(edge).collect();
        let receivers = Receivers::new(&self.world, &edges)?;
        let mut world = World::clone(&self.world);
        for (k, leaf) in world.leaves.iter_mut().enumerate().filter(|(k, _)| Some(*k) != ground) {
            leaf.mesh = receivers.blades[k].mesh.clone();
        }
        let sun = Sun {
            receivers: Arc::new(receivers),
            light: AreaLight::disk(radius, POINTS)?,
            directions: Directions::arc(directions)?,
            radius,
        };
        Ok(Scene { world: Arc::new(world), sun: Some(sun), ..self })
    }
}

impl Sun {
    /// Everything that decides the maps beside the scene's meshes and places.
    pub(crate) fn hash(&self) -> String {
        let numbers = self.directions.list().iter().flat_map(|d| d.to_array()).chain([self.radius]);
        let bytes: Vec<u8> = numbers.flat_map(f64::to_le_bytes).collect();
        format!("{} points, {} receivers, {}", self.light.len(), self.receivers.len(), hash::bytes(&bytes))
    }

    /// The maps of a world.
    ///
    /// # Errors
    /// [`Error::Interrupted`] after Ctrl-C.
    pub(crate) fn maps(&self, world: &World) -> Result<CodedMaps> {
        let mut maps = Collector::new(self.receivers.len());
        let shadows = Shadows::new(world, &self.receivers, &self.light)?;
        shadows.maps(self.directions.list(), |_, map| maps.push(map))?;
        maps.finish(self.directions.clone())
    }

    /// Reads the maps that a fit wrote.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that is missing, damaged, or of another scene.
    pub(crate) fn read(&self, path: &Path) -> Result<SunMaps> {
        let maps = CodedMaps::read(path)?;
        if maps.receivers() != self.receivers.len() || maps.directions().len() != self.directions.len() {
            let (found, asked) = (maps.directions().len(), self.directions.len());
            let what = format!(
                "holds {found} maps of {} vertices, expected {asked} of {}",
                maps.receivers(),
                self.receivers.len()
            );
            return Err(Error::input(path, what));
        }
        Ok(SunMaps { receivers: self.receivers.clone(), maps, light: self.light.clone() })
    }
}

impl SunMaps {
    /// 255 times the share of the sun that every vertex sees, for a sun in this direction, instance by instance.
    ///
    /// # Errors
    /// [`Error::Usage`] for maps that cannot be decoded.
    pub fn shares(&self, towards_sun: DVec3) -> Result<Vec<u8>> {
        let mut out = vec![0; self.receivers.len()];
        self.maps.between(towards_sun, &mut out)?;
        Ok(out)
    }
}

impl SunMaps {
    /// Makes maps for wherever the sun is moved to; `world` is the one whose maps these are, and `shown` where the sun
    /// of the map stands that is drawn now.
    pub fn live(&self, world: Arc<World>, shown: DVec3) -> LiveSun {
        let (ask, asked) = mpsc::channel::<DVec3>();
        let (done, made) = mpsc::channel();
        let (receivers, light) = (self.receivers.clone(), self.light.clone());
        std::thread::spawn(move || {
            // A world that cannot be looked at has no maps either; the one that is drawn stays.
            let Ok(shadows) = Shadows::new(&world, &receivers, &light) else { return };
            while let Ok(mut direction) = asked.recv() {
                // Where the sun went on in the meantime, only its last place counts.
                while let Ok(later) = asked.try_recv() {
                    direction = later;
                }
                if done.send((direction, shadows.map(direction))).is_err() {
                    return;
                }
            }
        });
        LiveSun { ask, made, wanted: shown, waiting: false }
    }
}

impl LiveSun {
    /// Asks for the map of a sun in this direction, where it is another one, and gives the last map that has come since
    /// the call before: 255 times the share of the sun that every vertex sees, instance by instance.
    pub fn follow(&mut self, towards_sun: DVec3) -> Option<Vec<u8>> {
        if towards_sun != self.wanted {
            self.wanted = towards_sun;
            self.waiting = self.ask.send(towards_sun).is_ok();
        }
        let (direction, map) = self.made.try_iter().last()?;
        self.waiting &= direction != self.wanted;
        Some(map)
    }

    /// Whether the map of the sun that was asked for last is still being made.
    pub fn is_waiting(&self) -> bool {
        self.waiting
    }
}
