//! The plan of branches and wind: beam fit, motion texture and the bend in the vertex stage. Each is needed only where
//! something moves.

use super::{LeftOut, Need, Plan};
use mesophyll_fit_branch::beam::basis;
use mesophyll_manifest::Manifest;
use mesophyll_placed::Placed;
use mesophyll_placed::branch::{self, MOTION_SIDE};
use mesophyll_placed::ledger::Ledger;
use mesophyll_plant::taper::TERMS;

/// Lists what branches and wind need, or the reason why they need nothing.
pub fn branches(manifest: &Manifest, placed: &Placed, plan: &mut Plan, ledger: &Ledger) {
    for (b, (twig, mesh)) in manifest.branches.iter().zip(&placed.twigs) {
        let bytes = (mesh.positions.len() * 32 + mesh.indices.len() * 4) as u64;
        let why = if b.fit.is_some() { "a branch of the scene, as it was measured" } else { "a branch of the scene" };
        let mut need = Need::new(format!("branch {}", b.name), why);
        need.amount = Some(format!(
            "{} mm, taper {:.4}, load {:.4} mm, {} triangles",
            twig.length,
            twig.taper,
            twig.load,
            mesh.triangles()
        ));
        need.bytes = Some(bytes);
        plan.need(need);
    }
    let coefficients = (TERMS * (basis::DEGREE + 1) * 8) as u64;
    let of_plants = placed.winds.iter().flat_map(|w| w.plants.iter().flatten()).map(|p| p.limbs.0.len()).sum::<usize>();
    let bent = placed.bends.as_ref().map_or(0, |b| b.branches.len()) + of_plants;
    if placed.moves().plants() {
        let ms = ledger.entries().iter().find(|e| e.action == "fit" && e.what == "beam").map_or(0.0, |e| e.ms);
        let mut need = Need::new("beam fit", "branches bend: four coefficients each, from one fit of all tapers");
        need.amount = Some(format!("{} of {TERMS} numbers, {ms:.1} ms (measured)", bent));
        need.bytes = Some(coefficients);
        plan.need(need);
    } else {
        let why = match (manifest.branches.is_empty(), &manifest.wind) {
            (true, None) => "nothing bends: the scene has no branches and no wind",
            (true, Some(_)) => "nothing bends: the scene has wind and no branches",
            (false, None) => "nothing bends: no branch carries a load, and there is no wind",
            (false, Some(_)) => "nothing bends: no branch carries a load, and none leans in the wind",
        };
        plan.leave_out(LeftOut::new(
            "beam fit",
            format!("{why}; no deformation in the vertex shader"),
            coefficients,
            None,
        ));
    }
    let texture = (MOTION_SIDE * MOTION_SIDE * 8) as u64;
    if let Some(motion) = placed.bends.as_ref().and_then(|b| b.motion.as_ref()) {
        let mut need = Need::new("motion texture", "branches sway: one texture for all, sampled in the vertex stage");
        need.amount = Some(format!("{0}x{0} texels, {1:.2} to {2:.2} Hz", motion.size, motion.lowest, motion.highest));
        need.bytes = Some(texture);
        plan.need(need);
    } else {
        let why = match &manifest.wind {
            None => "the scene has no wind; no deformation by it in the vertex shader either",
            Some(_) if manifest.branches.is_empty() => "the wind has no branch to sway",
            Some(_) if branch::sways(manifest) => "nothing sways",
            Some(_) => "no branch leans in the wind",
        };
        plan.leave_out(LeftOut::new("motion texture", why, texture, None));
    }
    plants(manifest, placed, plan);
}

/// Plants in the wind: their motion textures, and the sections that carry them in the vertex stage.
fn plants(manifest: &Manifest, placed: &Placed, plan: &mut Plan) {
    if manifest.plants.is_empty() {
        return;
    }
    // A section takes three texels of four numbers, and every vertex of bark has the number of its section.
    let Some(winds) = &placed.winds else {
        let vertices: usize = placed.wood.iter().map(|w| w.mesh.positions.len()).sum();
        let leaves = placed.placements.len();
        let why = match &manifest.wind {
            None => {
                "the scene has no wind: plants stand as they are; no motion textures, no sections in the vertex stage"
            }
            Some(_) => "the wind does not move the plants: no motion textures, no sections in the vertex stage",
        };
        plan.leave_out(LeftOut::new("plants in the wind", why, (4 * vertices + 48 * leaves) as u64, None));
        return;
    };
    let why = "plants sway: posed in double precision for each picture's time, carried by sections in the vertex stage";
    let mut need = Need::new("plants in the wind", why);
    let textures = winds.motions.len() + mesophyll_placed::flutter::TEXTURES * winds.gusts.len();
    need.amount =
        Some(format!("{} sections, {textures} motion textures of {MOTION_SIDE}x{MOTION_SIDE}", winds.section_count()));
    need.bytes = Some((48 * winds.section_count() + textures * MOTION_SIDE * MOTION_SIDE * 8) as u64);
    plan.need(need);
}
