//! The things in the world and their places, their light, and which camera sees which of their sides. Below
//! it, `manifest` holds the content of a scene file. Above it, `plan` decides what is needed.
//!
//! [`fits`] are the folders that a scene's leaves come from, and [`ledger`] records what was done.

#![warn(missing_docs)]

pub mod daylight;
pub mod fits;
pub mod flutter;
pub mod grass;
pub mod groups;
pub mod lawn_lean;
pub mod leaf;
pub mod ledger;
pub mod motion;
pub mod overrides;
pub mod placement;
pub mod plant;
pub mod poses;
pub mod sections;
pub mod spots;
pub mod stand;
pub mod sway;
pub mod visible_sides;
pub mod winds;

pub(crate) use mesophyll_base::error::{Error, Result};

use crate::manifest::{SceneGround, SceneManifest, StatedLeaf};
use crate::placed::fits::maker;
use crate::placed::fits::source::FitFreshness;
use crate::placed::fits::translucency::PlacedTranslucency;
use crate::placed::ledger::Ledger;
use glam::{DVec2, DVec3};
use leaf::{LeafSearch, PlacedLeaf};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_files::progress;
use mesophyll_fits::grass::hill::Hill;
use motion::SceneMotion;
use placement::LeafPlacement;
use plant::{PlacedPlant, PlacedShape, PlacedWood};
use stand::PlacedStand;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use winds::SwayingPlants;

/// A scene's leaves and wood at their places.
#[derive(Debug)]
pub struct PlacedScene {
    /// The leaves, in the manifest's order.
    pub leaves: Vec<PlacedLeaf>,
    /// The placements of leaves at rest, and last those that stand for the leaves of [`PlacedScene::stands`].
    pub placements: Vec<LeafPlacement>,
    /// The places of the cameras of perspective views.
    pub eyes: Vec<DVec3>,
    /// The wood of plants.
    pub wood: Vec<PlacedWood>,
    /// Plants that stand in many places and share poses.
    pub stands: Vec<PlacedStand>,
    /// Every shape of a plant's blades, with the plant's name.
    pub shapes: Vec<(String, PlacedShape)>,
    /// Lawns on the ground.
    pub grass: Vec<grass::PlacedLawn>,
    /// The ground and its reflectance.
    pub ground: Option<(LeafMesh, [f64; 3])>,
    /// The plants that move; `None` where none does.
    pub winds: Option<Arc<SwayingPlants>>,
    /// Whether this is for a window, where camera, sun and sliders are free.
    pub free: bool,
    /// A run's folder with its own fits, among them that of light between leaves.
    pub out: Option<PathBuf>,
}

impl PlacedScene {
    /// Searches for everything that the scene shows.
    ///
    /// # Errors
    /// [`crate::placed::Error::Input`] for a fit that does not exist and cannot be made, a damaged mesh, or a branch
    /// whose load bends it too far.
    pub fn new(manifest: &SceneManifest, search: LeafSearch, ledger: &Ledger) -> Result<PlacedScene> {
        manifest.require_colours()?;
        let planted = plant::planted(manifest, ledger)?;
        let Standing { placements, wood, stands, winds } = stand(manifest, &planted, ledger)?;
        let shapes = planted.iter().flat_map(|p| p.shapes().map(move |shape| (p.name.clone(), shape))).collect();
        let eyes = manifest.perspectives().map(|v| v.camera.eye).collect();
        let moves = SceneMotion { winds: winds.as_deref(), grass: false };
        let leaves = (0..manifest.leaves.len())
            .map(|k| PlacedLeaf::find(manifest, (&placements, moves), k, search, ledger))
            .collect::<Result<_>>()?;
        Ok(PlacedScene {
            leaves,
            placements,
            eyes,
            wood,
            stands,
            shapes,
            grass: grass::lawns(manifest, ledger)?,
            ground: manifest.ground.as_ref().map(|g| (level(manifest, g), g.albedo)),
            winds,
            free: search.free,
            out: search.out.map(Path::to_path_buf),
        })
    }

    /// Takes over plants that were changed. They must be as many as the manifest's, with as many leaves.
    ///
    /// # Errors
    /// As [`SwayingPlants::new`].
    pub fn replant(&mut self, manifest: &SceneManifest, plants: &[PlacedPlant], ledger: &Ledger) -> Result<()> {
        let Standing { placements, wood, stands, winds } = stand(manifest, plants, ledger)?;
        (self.placements, self.wood, self.stands, self.winds) = (placements, wood, stands, winds);
        Ok(())
    }

    /// The leaves at rest that are each stored: all but those that stand for others.
    pub fn standing(&self) -> impl Iterator<Item = &LeafPlacement> {
        self.placements.iter().filter(|p| p.frame == 0)
    }

    /// Everything that moves.
    pub fn moves(&self) -> SceneMotion<'_> {
        let grass = self.grass.iter().any(|lawn| lawn.leaning.is_some());
        SceneMotion { winds: self.winds.as_deref(), grass }
    }

    /// A placement at a time (s), moved with its plant.
    pub fn at_time(&self, placement: &LeafPlacement, time: f64) -> LeafPlacement {
        self.moves().placement(placement, time)
    }

    /// Leaves that must be fitted before anything can be drawn.
    pub fn unfitted(&self) -> Vec<usize> {
        self.leaves.iter().filter(|l| l.used && l.fitted.is_none() && !l.uniform).map(|l| l.index).collect()
    }

    /// Leaves that have their own fits, but whose translucency maps must be made before anything can be drawn.
    pub fn untranslucent(&self, manifest: &SceneManifest) -> Vec<usize> {
        let lacks = |l: &&PlacedLeaf| {
            let lit_through = manifest.sun.is_some() && l.facing.through.iter().any(|(_, lit)| *lit);
            let made = |t: &PlacedTranslucency| t.source.status == FitFreshness::Reuse;
            l.fitted.is_some() && lit_through && l.translucent.as_ref().is_some_and(|t| !made(t))
        };
        self.leaves.iter().filter(lacks).map(|l| l.index).collect()
    }

    /// Searches for one leaf again, after its fit was made.
    ///
    /// # Errors
    /// As [`PlacedScene::new`].
    pub fn find_again(
        &mut self,
        manifest: &SceneManifest,
        index: usize,
        search: LeafSearch,
        ledger: &Ledger,
    ) -> Result<()> {
        let moves = SceneMotion { winds: self.winds.as_deref(), grass: false };
        let world = (self.placements.as_slice(), moves);
        self.leaves[index] = PlacedLeaf::find(manifest, world, index, search, ledger)?;
        Ok(())
    }

    /// A sentence for each leaf whose look is stated and not fitted, with all that is stated, and for each side of a
    /// leaf that was not measured.
    pub fn stated(&self) -> Vec<String> {
        let fits = || self.leaves.iter().filter_map(|l| l.fitted.as_ref());
        let looks = fits().filter_map(|fit| fit.record.stated_in_one());
        let sides = fits().filter_map(|fit| {
            let (side, other) = fit.unmeasured()?;
            Some(format!("{}: {}", fit.name, other.said(side)))
        });
        looks.chain(sides).collect()
    }

    /// Makes the missing fits of the leaves that are `asked` for, in a run's folder `out`. Ctrl-C stops between them.
    ///
    /// # Errors
    /// As [`maker::fit`].
    pub fn make_fits(
        &mut self,
        manifest: &SceneManifest,
        out: &Path,
        search: LeafSearch,
        ledger: &Ledger,
        asked: impl Fn(&StatedLeaf) -> bool,
    ) -> Result<()> {
        for index in self.unfitted().into_iter().filter(|k| asked(&manifest.leaves[*k])) {
            progress::go_on()?;
            maker::fit(manifest, index, out, &maker::fit_folder(manifest, index, out), false, ledger)?;
            self.find_again(manifest, index, LeafSearch { out: Some(out), ..search }, ledger)?;
        }
        Ok(())
    }

    /// Makes the maps of leaves whose look is stated, in a run's folder `out`. That takes seconds, unlike a fit.
    ///
    /// # Errors
    /// As [`maker::fit`].
    pub fn make_looks(
        &mut self,
        manifest: &SceneManifest,
        out: &Path,
        search: LeafSearch,
        ledger: &Ledger,
    ) -> Result<()> {
        self.make_fits(manifest, out, search, ledger, |leaf| leaf.look().is_some())
    }

    /// Makes the missing translucency maps of leaves that have their own fits, in a run's folder `out`.
    ///
    /// # Errors
    /// As `fit translucency`.
    pub fn make_translucency(
        &mut self,
        manifest: &SceneManifest,
        out: &Path,
        search: LeafSearch,
        ledger: &Ledger,
    ) -> Result<()> {
        for index in self.untranslucent(manifest) {
            if let Some(fitted) = &self.leaves[index].fitted {
                maker::translucency(manifest, index, &fitted.folder, out, ledger)?;
            }
            self.find_again(manifest, index, LeafSearch { out: Some(out), ..search }, ledger)?;
        }
        Ok(())
    }
}

/// Plants and single leaves at their places.
struct Standing {
    placements: Vec<LeafPlacement>,
    wood: Vec<PlacedWood>,
    stands: Vec<PlacedStand>,
    winds: Option<Arc<SwayingPlants>>,
}

/// Places the scene's single leaves and its plants.
fn stand(manifest: &SceneManifest, plants: &[PlacedPlant], ledger: &Ledger) -> Result<Standing> {
    let mut placements = placement::placements(manifest);
    let winds = SwayingPlants::new(manifest, plants, ledger)?.map(Arc::new);
    let swaying = |k: usize| winds.as_ref().and_then(|w| w.plants[k].as_ref());
    let mut wood = Vec::new();
    for (k, plant) in plants.iter().enumerate().filter(|(_, plant)| plant.groups.is_none()) {
        let leaves = plant.plant.leaves.len();
        placements.extend(plant.placements().enumerate().map(|(i, rest)| {
            let section = swaying(k).map(|s| s.sections.of_leaf(i / leaves, i % leaves));
            LeafPlacement { section, ..rest }
        }));
        wood.extend(swaying(k).map_or_else(|| plant.wood(), |s| s.sections.wood(plant.wood())));
    }
    let stands = plants.iter().enumerate().filter_map(|(k, plant)| PlacedStand::new(plant, swaying(k))).collect();
    placements.extend(stand::near(plants, winds.as_deref()));
    Ok(Standing { placements, wood, stands, winds })
}

/// Number of cells along a side of the ground in a scene with light between leaves, which is computed at the cells'
/// corners.
const CELLS: usize = 48;

/// The ground as a rectangle.
fn level(manifest: &SceneManifest, ground: &SceneGround) -> LeafMesh {
    let side = 2.0 * ground.reach_mm.unwrap_or_default();
    let [x, y] = manifest.periodic.as_ref().map_or([side; 2], |p| p.size_mm);
    let mut mesh = LeafMesh::rectangle(x, y);
    if manifest.transfer.is_some() {
        // The cells are small in the middle, where things stand, and large at the rim.
        let nodes: Vec<f64> = (0..=CELLS).map(|k| 2.0 * k as f64 / CELLS as f64 - 1.0).collect();
        let at = |s: f64| 0.5 * side * s * s.abs() * (0.9 * s.abs() + 0.1);
        mesh = LeafMesh {
            positions: nodes.iter().flat_map(|v| nodes.iter().map(|u| DVec3::new(at(*u), at(*v), 0.0))).collect(),
            normals: vec![DVec3::Z; nodes.len().pow(2)],
            tangents: vec![(DVec3::X, 1.0); nodes.len().pow(2)],
            uvs: nodes.iter().flat_map(|v| nodes.iter().map(move |u| 0.5 * DVec2::new(1.0 + u, 1.0 - v))).collect(),
            indices: (0..CELLS as u32)
                .flat_map(|j| (0..CELLS as u32).map(move |i| j * (CELLS as u32 + 1) + i))
                .flat_map(|k| {
                    let up = k + CELLS as u32 + 1;
                    [k, k + 1, up + 1, k, up + 1, up]
                })
                .collect(),
            discs: false,
        };
    }
    if let Some(hill) = grass::hill(manifest) {
        mesh = hilly(&hill, 0.5 * side);
    }
    mesh.positions.iter_mut().for_each(|p| p.z += ground.height_mm);
    mesh
}

/// Numbers of cells of the ground along a hill's radius, and of radii that have such cells on each side of its top.
const FINE: i32 = 16;
const RADII: i32 = 4;

/// The ground with a hill, from −`reach` to `reach`. A cell is a sixteenth of the radius where the hill is, so that
/// the mesh is lower than the hill by 1/1024 of its height at most, and higher by 1/2300. Beyond four radii, where a
/// three-thousandth of the height is left, cells end at the rim.
fn hilly(hill: &Hill, reach: f64) -> LeafMesh {
    let nodes = |middle: f64| -> Vec<f64> {
        let fine = (-FINE * RADII..=FINE * RADII).map(|k| middle + hill.radius * f64::from(k) / f64::from(FINE));
        let within = fine.filter(|x| x.abs() < reach);
        std::iter::once(-reach).chain(within).chain([reach]).collect()
    };
    let (xs, ys) = (nodes(hill.middle.x), nodes(hill.middle.y));
    let mut mesh = LeafMesh::default();
    for y in &ys {
        for x in &xs {
            let at = DVec2::new(*x, *y);
            let slope = hill.slope(at);
            mesh.positions.push(at.extend(hill.rise(at)));
            mesh.normals.push((-slope).extend(1.0).normalize());
            mesh.tangents.push((DVec3::new(1.0, 0.0, slope.x).normalize(), 1.0));
            mesh.uvs.push(DVec2::new(0.5 + 0.5 * x / reach, 0.5 - 0.5 * y / reach));
        }
    }
    let width = xs.len() as u32;
    for j in 0..ys.len() as u32 - 1 {
        for k in j * width..j * width + width - 1 {
            mesh.indices.extend([k, k + 1, k + width + 1, k, k + width + 1, k + width]);
        }
    }
    mesh
}
