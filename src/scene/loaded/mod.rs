//! Maps, curves and coefficients that a plan asks for, and the figures that some of its decisions rest on.
//!
//! [`Scene`] is everything that is known of a scene: what its file says, what stands where, what of it is needed, and
//! the data themselves. Renderers, checks and the window take it whole.

pub mod convolved;
pub mod curve;
mod gloss;
pub mod gloss_bound;
mod leaf;
pub mod map_levels;
pub mod translucency;

use crate::Result;
use crate::plan::{LeafPlan, Plan};
use convolved::Inside;
use curve::Curve;
use mesophyll_manifest::Manifest;
use mesophyll_placed::leaf::Search;
use mesophyll_placed::ledger::Ledger;
use mesophyll_placed::{self as placed, Placed};
use std::sync::OnceLock;
use translucency::Coefficients;

/// A planned scene with everything that its plan asks for.
#[derive(Debug)]
pub struct Scene {
    /// What the scene's file says.
    pub manifest: Manifest,
    /// What stands where, in which light.
    pub placed: Placed,
    /// What is needed of it.
    pub plan: Plan,
    /// In the manifest's order.
    pub loaded: Vec<Loaded>,
    /// Light between leaves, where the scene asks for it and it was looked for ([`Scene::find_transfer`]).
    pub transfer: Option<mesophyll_fit_transfer::Transfer>,
}

/// One leaf of a scene: what the file says, what is there, what is decided, and the data.
#[derive(Clone, Copy)]
pub struct Leaf<'a> {
    /// What the scene's file says of it.
    pub config: &'a mesophyll_manifest::Leaf,
    /// Its fit and its mesh.
    pub placed: &'a placed::leaf::Leaf,
    /// What is needed of it.
    pub plan: &'a LeafPlan,
    /// What was read of it.
    pub loaded: &'a Loaded,
}

/// W's textures of one side, filled beyond the outline; only what the plan needs is read.
#[derive(Debug, Default)]
pub struct Textures {
    /// γ (RGB) and δ (mm).
    pub gamma_delta: Option<Vec<[f32; 4]>>,
    /// ρs (RGB) and m.
    pub gloss: Option<Vec<[f32; 4]>>,
    /// Where the fit knew γ.
    pub good: Vec<bool>,
}

/// What was read of one leaf: front, back.
#[derive(Debug, Default)]
pub struct Loaded {
    /// What the renderer looks up, a side.
    pub textures: [Textures; 2],
    /// The slab against thickness, a side; `None` where the plan needs none.
    pub curves: [Option<Curve>; 2],
    /// For light that enters each side, without holes; only of sides that are back-lit where a camera looks. The plan
    /// says which of them the renderer gets; the reference draws them all.
    pub coefficients: [Option<Coefficients>; 2],
    /// For the reference renderer, made when it first asks.
    inside: OnceLock<Option<Inside>>,
}

/// What leaves are read from.
#[derive(Clone, Copy)]
struct Stand<'a> {
    manifest: &'a Manifest,
    placed: &'a Placed,
    ledger: &'a Ledger,
}

impl<'a> Stand<'a> {
    /// A leaf as far as it is read and planned.
    fn leaf(&self, placed: &'a placed::leaf::Leaf, loaded: &'a Loaded, plan: &'a Plan) -> Leaf<'a> {
        Leaf { config: &self.manifest.leaves[placed.index], placed, plan: &plan.leaves[placed.index], loaded }
    }
}

impl Scene {
    /// Plans a scene as it stands, and reads what the plan asks for.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a damaged map, a side that a fit does not have, or a physical sky that the model
    /// refuses.
    pub fn new(manifest: Manifest, placed: Placed, ledger: &Ledger) -> Result<Scene> {
        let mut plan = Plan::new(&manifest, &placed);
        let stand = Stand { manifest: &manifest, placed: &placed, ledger };
        let loaded =
            placed.leaves.iter().map(|leaf| leaf::load(stand, leaf, &mut plan)).collect::<Result<Vec<Loaded>>>()?;
        if placed.free {
            plan.leaves.iter_mut().for_each(|l| l.block = 1);
        }
        plan.finish(&manifest, &placed, ledger)?;
        Ok(Scene { manifest, placed, plan, loaded, transfer: None })
    }

    /// Looks for what is there of a scene, plans it, and reads what the plan asks for.
    ///
    /// # Errors
    /// As [`Placed::new`] and [`Scene::new`].
    pub fn open(manifest: Manifest, search: Search, ledger: &Ledger) -> Result<Scene> {
        let placed = Placed::new(&manifest, search, ledger)?;
        Scene::new(manifest, placed, ledger)
    }

    /// The leaf of this index; panics where the manifest has none.
    pub fn leaf(&self, index: usize) -> Leaf<'_> {
        Leaf {
            config: &self.manifest.leaves[index],
            placed: &self.placed.leaves[index],
            plan: &self.plan.leaves[index],
            loaded: &self.loaded[index],
        }
    }

    /// All leaves, in the manifest's order.
    pub fn leaves(&self) -> impl Iterator<Item = Leaf<'_>> {
        (0..self.loaded.len()).map(|k| self.leaf(k))
    }

    /// Leaves that perspective views show: those with a mesh, in the renderers' order.
    pub fn drawn(&self) -> impl Iterator<Item = Leaf<'_>> {
        self.leaves().filter(|l| l.placed.mesh.is_some())
    }
}
