//! The plan of the light: sun, shadow maps and sky; and the models that this scene does not use.

use super::accuracy::{self, AccuracyRow};
use super::transfer::sun_visibility;
use super::{PlanNeed, PlanOmission, ScenePlan};
use crate::Result;
use crate::manifest::{PhysicalSky, SceneManifest, SceneSky, sun_words};
use crate::placed::PlacedScene;
use crate::placed::daylight::{Daylight, levels, sun_direction};
use crate::placed::visible_sides;
use glam::DVec3;
use mesophyll_files::mesh::LeafMesh;
use mesophyll_sky::SkyModel;
use mesophyll_transport::tone::display;
use std::time::Instant;

/// Texels along a side of a shadow map, and of the finest one, which every adapter has.
const SHADOW_SIDE: u64 = 2048;
const FINEST_SIDE: u64 = 8192;

/// Decides about sun, shadows and sky. Where camera and sun are free, shadows are always possible.
///
/// # Errors
/// [`crate::Error::Input`] for a physical sky that the model refuses.
pub fn lights(manifest: &SceneManifest, placed: &PlacedScene, plan: &mut ScenePlan) -> Result<()> {
    let free = placed.free || manifest.sun_moves();
    let shadow_bytes = SHADOW_SIDE * SHADOW_SIDE * 4;
    match (&manifest.sun, sun_direction(manifest)) {
        (Some(sun), Some(direction)) => {
            plan.need(PlanNeed::new("sun", "the scene has one: three numbers and a direction, its disk by its radius"));
            let radius = sun.radius_deg.to_radians();
            let meshes: Vec<Option<&LeafMesh>> = placed.leaves.iter().map(|l| l.mesh.as_ref()).collect();
            let leaves_alone = !free && placed.wood.is_empty() && placed.stands.is_empty();
            let beforehand = sun_visibility(manifest, placed).is_ok();
            match leaves_alone.then(|| visible_sides::shadows(&meshes, &placed.placements, direction, radius)) {
                Some(Err(why)) => plan.leave_out(PlanOmission::new("shadow maps", why, shadow_bytes, None)),
                _ if beforehand && placed.ground.is_none() => {
                    let why = "every vertex knows beforehand what it sees of the sun";
                    plan.leave_out(PlanOmission::new("shadow maps", why, shadow_bytes, None));
                }
                _ => shadows(manifest, placed, plan, radius, shadow_bytes),
            }
        }
        _ => {
            let why = "the scene has no sun: no light loop in the shader, no shadow pass";
            plan.leave_out(PlanOmission::new("sun and shadow maps", why, shadow_bytes, None));
        }
    }
    if let Some(day) = &manifest.day {
        let at = |hour: &f64| {
            let (zenith, azimuth) = day.sun(*hour);
            sun_words(*hour, zenith.to_degrees(), azimuth.to_degrees())
        };
        let hours: Vec<String> = day.hours.iter().map(at).collect();
        plan.need(PlanNeed::new("hours of the day", hours.join("; ")));
    }
    match &manifest.sky {
        Some(SceneSky::Physical(sky)) => physical_sky(manifest, sky, plan)?,
        Some(SceneSky::Picture(_)) => {
            let n = plan.light.sky_bands * plan.light.sky_bands;
            let what = format!("a picture: {n}x3 coefficients, summed over it; drawn behind the leaves");
            plan.need(PlanNeed { bytes: Some(16 * n as u64), ..PlanNeed::new("sky", what) });
        }
        Some(SceneSky::Even(_)) => plan.need(PlanNeed::new(
            "sky",
            "constant: three numbers, and the lobe's directional albedo where a side is glossy",
        )),
        None => plan.leave_out(PlanOmission::new("sky", "the scene has none: its term is not in the shader", 0, None)),
    }
    let mut need = PlanNeed::new("multisampling", "edges show");
    need.amount = Some(format!("{} samples a pixel", plan.light.msaa));
    plan.need(need);
    Ok(())
}

/// Decides how many bands light the leaves, and whether their coefficients are integrated once or come from the
/// polynomials.
fn physical_sky(manifest: &SceneManifest, sky: &PhysicalSky, plan: &mut ScenePlan) -> Result<()> {
    let Some(daylight) = Daylight::of(manifest)? else { return Ok(()) };
    let mut rows = Vec::new();
    for bands in [3usize, 5, 7] {
        let start = Instant::now();
        let error = daylight.truncation(&[bands], manifest.exposure)?[0];
        rows.push(AccuracyRow {
            setting: bands,
            error,
            ms: start.elapsed().as_secs_f64() * 1e3,
            bytes: (16 * bands * bands) as u64,
        });
    }
    let row = plan.choose("sky bands", rows, manifest.tolerated());
    let glossy = plan.leaves.iter().any(|l| l.sides.iter().any(|s| s.gloss));
    // A highlight is sharper than diffuse light, so gloss needs all bands.
    plan.light.sky_bands = if glossy { 7 } else { row.map_or(7, |r| r.setting) };
    let n = plan.light.sky_bands * plan.light.sky_bands;
    let polynomials = plan.light.sun_moves && sky.model == SkyModel::Preetham;
    let how = if polynomials { "from the polynomials" } else { "integrated for this sun and turbidity" };
    let below = match sky.ground_albedo.is_none() && manifest.ground.is_none() {
        true => "; black below the horizon, because the scene has neither sky.ground_albedo nor a [ground]",
        false => "",
    };
    let mut need = PlanNeed::new(
        "sky",
        format!(
            "{}, turbidity {}: {n}x3 coefficients, {how}; drawn behind the leaves{below}",
            sky.model, daylight.turbidity
        ),
    );
    if let Some(row) = row {
        let cost = plan.measured["sky bands"]
            .iter()
            .find(|r| r.setting == plan.light.sky_bands)
            .map_or(row.error, |r| r.error);
        need.amount =
            Some(format!("{} bands, displayed error of diffuse light {cost:.1e} (measured)", plan.light.sky_bands));
    }
    need.bytes = Some(16 * n as u64);
    plan.need(need);
    if polynomials {
        let mut need = PlanNeed::new(
            "sky polynomial (spherical harmonics)",
            "the sun moves: fit sky makes it, milliseconds, before the first picture",
        );
        need.amount = Some("7 bands, sun zenith 0 to 90 degrees, turbidity 2.5 to 6".into());
        plan.need(need);
    }
    Ok(())
}

fn shadows(manifest: &SceneManifest, placed: &PlacedScene, plan: &mut ScenePlan, radius: f64, map_bytes: u64) {
    // Balls around the leaves bound how far a shadow falls, and how wide a leaf is relative to its penumbra.
    let around: Vec<Option<(DVec3, f64)>> =
        placed.leaves.iter().map(|leaf| leaf.mesh.as_ref().map(LeafMesh::bounds)).collect();
    let spheres: Vec<(DVec3, f64)> = placed
        .placements
        .iter()
        .filter_map(|p| {
            around[p.leaf].map(|(c, r)| (p.transform.transform_point3(c), r * p.transform.x_axis.truncate().length()))
        })
        .collect();
    let reach = reach(&spheres);
    let leaf = spheres.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    let share = if spheres.is_empty() { 1.0 } else { (2.0 * radius.tan() * reach / (2.0 * leaf)).min(1.0) };
    let mean = |c: &[f64; 3]| c.iter().sum::<f64>() / 3.0;
    let (sun, sky) = levels(manifest);
    let (sun, sky) = (mean(&sun) / std::f64::consts::PI, mean(&sky));
    // A leaf reflects about a tenth of the light.
    let contrast = display(0.1 * (sun + sky), manifest.exposure) - display(0.1 * sky, manifest.exposure);
    let row = plan.choose("shadow samples", accuracy::shadow_samples(contrast, share, map_bytes), manifest.tolerated());
    let mut need = match sun_visibility(manifest, placed) {
        Ok(()) => {
            PlanNeed::new("shadow maps", "leaves throw shadows on the ground, which are too small for its vertices")
        }
        Err(_) => PlanNeed::new("shadow maps", "leaves can stand in each other's light"),
    };
    if let Some(row) = row {
        let still = !placed.free && !placed.moves().any() && placed.stands.is_empty();
        let (maps, side) = match still.then(|| extents(placed)).flatten() {
            Some((width, height)) => finer(row.setting, width, 2.0 * radius.tan() * 0.5 * height),
            None => (row.setting, SHADOW_SIDE),
        };
        plan.light.shadow_samples = maps as u32;
        plan.light.shadow_resolution = side as u32;
        let error = match maps == row.setting {
            true => format!("displayed error {:.1e} (measured)", row.error),
            false => "fewer and finer ones, because penumbras are narrower than a texel".into(),
        };
        need.amount = Some(format!("{maps} over the sun's disk, {side} texels a side, {error}"));
        need.bytes = Some(row.bytes);
    }
    plan.need(need);
}

/// The width of all that casts shadows, and its height over the lowest point of it or the ground (mm).
fn extents(placed: &PlacedScene) -> Option<(f64, f64)> {
    let boxes: Vec<Option<[DVec3; 2]>> = placed.leaves.iter().map(|leaf| leaf.mesh.as_ref()?.extent()).collect();
    let corners = placed.placements.iter().filter_map(|p| Some((boxes[p.leaf]?, p.transform))).flat_map(|(of, at)| {
        (0..8).map(move |k: usize| at.transform_point3(DVec3::new(of[k & 1].x, of[k >> 1 & 1].y, of[k >> 2].z)))
    });
    let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let ground = placed.ground.as_ref().and_then(|(mesh, _)| Some(mesh.extent()?[0].z));
    let far = high - low;
    (far.max_element() > 0.0).then(|| (far.max_element(), high.z - low.z.min(ground.unwrap_or(low.z))))
}

/// Number of parts of the sun's disk that texels of this width tell apart in a penumbra: within a texel they are one.
pub fn parts_of_sun(penumbra: f64, texel: f64) -> f64 {
    (penumbra / texel).powi(2)
}

/// Fewer and finer maps with as many texels in all, and their side, as far as a map is left for each part of the sun's
/// disk that their texels tell apart in a penumbra of this width (mm).
fn finer(maps: usize, width: f64, penumbra: f64) -> (usize, u64) {
    let (mut maps, mut side) = (maps, SHADOW_SIDE);
    while side < FINEST_SIDE && maps >= 4 {
        if ((maps / 4) as f64) < parts_of_sun(penumbra, width / (2 * side) as f64) {
            break;
        }
        (maps, side) = (maps / 4, 2 * side);
    }
    (maps, side)
}

/// The largest distance (mm) between points of any two of these balls. Balls far from the middle are tried first. A
/// pair cannot be farther apart than both are from the middle together, so that most pairs need no look.
fn reach(balls: &[(DVec3, f64)]) -> f64 {
    let Some((first, _)) = balls.first() else { return 0.0 };
    let (low, high) = balls.iter().fold((*first, *first), |(l, h), (p, _)| (l.min(*p), h.max(*p)));
    let middle = 0.5 * (low + high);
    let mut from_middle: Vec<(f64, DVec3, f64)> = balls.iter().map(|(p, r)| (p.distance(middle) + r, *p, *r)).collect();
    from_middle.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut reach = 0.0f64;
    for (far, a, ra) in &from_middle {
        let hopeful = from_middle.iter().take_while(|(other, ..)| far + other > reach);
        let found = hopeful.map(|(_, b, rb)| a.distance(*b) + ra + rb).fold(0.0, f64::max);
        if found == 0.0 {
            break;
        }
        reach = reach.max(found);
    }
    reach
}

/// Lists models that scenes of plants may have and this one does not.
pub fn absent_models(manifest: &SceneManifest, placed: &PlacedScene, plan: &mut ScenePlan) {
    // H9 ch. 5: (13+1)·(7+1) coefficients, 49 harmonics, three channels, doubles.
    let polynomial = 14 * 8 * 49 * 3 * 8;
    let fixed = "a fixed sun and turbidity are 49x3 numbers at most, integrated directly: no polynomial in sun height \
     and turbidity";
    let why = match (&manifest.sky, &manifest.sun) {
        (Some(SceneSky::Physical(_)), _) => fixed,
        (Some(SceneSky::Picture(_)), _) => "a picture does not follow the sun: its coefficients are summed",
        (Some(_), _) => {
            "a constant sky under a fixed sun is three numbers, not a polynomial in sun height and turbidity"
        }
        _ => "the scene has no sky",
    };
    if !plan.light.sun_moves {
        plan.leave_out(PlanOmission::new("sky polynomial (spherical harmonics)", why, polynomial, None));
    }
    let texels: u64 = plan.leaves.iter().map(|l| (l.size[0] * l.size[1]) as u64).sum();
    if placed.leaves.iter().all(|l| l.translucent.is_none()) {
        let why = "light through a leaf follows the slab's rho_t a texel; the scene asks for no scattering sideways";
        plan.leave_out(PlanOmission::new("translucency maps", why, texels * 8 * 2, None));
    }
    if manifest.cards().next().is_none() {
        plan.leave_out(PlanOmission::new("cards", "no view asks for a patch with a closed-form radiance", 0, None));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A low lawn takes one fine map, a crown all parts of the sun's disk, and what is between both takes some of them.
    #[test]
    fn low_scenes_have_finer_maps() {
        for (width, penumbra, expected) in
            [(14_000.0, 0.3, (1, 8192)), (3000.0, 9.0, (16, 2048)), (14_000.0, 3.0, (4, 4096)), (1.0, 0.0, (1, 8192))]
        {
            assert_eq!(finer(16, width, penumbra), expected, "{width} {penumbra}");
        }
        assert_eq!([1, 8].map(|n| finer(n, 14_000.0, 0.3)), [(1, 2048), (2, 4096)]);
    }

    /// The reach is that of all pairs, which are looked at one by one.
    #[test]
    fn no_pair_reaches_farther() {
        let mut seed = 7u64;
        let mut next = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        for shape in [DVec3::ONE, DVec3::new(9.0, 1.0, 0.1), DVec3::ZERO] {
            for count in [0, 1, 2, 300] {
                let mut ball = || (DVec3::new(next(), next(), next()) * 50.0 * shape, 4.0 * next() * next());
                let balls: Vec<(DVec3, f64)> = (0..count).map(|_| ball()).collect();
                let pairs = balls.iter().flat_map(|(a, r)| balls.iter().map(move |(b, q)| a.distance(*b) + r + q));
                assert_eq!(reach(&balls), pairs.fold(0.0, f64::max), "{shape} {count}");
            }
        }
    }
}
