//! What must be read of a leaf, by its placements; and what its maps tell of what a picture shows of them.

use super::findings::{GlossFinding, MapLoss};
use super::{LeafPlan, SideNeeds};
use crate::manifest::SceneManifest;
use crate::placed::leaf::PlacedLeaf;
use crate::{Error, Result};
use mesophyll_optics::side::Side;

/// The needs of each side, which follow from the leaf's placements.
fn sides(manifest: &SceneManifest, leaf: &PlacedLeaf, free: bool) -> [SideNeeds; 2] {
    // With light between leaves, every side is lit by light that depends on direction.
    let between = manifest.transfer.is_some();
    let (sun, sky) = (manifest.sun.is_some(), manifest.sky.is_some() || between);
    let asked = leaf.translucent.is_some() && sun;
    let (f, cards) = (leaf.facing, leaf.on_cards);
    Side::ALL.map(|side| {
        if free && leaf.mesh.is_some() {
            let fitted = leaf.fitted.as_ref().is_some_and(|f| f.has(side));
            let has = leaf.uniform || fitted;
            return SideNeeds {
                rho_d: has,
                rho_t: has,
                gloss: has,
                normal: fitted,
                translucency: fitted && asked,
                mean: false,
            };
        }
        let rho_d = f.lit[side] || (sky && f.seen[side]);
        let translucency = asked && f.through[side.other()];
        SideNeeds {
            rho_d,
            rho_t: f.through[side.other()] || (sky && f.seen[side.other()]),
            gloss: rho_d,
            translucency,
            // Under a sky that varies, the light of both sides depends on their normals.
            normal: f.lit[side]
                || (f.through[side.other()] && !translucency)
                || ((manifest.varied_sky() || between) && (f.seen[side] || f.seen[side.other()])),
            mean: cards.seen[side] || cards.through[side.other()] || (sky && cards.seen[side.other()]),
        }
    })
}

impl LeafPlan {
    /// What the placements of a leaf need of it, before any of its maps is read.
    ///
    /// # Errors
    /// [`crate::Error::Input`] for a side that is needed and that the fit does not have.
    pub fn new(manifest: &SceneManifest, leaf: &PlacedLeaf, free: bool) -> Result<LeafPlan> {
        let plan = LeafPlan { sides: sides(manifest, leaf, free), size: [0; 2], block: 1 };
        let Some(fitted) = &leaf.fitted else { return Ok(plan) };
        for (side, needs) in Side::ALL.into_iter().zip(plan.sides) {
            if (needs.any() || needs.mean) && !fitted.has(side) {
                let what = format!(
                    "the scene shows the {}, which {} does not have; expected other_side = \"mirrored\" beside fit, \
                     other_side = {{ rho_d = [...] }} with a reflection of your own, or a fit of both sides",
                    side.name(),
                    fitted.folder.display()
                );
                let name = &manifest.leaves[leaf.index].name;
                return Err(Error::field(&manifest.path, &format!("leaf \"{name}\""), what));
            }
        }
        Ok(plan)
    }

    /// What is needed of a side.
    pub fn needs(&self, side: Side) -> SideNeeds {
        self.sides[side as usize]
    }

    /// Whether the gloss of a side is kept, which is noted.
    pub fn gloss_shows(&mut self, manifest: &SceneManifest, side: Side, found: GlossFinding) -> bool {
        let needs = &mut self.sides[side as usize];
        needs.gloss =
            !matches!(found, GlossFinding::AtMost(most) if most < manifest.tolerated()) && found != GlossFinding::Matte;
        // The share of a sky that a lobe reflects depends on the angle between normal and view, even for a constant
        // sky.
        needs.normal |= needs.gloss && manifest.sky.is_some();
        needs.gloss
    }

    /// Whether a side's translucency maps must be read.
    pub fn reads_translucency(&self, leaf: &PlacedLeaf, side: Side) -> bool {
        let made = leaf.translucent.as_ref().is_some_and(|t| t.fitted.is_some());
        made && leaf.fitted.as_ref().is_some_and(|f| f.has(side)) && self.needs(side).translucency
    }

    /// Whether the translucency maps of a side are kept, which is noted. For a window nothing is left out for being
    /// small.
    pub fn maps_show(&mut self, manifest: &SceneManifest, side: Side, loss: &MapLoss, free: bool) -> bool {
        let needs = &mut self.sides[side as usize];
        if loss.largest < manifest.tolerated() && !free {
            (needs.translucency, needs.normal) = (false, true);
        }
        needs.translucency
    }
}
