//! The plan of light between leaves: whether there is any, and the settings of its transfer.

use super::{PlanNeed, PlanOmission, ScenePlan, TransferPlan, levels, shared_light};
use crate::Result;
use crate::manifest::{SceneManifest, SceneShadows, SceneTransfer};
use crate::placed::PlacedScene;
use crate::placed::daylight::sun_directions;
use crate::placed::placement::LeafPlacement;
use glam::DVec3;
use mesophyll_fits::transfer::BYTES_AN_ENTRY;
use mesophyll_transport::transfer::TransferMethod;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Number of bands of a glossy leaf under a light that stands still: all that the renderer supports.
pub(crate) const GLOSS_BANDS: usize = 7;

/// The folder of a run's own transfer of a scene. A window's light moves, so its transfer is stored beside that of a
/// check.
pub fn folder(manifest: &SceneManifest, bands: Option<usize>, out: &Path) -> PathBuf {
    let bands = bands.map_or(String::new(), |b| format!("-{b}-bands"));
    out.join("fits").join(format!("{}-transfer{bands}", manifest.name))
}

/// Number of bands of the light where it moves and the scene does not state the number, as in the paper (Wang et al.
/// 2005, §4).
const BANDS: usize = 5;
/// The name of light between leaves in the plan.
const NAME: &str = "light between leaves";
/// The name in the plan of the sun's shadows that are computed beforehand.
const SUN: &str = "sun visibility";
/// Number of directions in the upper half of the source's cube map (Wang et al. 2005, §4).
const CUBE: u64 = 32 * 32 * 6 / 2;

/// Whether the sun's shadows on leaves and wood are computed beforehand. If not, the error is the reason.
///
/// # Errors
/// A sentence with the reason.
pub fn sun_visibility(manifest: &SceneManifest, placed: &PlacedScene) -> std::result::Result<(), &'static str> {
    match &manifest.transfer {
        _ if manifest.sun.is_none() => Err("the scene has no sun"),
        None => Err("the scene does not ask for it: shadow maps are drawn in the picture's own time"),
        Some(t) if t.shadows == SceneShadows::Maps => Err("the scene asks for shadow maps"),
        _ if stands_alone(manifest, placed) => Err("one leaf stands alone"),
        // The window makes a map for every place that its sun is moved to. Pictures have none for other places of the
        // sun.
        _ if !placed.free && manifest.sun.as_ref().is_some_and(|s| s.moves) => {
            Err("the sun may stand anywhere: shadow maps follow it")
        }
        _ if placed.moves().plants() => Err("branches bend, and shadows with them: shadow maps follow them"),
        _ => Ok(()),
    }
}

/// Whether a ball is in the picture of any perspective view, with a small margin.
fn in_view(manifest: &SceneManifest, centre: DVec3, radius: f64) -> bool {
    let aspect = f64::from(manifest.check.width) / f64::from(manifest.check.height.max(1));
    manifest.perspectives().any(|view| {
        let camera = &view.camera;
        let [ahead, right, above] = camera.axes();
        let half = 1.02 * camera.half_height();
        let d = centre - camera.eye;
        let depth = d.dot(ahead);
        let within = |across: f64, half: f64| across.abs() <= half * depth + radius * half.hypot(1.0);
        depth > -radius && within(d.dot(right), half * aspect) && within(d.dot(above), half)
    })
}

/// Whether the views alone decide what is ever shown. They do where camera and leaves do not move, and where no film is
/// drawn, whose frames may be wider.
pub fn views_decide(manifest: &SceneManifest, placed: &PlacedScene) -> bool {
    !placed.free && !placed.moves().any() && !manifest.fades()
}

/// Whether a leaf certainly lies outside of every picture, so that no view ever shows it.
pub fn unseen(manifest: &SceneManifest, placed: &PlacedScene, p: &LeafPlacement) -> bool {
    views_decide(manifest, placed) && ball(placed, p).is_some_and(|(centre, radius)| !in_view(manifest, centre, radius))
}

/// Whether no leaf has another leaf, wood or ground beside it.
fn stands_alone(manifest: &SceneManifest, placed: &PlacedScene) -> bool {
    // A mesh of the scene's own may contain many leaves, whereas a fit's blade is one.
    let one_blade = manifest.leaves.iter().all(|l| l.mesh.is_none() && l.discs.is_none());
    placed.placements.len() < 2 && placed.wood.is_empty() && placed.ground.is_none() && one_blade
}

/// Decides about light between leaves.
///
/// # Errors
/// [`crate::Error::Usage`] for a transfer that needs more memory than there is.
pub fn between(manifest: &SceneManifest, placed: &PlacedScene, plan: &mut ScenePlan) -> Result<()> {
    let Some(asked) = &manifest.transfer else {
        plan.leave_out(PlanOmission::new(
            NAME,
            "the scene has no [transfer]: every leaf is lit as if it stood alone",
            0,
            None,
        ));
        return Ok(());
    };
    let [along, across] = asked.anchors;
    let shines = |k: usize| manifest.leaves[k].uniform().is_none_or(|u| u.gloss().is_some());
    let gloss: Vec<bool> =
        plan.leaves.iter().enumerate().map(|(k, l)| shines(k) && l.sides.iter().any(|s| s.gloss)).collect();
    let seen: Vec<bool> = placed.placements.iter().map(|p| !unseen(manifest, placed, p)).collect();
    let sources = shared_light::sources(manifest);
    let own = shared_light::with_anchors(&seen, &sources);
    let of = |which: &dyn Fn(usize) -> bool, bands: usize| {
        let placements = placed.placements.iter().enumerate().filter(|(k, _)| which(*k)).map(|(_, p)| p);
        rows(asked, placements, &gloss, bands) as u64
    };
    let entries = |bands: usize| of(&|k| own[k], bands) * (bands * bands * 8) as u64;
    if stands_alone(manifest, placed) {
        let why = "one leaf stands alone: no other sends it light or hides the sky";
        let bytes = entries(asked.bands.unwrap_or(BANDS));
        plan.leave_out(PlanOmission::new(NAME, why, bytes, None));
        return Ok(());
    }
    let moves = placed.free || manifest.sun_moves();
    let bands = asked.bands.or_else(|| moves.then_some(BANDS));
    let beside = seen.iter().filter(|seen| !**seen).count();
    let copies = (0..own.len()).filter(|k| seen[*k] && !own[*k]).count();
    // An existing transfer is only read. If it turns out to be of another scene, the fit checks the memory.
    if !may_be_there(manifest, placed, bands) {
        let count = of(&|k| own[k], bands.unwrap_or(GLOSS_BANDS)) * bands.map_or(1, |b| b * b) as u64;
        let what = format!(
            "{}: transfer: {count} entries ({along} by {across} anchors on each of {} leaves, {})",
            manifest.path.display(),
            own.iter().filter(|own| **own).count(),
            bands.map_or("one column".into(), |b| format!("{b} bands"))
        );
        mesophyll_files::memory::require(count.saturating_mul(BYTES_AN_ENTRY), &what)?;
    }
    let columns = bands.map_or(1, |b| b * b) as u64;
    if copies > 0 {
        let why = format!("{copies} of {} leaves show the light of another copy of their list", own.len());
        let saved = of(&|k| seen[k] && !own[k], bands.unwrap_or(GLOSS_BANDS)) * columns * 8;
        plan.leave_out(PlanOmission::new("light at every copy", why, saved, None));
    }
    if beside > 0 {
        let why = format!("no view shows {beside} of {} leaves: nothing arrives at them", placed.placements.len());
        let saved = of(&|k| !seen[k], bands.unwrap_or(BANDS)) * columns * 8;
        plan.leave_out(PlanOmission::new("light at leaves beside the pictures", why, saved, None));
    }
    let eyes = levels::eyes(manifest, placed);
    let (mut far, mut finer) = (0, 0);
    // Of copies that show the same light, the one that is nearest to an eye decides.
    let mut levels_of: BTreeMap<usize, usize> = BTreeMap::new();
    for (k, p) in placed.placements.iter().enumerate().filter(|(k, _)| seen[*k]) {
        let finest = ball(placed, p).map_or(0, |ball| levels::finest(ball, asked.anchors, &eyes));
        let of = levels_of.entry(shared_light::source(&sources, k)).or_insert(finest);
        *of = finest.min(*of);
    }
    for (k, finest) in levels_of {
        let p = &placed.placements[k];
        far += usize::from(finest > 0);
        finer += levels::finer(asked.anchors, finest) * rows_an_anchor(gloss[p.leaf], bands.unwrap_or(GLOSS_BANDS));
    }
    if far > 0 {
        let why = format!(
            "no view comes near enough to {far} leaves to tell their anchors apart: coarser ones do; so much at most, \
             because leaves that others hide have no anchors of their own"
        );
        let saved = (finer * bands.map_or(1, |b| b * b) * 8) as u64;
        plan.leave_out(PlanOmission::new("the finest light at leaves far away", why, saved, None));
    }
    let shadows = sun_visibility(manifest, placed);
    plan.light.between = Some(TransferPlan { bands, sun_visibility: shadows.is_ok() });
    plan.light.sky_bands = plan.light.sky_bands.max(bands.unwrap_or(0));
    let mut need =
        PlanNeed::new(NAME, "the scene asks for it: leaves hide the sky from each other and light each other");
    let way = match asked.method {
        TransferMethod::Paths => "paths",
        TransferMethod::AmbientOcclusion => "rays (ambient occlusion)",
    };
    need.amount = Some(format!("{along}x{across} anchors a leaf, {} {way} each", asked.paths));
    plan.need(need);
    let vertices: usize =
        placed.placements.iter().filter_map(|p| placed.leaves[p.leaf].mesh.as_ref()).map(|m| m.positions.len()).sum();
    match shadows {
        Ok(()) => {
            let directions = sun_directions(manifest).len() as u64;
            let mut need = PlanNeed::new(
                SUN,
                "the scene asks for it: every vertex knows its share of the sun, and no shadow map is looked into",
            );
            need.amount = Some(format!("{directions} maps, edges of at most {} mm", asked.edge_mm));
            plan.need(need);
            let why = "the sun stands in few places: no map of the directions between, each at least a byte a vertex";
            let saved = CUBE.saturating_sub(directions) * vertices as u64;
            plan.leave_out(PlanOmission::new("sun visibility of a whole sky", why, saved, None));
        }
        Err(why) => plan.leave_out(PlanOmission::new(SUN, why, vertices as u64, None)),
    }
    match bands {
        Some(bands) => {
            let mut need = PlanNeed::new("operators of the light", "the light moves, or the scene asks for its bands");
            need.amount = Some(format!("{bands} bands: {} columns", bands * bands));
            need.bytes = Some(entries(bands));
            plan.need(need);
        }
        None => {
            let why = "sun and sky stand still: what arrives is one column, the light itself, and loses no band of it";
            let saved = entries(BANDS) - entries(BANDS) / (BANDS * BANDS) as u64;
            plan.leave_out(PlanOmission::new("operators of the light", why, saved, None));
        }
    }
    Ok(())
}

/// Whether a transfer exists where this scene's would be read from: the one that the scene names, or a run's own.
fn may_be_there(manifest: &SceneManifest, placed: &PlacedScene, bands: Option<usize>) -> bool {
    let named = manifest.transfer.as_ref().and_then(|t| t.fit.as_ref()).map(|f| manifest.resolve(f));
    let own = placed.out.as_ref().map(|out| folder(manifest, bands, out));
    [named, own].into_iter().flatten().any(|place| place.join("fit.toml").is_file())
}

/// The ball that contains a placement's leaf: centre and radius.
pub fn ball(placed: &PlacedScene, p: &LeafPlacement) -> Option<(DVec3, f64)> {
    let (centre, radius) = placed.leaves[p.leaf].mesh.as_ref()?.bounds();
    Some((p.transform.transform_point3(centre), radius * p.transform.x_axis.truncate().length()))
}

/// Number of rows of all leaves together, if each is one piece.
fn rows<'a>(
    asked: &SceneTransfer,
    placements: impl Iterator<Item = &'a LeafPlacement>,
    gloss: &[bool],
    bands: usize,
) -> usize {
    let anchors: usize = asked.anchors.iter().product();
    placements.map(|p| anchors * rows_an_anchor(gloss[p.leaf], bands)).sum()
}

/// Rows of one anchor on a leaf.
fn rows_an_anchor(glossy: bool, bands: usize) -> usize {
    6 + if glossy { bands * bands } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::{PerspectiveView, SceneView};
    use mesophyll_transport::ReferenceCamera;

    /// A ball that the picture's edge cuts is in the picture. One beside, behind or above it is not.
    #[test]
    fn a_ball_is_in_a_picture_or_beside_it() {
        let mut manifest: SceneManifest = toml::from_str("schema = 1\nname = \"a\"").unwrap();
        (manifest.check.width, manifest.check.height) = (200, 100);
        let (eye, target, up) = (-100.0 * DVec3::Y, DVec3::ZERO, DVec3::Z);
        let camera = ReferenceCamera { eye, target, up, fov_y_deg: 90.0 };
        manifest.views = vec![SceneView::Perspective(PerspectiveView::new("front", camera))];
        let seen = |x: f64, y: f64, z: f64| in_view(&manifest, DVec3::new(x, y, z), 10.0);
        assert!(seen(0.0, 0.0, 0.0) && seen(-199.0, 0.0, 0.0) && seen(0.0, 0.0, 99.0));
        // The edge is at 200 and at 100. A ball reaches √5 and √2 times its radius beyond.
        assert!(seen(215.0, 0.0, 0.0) && !seen(235.0, 0.0, 0.0));
        assert!(seen(0.0, 0.0, -110.0) && !seen(0.0, 0.0, -125.0));
        assert!(seen(0.0, -105.0, 0.0) && !seen(0.0, -115.0, 0.0) && seen(3900.0, 2000.0, 1900.0));
    }
}
