//! The world of a scene: what stands in it, where, of what, and what lights it, once for both renderers, in f64 and mm.
//!
//! A renderer adds what is its own. It reads the texels of materials, turns the sky into the form that it draws, and
//! makes what it needs to be fast. A lawn is in the world as its description alone, because one renderer draws its
//! blades and the other one slices.

use crate::loaded::{LoadedLeaf, LoadedScene};
use crate::manifest::{PictureSky, SceneManifest, UniformLeaf};
use crate::placed::PlacedScene;
use crate::placed::daylight::{Daylight, sun_disk};
use crate::placed::placement::LeafPlacement;
use crate::placed::sections::BarkMotion;
use crate::{Error, Result};
use glam::DMat4;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_fits::leaf_folder::LeafFit;
use mesophyll_transport::ReferenceSun;
use std::ops::Range;

/// Everything that stands in a scene at rest, and its lights.
pub struct SceneWorld<'a> {
    placed: &'a PlacedScene,
    /// The surfaces, each once, in the order in which renderers number them: leaves, wood, ground, wood of stands.
    pub surfaces: Vec<WorldSurface<'a>>,
    /// How many of the surfaces are leaves.
    pub leaves: usize,
    /// The surface of each of the manifest's leaves.
    surface_of: Vec<Option<usize>>,
    /// What lights it.
    pub lights: WorldLights<'a>,
}

/// A mesh and what it is made of.
pub struct WorldSurface<'a> {
    /// Its shape at rest.
    pub mesh: &'a LeafMesh,
    /// Its look.
    pub material: WorldMaterial<'a>,
    /// How a branch carries its vertices, where one does. The surface then stands at one place only.
    pub bark: Option<&'a BarkMotion>,
}

/// How a surface looks.
#[derive(Clone, Copy)]
pub enum WorldMaterial<'a> {
    /// A leaf by the maps of its fit.
    Fitted(LoadedLeaf<'a>, &'a LeafFit),
    /// A leaf that is the same everywhere, as the scene states it.
    Stated(LoadedLeaf<'a>, &'a UniformLeaf),
    /// Bark or ground: matte, and nothing comes through.
    Opaque {
        /// Its name in printed text.
        name: &'a str,
        /// Its reflectance.
        albedo: [f64; 3],
    },
}

/// A surface at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldInstance {
    /// Index of the surface.
    pub surface: usize,
    /// From the surface's own frame to the world.
    pub transform: DMat4,
    /// The section of a branch that carries it, by its number among those of the scene.
    pub section: Option<usize>,
}

/// What lights a scene.
#[derive(Debug)]
pub struct WorldLights<'a> {
    /// The sun as a disk.
    pub sun: Option<ReferenceSun>,
    /// The light all around.
    pub sky: WorldSky<'a>,
}

/// The light of a scene from all around.
#[derive(Debug)]
pub enum WorldSky<'a> {
    /// None.
    Dark,
    /// The same radiance from everywhere.
    Even([f64; 3]),
    /// A model's sky above the horizon, for the scene's sun.
    Physical(Box<Daylight>),
    /// A picture of everything around.
    Picture(&'a PictureSky),
}

impl<'a> WorldLights<'a> {
    /// The lights of a scene.
    ///
    /// # Errors
    /// [`Error::Input`] for a physical sky that the model refuses.
    pub fn of(manifest: &'a SceneManifest) -> Result<WorldLights<'a>> {
        let sky = match (Daylight::of(manifest)?, manifest.pictured(), manifest.even_sky()) {
            (Some(daylight), ..) => WorldSky::Physical(Box::new(daylight)),
            (_, Some(picture), _) => WorldSky::Picture(picture),
            (.., Some(radiance)) => WorldSky::Even(radiance),
            _ => WorldSky::Dark,
        };
        Ok(WorldLights { sun: sun_disk(manifest)?, sky })
    }
}

impl<'a> SceneWorld<'a> {
    /// The world of a scene.
    ///
    /// # Errors
    /// [`Error::Input`] for a leaf that is neither stated nor fitted yet, and as [`WorldLights::of`].
    pub fn new(scene: &'a LoadedScene) -> Result<SceneWorld<'a>> {
        let LoadedScene { manifest, placed, .. } = scene;
        let (mut surfaces, mut surface_of) = (Vec::new(), vec![None; placed.leaves.len()]);
        for leaf in scene.drawn() {
            let (Some(mesh), index) = (&leaf.placed.mesh, leaf.placed.index) else { continue };
            let material = match (leaf.config.uniform(), &leaf.placed.fitted) {
                (Some(stated), _) => WorldMaterial::Stated(leaf, stated),
                (None, Some(fit)) => WorldMaterial::Fitted(leaf, fit),
                (None, None) => {
                    let name = format!("leaf \"{}\"", leaf.config.name);
                    let what = "its maps are not made yet; `mesophyll run` makes them";
                    return Err(Error::field(&manifest.path, &name, what));
                }
            };
            surface_of[index] = Some(surfaces.len());
            surfaces.push(WorldSurface { mesh, material, bark: None });
        }
        let leaves = surfaces.len();
        surfaces.extend(placed.wood.iter().map(|wood| WorldSurface {
            mesh: &wood.mesh,
            material: WorldMaterial::Opaque { name: &wood.name, albedo: wood.bark },
            bark: wood.bark_moves.as_ref(),
        }));
        surfaces.extend(placed.ground.as_ref().map(|(mesh, albedo)| {
            let material = WorldMaterial::Opaque { name: "ground", albedo: *albedo };
            WorldSurface { mesh, material, bark: None }
        }));
        let of_stands = placed.stands.iter().flat_map(|stand| &stand.wood);
        surfaces.extend(of_stands.map(|wood| WorldSurface {
            mesh: &wood.mesh,
            material: WorldMaterial::Opaque { name: &wood.name, albedo: wood.bark },
            bark: wood.bark_moves.as_ref(),
        }));
        Ok(SceneWorld { placed, surfaces, leaves, surface_of, lights: WorldLights::of(manifest)? })
    }

    /// The index of the ground's surface.
    pub fn ground(&self) -> Option<usize> {
        self.placed.ground.as_ref().map(|_| self.leaves + self.placed.wood.len())
    }

    /// The leaves at their places at rest.
    pub fn standing_leaves(&self) -> impl Iterator<Item = WorldInstance> + '_ {
        self.placed.standing().filter_map(|p| self.leaf_at(p))
    }

    fn leaf_at(&self, p: &LeafPlacement) -> Option<WorldInstance> {
        let surface = self.surface_of[p.leaf]?;
        Some(WorldInstance { surface, transform: p.transform, section: p.section })
    }

    /// The leaves of the plant of a stand at rest, in the plant's frame.
    pub fn stand_leaves(&self, stand: usize) -> impl Iterator<Item = WorldInstance> + '_ {
        self.placed.stands[stand].leaves.iter().filter_map(|p| self.leaf_at(p))
    }

    /// The surfaces of the wood of the plant of a stand, which stands in the plant's frame.
    pub fn stand_wood(&self, stand: usize) -> Range<usize> {
        let solids = self.placed.wood.len() + usize::from(self.placed.ground.is_some());
        let before: usize = self.placed.stands[..stand].iter().map(|s| s.wood.len()).sum();
        let first = self.leaves + solids + before;
        first..first + self.placed.stands[stand].wood.len()
    }

    /// Wood and ground at their places at rest.
    pub fn standing_solids(&self) -> impl Iterator<Item = WorldInstance> + '_ {
        let at = |surface, transform| WorldInstance { surface, transform, section: None };
        let wood = (self.leaves..).zip(&self.placed.wood);
        let wood = wood.flat_map(move |(surface, wood)| wood.places.iter().map(move |place| at(surface, *place)));
        wood.chain(self.ground().map(|surface| at(surface, DMat4::IDENTITY)))
    }
}
