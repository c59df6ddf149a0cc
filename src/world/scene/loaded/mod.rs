//! The maps, curves and coefficients that a plan needs, and the figures on which some of its decisions depend.
//!
//! [`LoadedScene`] is everything that is known about a scene: the content of its file, the things and their places, the
//! plan, and the data. Renderers, checks and the window take it as a whole.

pub mod convolution;
pub mod curve;
mod faults;
mod gloss;
pub mod gloss_bound;
mod leaf;
pub mod map_levels;
pub mod translucency;

use crate::Result;
use crate::manifest::SceneManifest;
use crate::placed::leaf::LeafSearch;
use crate::placed::ledger::Ledger;
use crate::placed::{self as placed, PlacedScene};
use crate::plan::findings::LeafFindings;
use crate::plan::{LeafPlan, ScenePlan};
use convolution::LeafInterior;
use curve::ResponseCurve;
use mesophyll_optics::side::Sides;
use std::sync::OnceLock;
use translucency::TranslucencyCoefficients;

/// A planned scene, with everything that its plan needs.
#[derive(Debug)]
pub struct LoadedScene {
    /// The content of the scene's file.
    pub manifest: SceneManifest,
    /// The things in the scene, their places and their light.
    pub placed: PlacedScene,
    /// The decisions on what is needed.
    pub plan: ScenePlan,
    /// The data of each leaf, in the manifest's order.
    pub loaded: Vec<LeafData>,
    /// Light between leaves, where the scene requests it and [`LoadedScene::find_transfer`] has found it.
    pub transfer: Option<mesophyll_fits::transfer::TransferFit>,
}

/// One leaf of a scene: its entry in the file, its fit and mesh, the decisions about it, and its data.
#[derive(Clone, Copy)]
pub struct LoadedLeaf<'a> {
    /// Its entry in the scene's file.
    pub config: &'a crate::manifest::StatedLeaf,
    /// Its fit and its mesh.
    pub placed: &'a placed::leaf::PlacedLeaf,
    /// The decisions on what is needed of it.
    pub plan: &'a LeafPlan,
    /// The data that were read of it.
    pub loaded: &'a LeafData,
}

/// W's textures of one side, filled beyond the outline. Only those that the plan needs are read.
#[derive(Debug, Default)]
pub struct LoadedTextures {
    /// γ (RGB) and δ (mm).
    pub gamma_delta: Option<Vec<[f32; 4]>>,
    /// ρs (RGB) and m.
    pub gloss: Option<Vec<[f32; 4]>>,
    /// For each texel, whether the fit knew γ.
    pub good: Vec<bool>,
}

/// The data that were read of one leaf, for front and back.
#[derive(Debug, Default)]
pub struct LeafData {
    /// The textures of each side for the renderer.
    pub textures: Sides<LoadedTextures>,
    /// The slab over its thickness, for each side; `None` where the plan needs none.
    pub curves: Sides<Option<ResponseCurve>>,
    /// Coefficients for light that enters each side, without holes. Only sides that are lit from behind where a camera
    /// looks have them. The plan decides which of them the renderer gets; the reference draws them all.
    pub coefficients: Sides<Option<TranslucencyCoefficients>>,
    /// The interior for the reference renderer, which is made when it is needed for the first time.
    inside: OnceLock<Option<LeafInterior>>,
}

/// The data from which leaves are read.
#[derive(Clone, Copy)]
struct Stand<'a> {
    manifest: &'a SceneManifest,
    placed: &'a PlacedScene,
    ledger: &'a Ledger,
}

impl<'a> Stand<'a> {
    /// A leaf, as far as it has been read and planned.
    fn leaf(&self, placed: &'a placed::leaf::PlacedLeaf, loaded: &'a LeafData, plan: &'a LeafPlan) -> LoadedLeaf<'a> {
        LoadedLeaf { config: &self.manifest.leaves[placed.index], placed, plan, loaded }
    }
}

impl LoadedScene {
    /// Reads what a scene in its present state needs, and plans it by what was read.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a damaged map, a side that a fit does not have, or a physical sky that the model
    /// refuses.
    pub fn new(manifest: SceneManifest, placed: PlacedScene, ledger: &Ledger) -> Result<LoadedScene> {
        let stand = Stand { manifest: &manifest, placed: &placed, ledger };
        let needs: Vec<LeafPlan> =
            placed.leaves.iter().map(|leaf| LeafPlan::new(&manifest, leaf, placed.free)).collect::<Result<_>>()?;
        let read = placed.leaves.iter().zip(needs).map(|(leaf, needs)| leaf::load(stand, leaf, needs));
        let (loaded, found): (Vec<LeafData>, Vec<LeafFindings>) = read.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        let plan = ScenePlan::new(&manifest, &placed, &found, ledger)?;
        Ok(LoadedScene { manifest, placed, plan, loaded, transfer: None })
    }

    /// Searches for the data of a scene, plans it, and reads the data that the plan needs.
    ///
    /// # Errors
    /// As [`PlacedScene::new`] and [`LoadedScene::new`].
    pub fn open(manifest: SceneManifest, search: LeafSearch, ledger: &Ledger) -> Result<LoadedScene> {
        let placed = PlacedScene::new(&manifest, search, ledger)?;
        LoadedScene::new(manifest, placed, ledger)
    }

    /// The leaf with this index. Panics where the manifest has none.
    pub fn leaf(&self, index: usize) -> LoadedLeaf<'_> {
        LoadedLeaf {
            config: &self.manifest.leaves[index],
            placed: &self.placed.leaves[index],
            plan: &self.plan.leaves[index],
            loaded: &self.loaded[index],
        }
    }

    /// All leaves, in the manifest's order.
    pub fn leaves(&self) -> impl Iterator<Item = LoadedLeaf<'_>> {
        (0..self.loaded.len()).map(|k| self.leaf(k))
    }

    /// Leaves that perspective views show, which are those with a mesh, in the renderers' order.
    pub fn drawn(&self) -> impl Iterator<Item = LoadedLeaf<'_>> {
        self.leaves().filter(|l| l.placed.mesh.is_some())
    }
}
