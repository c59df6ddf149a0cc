//! What a fit of the scene to its pictures needs: derivatives by the numbers that are unknown, and by no others.

use super::{PlanNeed, PlanOmission, ScenePlan};
use crate::manifest::{AREA, SceneManifest};

/// Bytes of one quantity's derivatives of a pixel: three channels, in two pictures that are drawn apart.
const BYTES: u64 = 2 * 3 * 8;

/// Lists the derivatives of a scene with an `[unknown]`, and what has none.
pub fn unknowns(manifest: &SceneManifest, plan: &mut ScenePlan) {
    let Some(unknown) = manifest.unknown.as_ref().filter(|unknown| unknown.count() > 0) else { return };
    let (mut asked, mut rest) = (Vec::new(), Vec::new());
    for leaf in manifest.leaves.iter().filter(|leaf| leaf.like.is_none()) {
        let own = unknown.leaves.get(&leaf.name);
        for number in leaf.unknowable().0.iter().chain(leaf.discs.as_ref().map(|_| &AREA)) {
            let name = format!("leaf.{}.{number}", leaf.name);
            let list = if own.is_some_and(|own| own.iter().any(|n| n == number)) { &mut asked } else { &mut rest };
            list.push(name);
        }
    }
    let sky: &[&str] = if manifest.physical_sky().is_some() { &["scale", "turbidity"] } else { &["scale"] };
    for (table, there, all, own) in [
        ("ground", manifest.ground.is_some(), &["albedo"][..], &unknown.ground),
        ("sky", manifest.sky.is_some(), sky, &unknown.sky),
        ("sun", manifest.sun.is_some(), &["irradiance"], &unknown.sun),
    ] {
        for number in all.iter().filter(|_| there) {
            let list = if own.iter().any(|n| n == number) { &mut asked } else { &mut rest };
            list.push(format!("{table}.{number}"));
        }
    }
    let pictures = manifest.taken.iter().filter(|picture| !picture.held_out).count() as u64;
    let bytes = BYTES * pictures * u64::from(manifest.check.width) * u64::from(manifest.check.height);
    plan.need(PlanNeed {
        amount: Some(asked.join(", ")),
        bytes: Some(bytes * asked.len() as u64),
        ..PlanNeed::new(
            "derivatives",
            "`fit scene` finds these numbers in the scene's pictures; nothing else needs them",
        )
    });
    for name in rest {
        let what = format!("derivative by {name}");
        plan.leave_out(PlanOmission::new(
            what,
            "it is not in [unknown], so that its value is the scene's",
            bytes,
            None,
        ));
    }
}
