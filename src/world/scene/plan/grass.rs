//! The plan of lawns: slices for the renderer, and the blades that they represent.

use super::{PlanNeed, PlanOmission, ScenePlan};
use crate::Result;
use crate::manifest::SceneManifest;
use crate::placed::PlacedScene;
use crate::placed::fits::source::FitFreshness;
use mesophyll_fits::grass::bytes;

/// Lists every lawn, and what is left out of it.
///
/// # Errors
/// [`crate::Error::Input`] for the record of a fit that cannot be read.
pub fn lawns(manifest: &SceneManifest, placed: &PlacedScene, plan: &mut ScenePlan) -> Result<()> {
    for grass in &placed.grass {
        let config = &manifest.grass[grass.index];
        let [nx, ny] = grass.tiles;
        let moved = if grass.irregular.is_some() { ", with the meadow moved in each" } else { "" };
        let why = format!("a lawn of {nx} x {ny} rectangles of {} blades each{moved}", grass.plant.leaves.len());
        let mut need = PlanNeed::new(format!("grass {}", grass.name), why);
        match &config.fit {
            Some(fit) => {
                let record = manifest.resolve(fit).join("fit.toml");
                need.hash = Some(mesophyll_files::hash::file(&record)?);
                need.status = Some(FitFreshness::Reuse);
                need.amount = Some(format!("slices of {}", fit.display()));
            }
            None => {
                let options = grass.options(manifest);
                let ([w, h], n) = (options.texels, options.slices);
                // Whether the level slice is seen is known only after the slices have been made.
                let kept = match placed.free || manifest.sun_moves() {
                    true => "",
                    false => " (handed over only where a view or the sun looks down on the lawn)",
                };
                let upright = format!("{n} slices across x and {n} across y of {w}x{h} texels");
                need.amount = Some(format!("{upright}, and a level one{kept}, made now"));
                need.bytes = Some(bytes(&options, grass.period) as u64);
            }
        }
        plan.need(need);
        if let Some(leaning) = &grass.leaning {
            let side = 1e-3 / leaning.gusts.turn()[0].length();
            let why = "blades lean by a map of gusts that moves with the wind";
            let mut need = PlanNeed::new(format!("wind in {}", grass.name), why);
            need.amount = Some(format!("{side:.1} m a side, {0} x {0} texels", leaning.gusts.motion.size));
            need.bytes = Some(8 * (leaning.gusts.motion.size as u64).pow(2));
            plan.need(need);
        } else {
            let why = match manifest.wind {
                None => "the scene has no wind: no code that leans the blades, no map of gusts",
                Some(_) => "no wind leans it (lean_per_m_s): no code that leans the blades, no map of gusts",
            };
            plan.leave_out(PlanOmission::new(format!("wind in {}", grass.name), why, 0, None));
        }
    }
    Ok(())
}
