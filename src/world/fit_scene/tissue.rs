//! What leaves consist of, where that is unknown: slabs, layers, and the maps of a fit or of a look. Their numbers
//! change what a leaf reflects and lets through by the model's own derivatives.

use crate::mapped::MappedLeaf;
use crate::quantity::{MappedNumber, SlabNumber, UnknownKind, UnknownQuantity};
use crate::{Error, Result};
use mesophyll_optics::foliar::pigments::SUBSTANCES;
use mesophyll_optics::slab;
use mesophyll_scene::loaded::{LoadedLeaf, LoadedScene};
use mesophyll_scene::manifest::{UniformSlab, WhatAbsorbs};
use mesophyll_scene::placed::ledger::Ledger;
use mesophyll_transport::foliar::FoliarMaterial;
use mesophyll_transport::path::slopes::RadianceParameter;
use mesophyll_transport::world::{ReferenceSide, ReferenceWorld};
use std::sync::Arc;

/// An optical thickness, and an absorption of one crossing, that is much to be in doubt of.
const MUCH: f64 = 0.1;

/// What a leaf consists of.
pub enum SceneTissue {
    /// A slab that is the same everywhere.
    Slab(UniformSlab),
    /// Layers, and what they absorb by.
    Layers(Arc<FoliarMaterial>, WhatAbsorbs),
    /// The maps of a fit or of a look.
    Maps(Box<MappedLeaf>),
}

impl SceneTissue {
    /// That of leaf `k` of the world, of which `asked` is unknown; `None` for a leaf whose reflectances are stated as
    /// numbers.
    ///
    /// # Errors
    /// A map of a fit or a table of pigments that cannot be read.
    pub fn of(
        scene: &LoadedScene,
        leaf: LoadedLeaf,
        world: &ReferenceWorld,
        k: usize,
        asked: &[String],
        ledger: &Ledger,
    ) -> Result<Option<SceneTissue>> {
        if let Some(layers) = leaf.config.layered() {
            let by = scene.manifest.absorbed_by(&layers.stated)?;
            return Ok(leaf.config.layers().map(|made| SceneTissue::Layers(made.clone(), by)));
        }
        if let Some(uniform) = leaf.config.uniform() {
            return Ok(uniform.slab.map(SceneTissue::Slab));
        }
        Ok(MappedLeaf::of(leaf, &world.leaves[k], asked, ledger)?.map(|maps| SceneTissue::Maps(Box::new(maps))))
    }

    /// The unknowns that `what` asks for, of leaf `k` of the world, which is called `name`. `None` where this tissue
    /// has no such number.
    ///
    /// # Errors
    /// In words, where the leaf's present numbers leave nothing to find.
    pub fn unknown(
        &self,
        k: usize,
        name: &str,
        what: &str,
    ) -> std::result::Result<Option<Vec<UnknownQuantity>>, String> {
        let one = |kind, at: Vec<f64>, scale: f64| {
            let high = vec![f64::INFINITY; at.len()];
            let name = format!("leaf.{name}.{what}");
            Ok(Some(vec![UnknownQuantity { kind, name, at, low: 0.0, high, scale: Some(scale) }]))
        };
        match self {
            SceneTissue::Slab(slab) => {
                let per_mm = MUCH / slab.thickness_mm;
                match what {
                    "sigma_a" => one(UnknownKind::Slab(k, SlabNumber::SigmaA), slab.sigma_a.to_vec(), per_mm),
                    "sigma_s" => one(UnknownKind::Slab(k, SlabNumber::SigmaS), slab.sigma_s.to_vec(), per_mm),
                    "thickness_mm" => one(UnknownKind::Slab(k, SlabNumber::Thickness), vec![slab.thickness_mm], 1e-9),
                    _ => Ok(None),
                }
            }
            SceneTissue::Layers(_, WhatAbsorbs::Absorption(depths)) => {
                one(UnknownKind::Absorption(k), depths.to_vec(), MUCH)
            }
            SceneTissue::Layers(_, WhatAbsorbs::Contents { amounts, per_content }) => {
                let Some(q) = SUBSTANCES.iter().position(|name| *name == what) else { return Ok(None) };
                let most = per_content.iter().map(|per| per[q]).fold(0.0, f64::max);
                one(UnknownKind::Content(k, q), vec![amounts[q]], if most > 0.0 { MUCH / most } else { 1e-9 })
            }
            SceneTissue::Maps(maps) => maps.unknown(k, name, what).map(Some),
        }
    }

    /// Gives leaf `k` of the world the present numbers.
    ///
    /// # Errors
    /// Layers for which the exact method does not settle.
    pub fn set(&self, k: usize, numbers: &[UnknownQuantity], world: &mut ReferenceWorld) -> Result<()> {
        let leaf = &mut world.leaves[k];
        match self {
            SceneTissue::Slab(stated) => {
                let [rho_d, rho_t] = slab_now(*stated, k, numbers).response();
                for side in [&mut leaf.front, &mut leaf.back] {
                    side.interior = ReferenceSide::even(rho_d, rho_t, None).interior;
                }
            }
            SceneTissue::Layers(made, by) => {
                let made = made.with_depths(depths(by, k, numbers)).ok_or_else(|| {
                    Error::Missed("the exact method does not settle for the layers of a leaf; state wider lobes".into())
                })?;
                world.foliar[k] = Some(Arc::new(made));
            }
            SceneTissue::Maps(maps) => maps.set(k, numbers, leaf),
        }
        Ok(())
    }

    /// The derivative by one of its unknowns at the present numbers; `None` for an unknown that is not its own.
    pub fn slope(&self, k: usize, kind: &UnknownKind, numbers: &[UnknownQuantity]) -> Option<RadianceParameter> {
        match (self, kind) {
            (SceneTissue::Slab(stated), UnknownKind::Slab(_, number)) => {
                let now = slab_now(*stated, k, numbers);
                let all = [0, 1, 2].map(|c| {
                    let (_, by) = slab::response_with_partials(now.sigma_a[c], now.sigma_s[c], now.thickness_mm);
                    match number {
                        SlabNumber::SigmaA => by.sigma_a,
                        SlabNumber::SigmaS => by.sigma_s,
                        SlabNumber::Thickness => by.thickness,
                    }
                });
                let side = || ReferenceSide::even(all.map(|r| r.rho_d), all.map(|r| r.rho_t), None);
                Some(RadianceParameter::Look { leaf: k, sides: Arc::new([side(), side()]) })
            }
            (SceneTissue::Layers(_, WhatAbsorbs::Contents { per_content, .. }), UnknownKind::Content(_, q)) => {
                Some(RadianceParameter::Depth { leaf: k, by: per_content.map(|per| per[*q]) })
            }
            (SceneTissue::Layers(..), UnknownKind::Absorption(_)) => {
                Some(RadianceParameter::Depth { leaf: k, by: [1.0; 3] })
            }
            (SceneTissue::Maps(maps), UnknownKind::Slab(..) | UnknownKind::Factor(..)) => {
                Some(RadianceParameter::Look { leaf: k, sides: Arc::new(maps.by(k, kind, numbers)) })
            }
            _ => None,
        }
    }
}

/// The slab with the present numbers of leaf `k`.
fn slab_now(mut slab: UniformSlab, k: usize, numbers: &[UnknownQuantity]) -> UniformSlab {
    for q in numbers {
        match q.kind {
            UnknownKind::Slab(leaf, SlabNumber::SigmaA) if leaf == k => slab.sigma_a = [0, 1, 2].map(|c| q.at[c]),
            UnknownKind::Slab(leaf, SlabNumber::SigmaS) if leaf == k => slab.sigma_s = [0, 1, 2].map(|c| q.at[c]),
            UnknownKind::Slab(leaf, SlabNumber::Thickness) if leaf == k => slab.thickness_mm = q.at[0],
            _ => {}
        }
    }
    slab
}

/// The absorptions of one crossing with the present numbers of leaf `k`.
fn depths(by: &WhatAbsorbs, k: usize, numbers: &[UnknownQuantity]) -> [f64; 3] {
    match by {
        WhatAbsorbs::Absorption(depths) => {
            let own = numbers.iter().find(|q| q.kind == UnknownKind::Absorption(k));
            own.map_or(*depths, |q| [0, 1, 2].map(|c| q.at[c]))
        }
        WhatAbsorbs::Contents { amounts, per_content } => {
            let mut now = *amounts;
            for q in numbers {
                if let UnknownKind::Content(leaf, substance) = q.kind
                    && leaf == k
                {
                    now[substance] = q.at[0];
                }
            }
            per_content.map(|per| per.iter().zip(now).map(|(x, amount)| x * amount).sum())
        }
    }
}

/// What a factor on maps is called.
pub fn mapped_name(number: MappedNumber) -> &'static str {
    match number {
        MappedNumber::RhoD(false) => "front.rho_d.factor",
        MappedNumber::RhoD(true) => "back.rho_d.factor",
        MappedNumber::RhoT => "rho_t.factor",
        MappedNumber::RhoS => "rho_s.factor",
        MappedNumber::M => "m.factor",
    }
}
