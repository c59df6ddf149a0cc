//! Warnings about unusual places and sizes of leaves: a mesh in another unit than that of its scene, or a leaf that no
//! view shows.

use crate::Result;
use crate::manifest::SceneManifest;
use crate::placed::{PlacedScene, leaf::PlacedLeaf, placement::LeafPlacement, plant::PlacedShape};
use glam::DVec3;
use mesophyll_transport::ReferenceCamera;

/// A mesh that is larger or smaller than the scanned blade by this factor is assumed to be in another unit.
const STRANGE: f64 = 50.0;

/// A blade that is larger or smaller than the leaf that is drawn for it by this factor is probably no single leaf.
const OTHER: f64 = 5.0;

/// The sizes (mm) of plants' wood that are taken as they are; the tallest tree has 116 m.
const PLANTS: std::ops::RangeInclusive<f64> = 10.0..=300_000.0;

/// A sentence for each unusual property, with sizes in mm.
///
/// # Errors
/// [`crate::Error::Input`] for a fit's blade that cannot be read.
pub fn warnings(manifest: &SceneManifest, placed: &PlacedScene) -> Result<Vec<String>> {
    let mut out = Vec::new();
    for leaf in &placed.leaves {
        out.extend(another_unit(manifest, leaf)?);
        out.extend(unseen(manifest, placed, leaf));
    }
    out.extend(other_blades(manifest, placed));
    let of_stands = placed.stands.iter().flat_map(|s| s.wood.iter().map(|w| (w, s.places.first().map(|p| p.0))));
    for (wood, place) in placed.wood.iter().map(|w| (w, w.places.first().copied())).chain(of_stands) {
        let scale = place.map_or(1.0, |place| place.x_axis.truncate().length());
        let size = 2.0 * wood.mesh.bounds().1 * scale;
        if size > 0.0 && !PLANTS.contains(&size) {
            let what = "the lengths of its file are taken for metres, as glTF says; `scale` makes it another size";
            out.push(format!("plant \"{}\" is {} mm across: {what}", wood.name, short(size)));
        }
    }
    Ok(out)
}

fn another_unit(manifest: &SceneManifest, leaf: &PlacedLeaf) -> Result<Option<String>> {
    let config = &manifest.leaves[leaf.index];
    let (Some(_), Some(drawn), Some(fitted)) = (&config.mesh, &leaf.mesh, &leaf.fitted) else { return Ok(None) };
    let Some(scanned) = fitted.blade()? else { return Ok(None) };
    let (drawn, scanned) = (2.0 * drawn.bounds().1, 2.0 * scanned.bounds().1);
    let ratio = drawn / scanned;
    if (1.0 / STRANGE..=STRANGE).contains(&ratio) {
        return Ok(None);
    }
    Ok(Some(format!(
        "leaf \"{}\": mesh: {} is {} mm across, {ratio:.3e} times the {} mm of the blade that was scanned; \
         if its lengths are not in metres, say mesh_unit = \"mm\" or \"cm\"",
        config.name,
        leaf.mesh_path.display(),
        short(drawn),
        short(scanned)
    )))
}

/// A warning for each plant whose blades are far larger or smaller than the leaf that is drawn for them, as where a
/// card shows a whole twig.
fn other_blades(manifest: &SceneManifest, placed: &PlacedScene) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for (plant, PlacedShape { leaf, across_mm: across, scale, leaf_scale: own }) in &placed.shapes {
        let Some(mesh) = placed.leaves.get(*leaf).and_then(|leaf| leaf.mesh.as_ref()) else { continue };
        let drawn = 2.0 * mesh.bounds().1 * scale;
        let start = format!("plant \"{plant}\": its blades are drawn as the leaf \"{}\"", manifest.leaves[*leaf].name);
        if (1.0 / OTHER..=OTHER).contains(&(across / drawn)) || out.iter().any(|known| known.starts_with(&start)) {
            continue;
        }
        out.push(format!(
            "{start}, {} mm across, and are {} mm across themselves; `leaf_scale = {}` draws it as large, and a leaf's \
             `mesh` and `part` the plant's own triangles",
            short(drawn),
            short(*across),
            short(own * across / drawn)
        ));
    }
    out
}

/// A warning for a placed leaf that no view shows, or that is smaller than a pixel in all views.
fn unseen(manifest: &SceneManifest, placed: &PlacedScene, leaf: &PlacedLeaf) -> Option<String> {
    let (centre, radius) = leaf.mesh.as_ref()?.bounds();
    // Of plants that are stored once, only the leaves near to the cameras are known here.
    if placed.placements.iter().any(|p| p.leaf == leaf.index && p.frame > 0) {
        return None;
    }
    let (mut largest, mut sizes, mut first) = (0.0f64, Vec::new(), None);
    for p in placed.placements.iter().filter(|p| p.leaf == leaf.index) {
        for view in manifest.perspectives() {
            let LeafPlacement { transform, .. } = placed.at_time(p, manifest.time_of(view));
            let (centre, radius) = (transform.transform_point3(centre), radius * transform.x_axis.truncate().length());
            sizes.push(2.0 * radius);
            first.get_or_insert(centre);
            largest = largest.max(pixels(manifest, &view.camera, centre, radius));
        }
    }
    let (Some(at), true) = (first, largest < 1.0) else { return None };
    let size = sizes.into_iter().fold(0.0, f64::max);
    let how = if largest > 0.0 {
        format!("it covers {largest:.2} of a pixel at most")
    } else {
        "it lies outside every view".into()
    };
    Some(format!(
        "leaf \"{}\": no view shows it: {how} ({} mm across, the first one around [{:.1}, {:.1}, {:.1}] mm)",
        manifest.leaves[leaf.index].name,
        short(size),
        at.x,
        at.y,
        at.z
    ))
}

/// Number of pixels across a ball in a view; 0 where the ball is outside.
fn pixels(manifest: &SceneManifest, camera: &ReferenceCamera, centre: DVec3, radius: f64) -> f64 {
    let (eye, height) = (camera.eye, f64::from(manifest.check.height));
    let (tan, aspect) = (camera.half_height(), f64::from(manifest.check.width) / height);
    let (towards, away) = (camera.axes()[0], centre - eye);
    let distance = away.length();
    if distance <= radius {
        return f64::from(manifest.check.width);
    }
    // The ball is within the cone through the picture's corners, widened by the ball's own angle.
    let corner = (tan * (1.0 + aspect * aspect).sqrt()).atan();
    if towards.angle_between(away) > corner + (radius / distance).asin() {
        0.0
    } else {
        radius / (distance * tan) * height
    }
}

/// The number with three significant digits.
fn short(mm: f64) -> String {
    let digits = if mm > 0.0 { (2 - mm.log10().floor() as i32).clamp(0, 9) } else { 0 };
    format!("{mm:.0$}", digits as usize)
}
