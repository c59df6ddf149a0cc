//! Refuses plants in a wind that cannot be posed, and finds the kinds of their flutter.

use super::SwayingPlant;
use crate::manifest::{SceneManifest, StatedFlutter};
use crate::placed::plant::PlacedPlant;
use crate::placed::{Error, Result};
use mesophyll_plants::mechanics::wind::Sway;
use mesophyll_plants::pose::FREELY;

/// The largest number of cross-sections of all plants together, which the smallest buffers of an adapter hold.
const MOST_SECTIONS: usize = 4_000_000;
/// The largest number of vertices of bark of all plants together. Every place counts separately.
const MOST_BARK: usize = 20_000_000;

/// Refuses a stated load that bends a branch farther than a beam bends.
pub(super) fn held(manifest: &SceneManifest, planted: &[PlacedPlant], plants: &[Option<SwayingPlant>]) -> Result<()> {
    for (k, swaying) in plants.iter().enumerate() {
        let Some(swaying) = swaying else { continue };
        for branch in (0..swaying.loads.len()).filter(|b| swaying.loads[*b] != 0.0) {
            let tips = (0..swaying.towards.len()).map(|place| {
                let [x, y] = swaying.weight(place, branch);
                x.hypot(y) * swaying.limbs.0[branch].beam_tip()
            });
            // A tip that is not a number counts as too far.
            let tip = tips.fold(0.0f64, |a, b| if b <= a { a } else { b });
            if !(tip <= FREELY) {
                let name = &planted[k].plant.branches[branch].name;
                let found = format!("a load under which its tip goes by {tip:.3e} of its length");
                let field = format!("plant {}: branch \"{name}\"", k + 1);
                return Err(Error::unexpected(&manifest.path, &field, found, format!("at most {FREELY}")));
            }
        }
    }
    Ok(())
}

/// All kinds of flutter of a scene, each once.
pub(super) fn flutters<'a>(
    manifest: &'a SceneManifest,
    planted: &[PlacedPlant],
    sways: &[Vec<Option<(Sway, f64)>>],
) -> Result<Vec<&'a StatedFlutter>> {
    let mut out: Vec<&StatedFlutter> = Vec::new();
    for (k, ((said, one), sways)) in manifest.plants.iter().zip(planted).zip(sways).enumerate() {
        let Some(flutter) = said.flutter.as_ref().filter(|_| !one.plant.leaves.is_empty()) else { continue };
        if sways.iter().all(Option::is_none) {
            let what = "leaves cannot flutter where no branch sways; expected branches with a length and a mass";
            return Err(Error::field(&manifest.path, &format!("plant {}: flutter", k + 1), what));
        }
        if !out.contains(&flutter) {
            out.push(flutter);
        }
    }
    Ok(out)
}

/// Refuses too many cross-sections and vertices of bark before any of them are made.
pub(super) fn bounded(
    manifest: &SceneManifest,
    planted: &[PlacedPlant],
    plants: &[Option<SwayingPlant>],
) -> Result<()> {
    let mut bark = 0usize;
    for (k, (one, swaying)) in planted.iter().zip(plants).enumerate() {
        let Some(swaying) = swaying else { continue };
        let wood: usize = one.plant.branches.iter().map(|b| b.wood.positions.len()).sum();
        let apart = if one.groups.is_some() { 1 } else { one.places.len() };
        bark = bark.saturating_add(wood.saturating_mul(apart));
        let sections = swaying.sections.end();
        if sections > MOST_SECTIONS || bark > MOST_BARK {
            let found =
                format!("plants in the wind with {sections} cross-sections and {bark} vertices of bark up to here");
            let expected = format!("at most {MOST_SECTIONS} and {MOST_BARK}");
            return Err(Error::unexpected(&manifest.path, &format!("plant {}: count", k + 1), found, expected));
        }
    }
    Ok(())
}
