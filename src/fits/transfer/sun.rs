//! Sharp sunlight: the share of the sun's disk that each vertex of a scene sees, computed beforehand for every place
//! where the sun will stand (light-visibility convolution: Wang et al. 2005, §4).
//!
//! The meshes are refined for this, so that a penumbra covers several vertices. The rest of the transfer then uses the
//! finer meshes too. They are the same surfaces.

use crate::transfer::TransferScene;
use glam::DVec3;
use mesophyll_base::error::{Error, Result};
use mesophyll_files::hash;
use mesophyll_transport::visibility::{
    AreaLight, CodedMaps, MapCollector, ShadowDirections, ShadowReceivers, ShadowScene,
};
use mesophyll_transport::world::ReferenceWorld;
use std::path::Path;
use std::sync::{Arc, mpsc};

/// The file of all maps.
pub const SUN: &str = "sun.visibility";

/// Number of points that represent the sun's disk. Their mean has an error of .013 in penumbras
/// (docs/evidence/visibility.md).
const POINTS: usize = 64;
/// Edges of wood may be longer than those of leaves by this factor, because wood is a small part of the picture.
const WOOD: f64 = 4.0;

/// A sun whose shadows are computed beforehand.
#[derive(Debug, Clone)]
pub struct TransferSun {
    /// The points at which its light is known: the vertices of the finer meshes.
    pub receivers: Arc<ShadowReceivers>,
    light: AreaLight,
    directions: ShadowDirections,
    /// Angular radius (rad).
    radius: f64,
}

/// Maps that were read from a file.
#[derive(Debug, Clone)]
pub struct SunShadowMaps {
    /// The points at which the sun's light is known: the vertices of the finer meshes.
    pub receivers: Arc<ShadowReceivers>,
    /// The share of the sun that each point sees, for every place of the sun.
    pub maps: CodedMaps,
    light: AreaLight,
}

/// Maps for a sun that moves freely. A thread makes them while the previous picture is still shown. It starts when the
/// sun first moves.
#[derive(Debug)]
pub struct FreeSun {
    world: Arc<ReferenceWorld>,
    receivers: Arc<ShadowReceivers>,
    light: AreaLight,
    thread: Thread,
    /// The direction that was asked for last.
    wanted: DVec3,
    /// Whether its map has not arrived yet.
    waiting: bool,
}

#[derive(Debug)]
enum Thread {
    NotYet,
    /// The thread takes the sun's direction, and returns it together with its map or the reason why there is none. The
    /// thread ends when nobody can ask any more.
    Runs(mpsc::Sender<DVec3>, mpsc::Receiver<Result<(DVec3, Vec<u8>)>>),
    /// No map can be made, and this has been reported.
    Failed,
}

impl TransferScene {
    /// The scene with meshes whose edges are at most `edge_mm` long, and with a sun of angular `radius` (rad) whose
    /// shadows are computed for these directions towards the sun. The ground is not refined: a shadow on it is too
    /// small for vertices.
    ///
    /// # Errors
    /// [`Error::Usage`] for an empty list of directions, or for a radius that no sun has; [`Error::Input`] for discs,
    /// and for edges so short that the machine lacks the memory.
    pub fn under_sun(self, radius: f64, directions: &[DVec3], edge_mm: f64) -> Result<TransferScene> {
        let ground = self.world.ground.map(|k| self.world.instances[k].leaf);
        let edge = |k: usize| match k {
            _ if Some(k) == ground => f64::INFINITY,
            k if k < self.leaves => edge_mm,
            _ => WOOD * edge_mm,
        };
        let edges: Vec<f64> = (0..self.world.leaves.len()).map(edge).collect();
        let receivers = ShadowReceivers::new(&self.world, &edges)?;
        let mut world = ReferenceWorld::clone(&self.world);
        for (k, leaf) in world.leaves.iter_mut().enumerate().filter(|(k, _)| Some(*k) != ground) {
            leaf.mesh = receivers.blades[k].mesh.clone();
        }
        let sun = TransferSun {
            receivers: Arc::new(receivers),
            light: AreaLight::disk(radius, POINTS)?,
            directions: ShadowDirections::arc(directions)?,
            radius,
        };
        Ok(TransferScene { world: Arc::new(world), sun: Some(sun), ..self })
    }
}

impl TransferSun {
    /// The hash of everything that decides the maps, except the scene's meshes and places.
    pub(crate) fn hash(&self) -> String {
        let numbers = self.directions.list().iter().flat_map(|d| d.to_array()).chain([self.radius]);
        let bytes: Vec<u8> = numbers.flat_map(f64::to_le_bytes).collect();
        format!("{} points, {} receivers, {}", self.light.len(), self.receivers.len(), hash::bytes(&bytes))
    }

    /// Computes the maps of a world.
    ///
    /// # Errors
    /// [`Error::Interrupted`] after Ctrl-C.
    pub(crate) fn maps(&self, world: &ReferenceWorld) -> Result<CodedMaps> {
        let mut maps = MapCollector::new(self.receivers.len());
        let shadows = ShadowScene::new(world, &self.receivers, &self.light)?;
        shadows.maps(self.directions.list(), |_, map| maps.push(map))?;
        maps.finish(self.directions.clone())
    }

    /// Reads the maps that a fit wrote.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that is missing, damaged, or of another scene.
    pub(crate) fn read(&self, path: &Path) -> Result<SunShadowMaps> {
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
        Ok(SunShadowMaps { receivers: self.receivers.clone(), maps, light: self.light.clone() })
    }
}

impl SunShadowMaps {
    /// 255 times the share of the sun that every vertex sees, for a sun in this direction, instance by instance.
    ///
    /// # Errors
    /// [`Error::Usage`] for maps that cannot be decoded.
    pub fn shares(&self, towards_sun: DVec3) -> Result<Vec<u8>> {
        let mut out = vec![0; self.receivers.len()];
        self.maps.between(towards_sun, &mut out)?;
        Ok(out)
    }

    /// Prepares maps for every place that the sun is moved to. `world` is the one that these maps belong to. `shown` is
    /// the sun's direction in the map that is drawn now, as the very numbers that [`FreeSun::follow`] will get.
    pub fn live(&self, world: Arc<ReferenceWorld>, shown: DVec3) -> FreeSun {
        let (receivers, light) = (self.receivers.clone(), self.light.clone());
        FreeSun { world, receivers, light, thread: Thread::NotYet, wanted: shown, waiting: false }
    }
}

impl FreeSun {
    /// Asks for the map of a sun in this direction if the direction is new. Returns the last map that has arrived since
    /// the previous call: 255 times the share of the sun that every vertex sees, instance by instance.
    ///
    /// # Errors
    /// Reported once; after that no map is made any more. [`Error::Input`] for a world that contradicts itself,
    /// [`Error::Missed`] for a thread that ended by itself.
    pub fn follow(&mut self, towards_sun: DVec3) -> Result<Option<Vec<u8>>> {
        let found = self.ask(towards_sun);
        if found.is_err() {
            (self.thread, self.waiting) = (Thread::Failed, false);
        }
        found
    }

    fn ask(&mut self, towards_sun: DVec3) -> Result<Option<Vec<u8>>> {
        let moved = towards_sun != self.wanted;
        self.wanted = towards_sun;
        if moved && matches!(self.thread, Thread::NotYet) {
            self.thread = self.begin()?;
        }
        let Thread::Runs(ask, made) = &self.thread else { return Ok(None) };
        if moved {
            // If the thread has ended, its last answer says why.
            self.waiting = true;
            let _ = ask.send(towards_sun);
        }
        let mut last = None;
        loop {
            match made.try_recv() {
                Ok(found) => {
                    let (direction, map) = found?;
                    self.waiting &= direction != self.wanted;
                    last = Some(map);
                }
                Err(mpsc::TryRecvError::Empty) => return Ok(last),
                Err(mpsc::TryRecvError::Disconnected) => {
                    let why = "the thread that finds the sun's shadows ended: they stay where they are";
                    return Err(Error::Missed(why.into()));
                }
            }
        }
    }

    fn begin(&self) -> Result<Thread> {
        let (ask, asked) = mpsc::channel::<DVec3>();
        let (done, made) = mpsc::channel();
        let (world, receivers, light) = (self.world.clone(), self.receivers.clone(), self.light.clone());
        let work = move || {
            // If the sun moved on in the meantime, only its last place counts.
            let places = std::iter::from_fn(|| asked.recv().ok().map(|first| asked.try_iter().last().unwrap_or(first)));
            let follow = |shadows: ShadowScene| {
                shadows.follow(places, |direction, map| {
                    let nobody = |_| Error::Interrupted("nobody wants the maps any more".into());
                    done.send(Ok((direction, map.to_vec()))).map_err(nobody)
                })
            };
            if let Err(error) = ShadowScene::new(&world, &receivers, &light).and_then(follow) {
                let _ = done.send(Err(error));
            }
        };
        let named = std::thread::Builder::new().name("sun".into());
        let failed = |e| Error::Missed(format!("no thread for the sun's shadows: {e}"));
        named.spawn(work).map_err(failed)?;
        Ok(Thread::Runs(ask, made))
    }

    /// Whether the map of the sun that was asked for last is still being made.
    pub fn is_waiting(&self) -> bool {
        self.waiting
    }
}
