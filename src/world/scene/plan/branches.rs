//! The plan of plants that move: beam fit, motion textures, and the sections that carry plants in the vertex stage.
//! Each is needed only where something moves.

use super::{PlanNeed, PlanOmission, ScenePlan};
use crate::manifest::SceneManifest;
use crate::placed::PlacedScene;
use crate::placed::flutter::TEXTURES;
use crate::placed::ledger::Ledger;
use crate::placed::sway::MOTION_SIDE;
use mesophyll_fits::branch::beam::basis;
use mesophyll_plants::mechanics::taper::TERMS;

/// Lists what moving plants need, or the reason why they need nothing.
pub fn branches(manifest: &SceneManifest, placed: &PlacedScene, plan: &mut ScenePlan, ledger: &Ledger) {
    measured(manifest, plan);
    shared(placed, plan);
    let coefficients = (TERMS * (basis::DEGREE + 1) * 8) as u64;
    let texture = (MOTION_SIDE * MOTION_SIDE * 8) as u64;
    let Some(winds) = &placed.winds else {
        let why = match (manifest.plants.is_empty(), &manifest.wind) {
            (true, None) => "nothing bends: the scene has no plants and no wind",
            (true, Some(_)) => "nothing bends: the scene has wind and no plants",
            (false, None) => "nothing bends: no branch has a load that bends it, and there is no wind",
            (false, Some(_)) => "nothing bends: no branch has a load that bends it, and no plant moves in the wind",
        };
        let told = format!("{why}; no deformation in the vertex shader");
        plan.leave_out(PlanOmission::new("beam fit", told, coefficients, None));
        plan.leave_out(PlanOmission::new("motion texture", unswayed(manifest), texture, None));
        if !manifest.plants.is_empty() {
            // A section takes three vectors of four numbers, and every vertex of bark has the number of its section.
            let vertices: usize = placed.wood.iter().map(|w| w.mesh.positions.len()).sum();
            let bytes = (4 * vertices + 48 * placed.placements.len()) as u64;
            plan.leave_out(PlanOmission::new("plants in the wind", why, bytes, None));
        }
        return;
    };
    let bent = winds.plants.iter().flatten().map(|p| p.limbs.0.len()).sum::<usize>();
    let ms = ledger.entries().iter().find(|e| e.action == "fit" && e.what == "beam").map_or(0.0, |e| e.ms);
    let mut need = PlanNeed::new("beam fit", "branches bend: four coefficients each, from one fit of all tapers");
    need.amount = Some(format!("{bent} of {TERMS} numbers, {ms:.1} ms (measured)"));
    need.bytes = Some(coefficients);
    plan.need(need);
    let textures = winds.motions.len() + TEXTURES * winds.gusts.len();
    if textures > 0 {
        let mut need =
            PlanNeed::new("motion texture", "plants sway: branches of about the same resonance share a texture");
        need.amount = Some(format!("{textures} of {MOTION_SIDE}x{MOTION_SIDE} texels"));
        need.bytes = Some(textures as u64 * texture);
        plan.need(need);
    } else {
        plan.leave_out(PlanOmission::new("motion texture", unswayed(manifest), texture, None));
    }
    let why = "plants move: the adapter poses their branches for each picture's time, and sections carry the rest in \
        the vertex stage";
    let mut need = PlanNeed::new("plants in the wind", why);
    need.amount = Some(format!("{} sections", winds.section_count()));
    need.bytes = Some(48 * winds.section_count() as u64);
    plan.need(need);
    if manifest.wind.as_ref().is_some_and(|w| w.simplified) {
        let why = "the wind is simplified: surfaces are lit as if they had not turned, and lengths are corrected in \
            closed form";
        plan.leave_out(PlanOmission::new("turns of normals", why, 0, None));
    }
}

/// Plants that are stored once, and what sharing poses costs.
fn shared(placed: &PlacedScene, plan: &mut ScenePlan) {
    for stand in &placed.stands {
        let why = match stand.sections {
            0 => "a plant that stands often is stored once".to_string(),
            _ => format!(
                "a plant that stands often is stored once, and its plants share poses: they differ by place and size \
                 alone from others with the same pose, and gusts reach them {:.1} s too early or too late on average",
                stand.off
            ),
        };
        let mut need = PlanNeed::new("plants that are stored once", why);
        need.amount = Some(format!("{} plants in {} poses", stand.places.len(), stand.poses));
        // The place of a plant for pictures and for shadow maps, for leaves and wood.
        need.bytes = Some(4 * 64 * stand.places.len() as u64);
        plan.need(need);
    }
}

/// Why no motion texture is needed.
fn unswayed(manifest: &SceneManifest) -> &'static str {
    match &manifest.wind {
        None => "the scene has no wind; no deformation by it in the vertex shader either",
        Some(_) if manifest.plants.is_empty() => "the wind has no plant to sway",
        Some(_) => "the wind moves no branch",
    }
}

/// Branches of plants whose taper and load were measured.
fn measured(manifest: &SceneManifest, plan: &mut ScenePlan) {
    for (k, plant) in manifest.plants.iter().enumerate() {
        for own in &plant.branches {
            let Some(fit) = &own.fit else { continue };
            let called = match (&own.name, own.level) {
                (Some(name), _) => format!("branch {name}"),
                (None, level) => format!("branches of level {}", level.unwrap_or(0)),
            };
            let why = format!("plant {}: taper and load as they were measured", k + 1);
            let mut need = PlanNeed::new(called, why);
            need.amount = Some(fit.display().to_string());
            plan.need(need);
        }
    }
}
