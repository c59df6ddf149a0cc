//! Maps, curves and coefficients that a plan asks for, and the figures that some of its decisions rest on.
//!
//! [`Scene`] is everything that is known of a scene: what its file says, what stands where, what of it is needed, and
//! the data themselves. Renderers, checks and the window take it whole.

pub mod convolved;
pub mod curve;
mod gloss;
pub mod gloss_bound;
pub mod leaf;
pub mod map_levels;
pub mod translucency;

use crate::Result;
use crate::ledger::Ledger;
use crate::manifest::{self, Manifest};
use crate::placed::leaf::Search;
use crate::placed::{self, Placed};
use crate::plan::{LeafPlan, Plan};
use leaf::Loaded;

/// A planned scene with everything that its plan asks for.
#[derive(Debug)]
pub struct Scene {
    pub manifest: Manifest,
    pub placed: Placed,
    pub plan: Plan,
    /// In the manifest's order.
    pub loaded: Vec<Loaded>,
}

/// One leaf of a scene: what the file says, what is there, what is decided, and the data.
#[derive(Clone, Copy)]
pub struct Leaf<'a> {
    pub config: &'a manifest::Leaf,
    pub placed: &'a placed::leaf::Leaf,
    pub plan: &'a LeafPlan,
    pub loaded: &'a Loaded,
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
        Ok(Scene { manifest, placed, plan, loaded })
    }

    /// Looks for what is there of a scene, plans it, and reads what the plan asks for.
    ///
    /// # Errors
    /// As [`Placed::new`] and [`Scene::new`].
    pub fn open(manifest: Manifest, search: Search, ledger: &Ledger) -> Result<Scene> {
        let placed = Placed::new(&manifest, search, ledger)?;
        Scene::new(manifest, placed, ledger)
    }

    pub fn leaf(&self, index: usize) -> Leaf<'_> {
        Leaf {
            config: &self.manifest.leaves[index],
            placed: &self.placed.leaves[index],
            plan: &self.plan.leaves[index],
            loaded: &self.loaded[index],
        }
    }

    pub fn leaves(&self) -> impl Iterator<Item = Leaf<'_>> {
        (0..self.loaded.len()).map(|k| self.leaf(k))
    }

    /// Leaves that perspective views show: those with a mesh, in the renderers' order.
    pub fn drawn(&self) -> impl Iterator<Item = Leaf<'_>> {
        self.leaves().filter(|l| l.placed.mesh.is_some())
    }
}
