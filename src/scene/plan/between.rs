//! The plan of light between leaves: whether there is any, and what its transfer is made of.

use super::{Between, LeftOut, Need, Plan};
use crate::manifest::{Manifest, Transfer};
use crate::placed::Placed;

/// Bands of the light where it moves and the scene does not say how many: those of the paper (Wang et al. 2005, §4).
const BANDS: usize = 5;
/// What light between leaves is called.
const NAME: &str = "light between leaves";

/// Decides about light between leaves.
pub fn between(manifest: &Manifest, placed: &Placed, plan: &mut Plan) {
    let Some(asked) = &manifest.transfer else {
        plan.leave_out(LeftOut::new(
            NAME,
            "the scene has no [transfer]: every leaf is lit as if it stood alone",
            0,
            None,
        ));
        return;
    };
    let shines = |k: usize| manifest.leaves[k].uniform.as_ref().is_none_or(|u| u.gloss().is_some());
    let gloss: Vec<bool> =
        plan.leaves.iter().enumerate().map(|(k, l)| shines(k) && l.sides.iter().any(|s| s.gloss)).collect();
    let entries = |bands: usize| (rows(asked, placed, &gloss, bands) * bands * bands * 8) as u64;
    // A mesh of the scene's own may be many leaves; a fit's blade is one.
    let one_blade = manifest.leaves.iter().all(|l| l.mesh.is_none() && l.discs.is_none());
    let alone = placed.placements.len() < 2
        && placed.twigs.is_empty()
        && placed.wood.is_none()
        && placed.ground.is_none()
        && one_blade;
    if alone {
        let why = "one leaf stands alone: no other sends it light or hides the sky";
        let bytes = entries(asked.bands.unwrap_or(BANDS));
        plan.leave_out(LeftOut::new(NAME, why, bytes, None));
        return;
    }
    let moves = placed.free || manifest.sun_moves();
    let bands = asked.bands.or_else(|| moves.then_some(BANDS));
    plan.light.between = Some(Between { bands });
    plan.light.sky_bands = plan.light.sky_bands.max(bands.unwrap_or(0));
    let [along, across] = asked.anchors;
    let mut need = Need::new(NAME, "the scene asks for it: leaves hide the sky from each other and light each other");
    need.amount = Some(format!("{along}x{across} anchors a leaf, {} paths each", asked.paths));
    plan.need(need);
    match bands {
        Some(bands) => {
            let mut need = Need::new("operators of the light", "the light moves, or the scene asks for its bands");
            need.amount = Some(format!("{bands} bands: {} columns", bands * bands));
            need.bytes = Some(entries(bands));
            plan.need(need);
        }
        None => {
            let why = "sun and sky stand still: what arrives is one column, the light itself, and loses no band of it";
            let saved = entries(BANDS) - entries(BANDS) / (BANDS * BANDS) as u64;
            plan.leave_out(LeftOut::new("operators of the light", why, saved, None));
        }
    }
}

/// Rows of all leaves together, each taken for one piece.
fn rows(asked: &Transfer, placed: &Placed, gloss: &[bool], bands: usize) -> usize {
    let [along, across] = asked.anchors;
    let of = |leaf: usize| along * across * if gloss[leaf] { 6 + bands * bands } else { 6 };
    placed.placements.iter().map(|p| of(p.leaf)).sum()
}
