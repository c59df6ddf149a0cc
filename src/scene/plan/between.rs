//! The plan of light between leaves: whether there is any, and what its transfer is made of.

use super::{Between, LeftOut, Need, Plan};
use crate::manifest::{Manifest, Shadows, Transfer};
use crate::placed::Placed;
use crate::placed::daylight::sun_directions;

/// Bands of the light where it moves and the scene does not say how many: those of the paper (Wang et al. 2005, §4).
const BANDS: usize = 5;
/// What light between leaves is called.
const NAME: &str = "light between leaves";
/// What the sun's shadows are called that are worked out beforehand.
const SUN: &str = "sun visibility";
/// Directions of the source's cube map (Wang et al. 2005, §4), its upper half.
const CUBE: u64 = 32 * 32 * 6 / 2;

/// Whether the sun's shadows on leaves and wood are worked out beforehand, and if not, why not.
///
/// # Errors
/// The reason.
pub fn sun_visibility(manifest: &Manifest, placed: &Placed) -> Result<(), &'static str> {
    match &manifest.transfer {
        _ if manifest.sun.is_none() => Err("the scene has no sun"),
        None => Err("the scene does not ask for it: shadow maps are drawn in the picture's own time"),
        Some(t) if t.shadows == Shadows::Maps => Err("the scene asks for shadow maps"),
        _ if stands_alone(manifest, placed) => Err("one leaf stands alone"),
        _ if placed.free => Err("the sun may be moved anywhere: shadow maps follow it"),
        _ if manifest.sun.as_ref().is_some_and(|s| s.moves) => Err("the sun may stand anywhere: shadow maps follow it"),
        _ if placed.bends.is_some() => Err("leaves sway, and their shadows with them: shadow maps follow them"),
        _ => Ok(()),
    }
}

/// Whether no leaf has another one, wood or ground beside it.
fn stands_alone(manifest: &Manifest, placed: &Placed) -> bool {
    // A mesh of the scene's own may be many leaves; a fit's blade is one.
    let one_blade = manifest.leaves.iter().all(|l| l.mesh.is_none() && l.discs.is_none());
    placed.placements.len() < 2
        && placed.twigs.is_empty()
        && placed.wood.is_none()
        && placed.ground.is_none()
        && one_blade
}

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
    if stands_alone(manifest, placed) {
        let why = "one leaf stands alone: no other sends it light or hides the sky";
        let bytes = entries(asked.bands.unwrap_or(BANDS));
        plan.leave_out(LeftOut::new(NAME, why, bytes, None));
        return;
    }
    let moves = placed.free || manifest.sun_moves();
    let bands = asked.bands.or_else(|| moves.then_some(BANDS));
    let shadows = sun_visibility(manifest, placed);
    plan.light.between = Some(Between { bands, sun_visibility: shadows.is_ok() });
    plan.light.sky_bands = plan.light.sky_bands.max(bands.unwrap_or(0));
    let [along, across] = asked.anchors;
    let mut need = Need::new(NAME, "the scene asks for it: leaves hide the sky from each other and light each other");
    need.amount = Some(format!("{along}x{across} anchors a leaf, {} paths each", asked.paths));
    plan.need(need);
    let vertices: usize =
        placed.placements.iter().filter_map(|p| placed.leaves[p.leaf].mesh.as_ref()).map(|m| m.positions.len()).sum();
    match shadows {
        Ok(()) => {
            let directions = sun_directions(manifest).len() as u64;
            let mut need = Need::new(SUN, "the scene asks for it: sharp shadows that cost a frame nothing");
            need.amount = Some(format!("{directions} maps, edges of at most {} mm", asked.edge_mm));
            plan.need(need);
            let why = "the sun stands in few places: no map of the directions between, each at least a byte a vertex";
            let saved = CUBE.saturating_sub(directions) * vertices as u64;
            plan.leave_out(LeftOut::new("sun visibility of a whole sky", why, saved, None));
        }
        Err(why) => plan.leave_out(LeftOut::new(SUN, why, vertices as u64, None)),
    }
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
