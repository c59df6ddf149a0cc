//! The plan of the light: sun, shadow maps, sky; and the models this scene has no use for.

use super::accuracy::{self, Row};
use super::display::displayed;
use super::{LeftOut, Need, Plan, sun_direction};
use crate::Result;
use crate::manifest::{Manifest, ViewKind};
use crate::placed::daylight::Daylight;
use std::time::Instant;

/// Shadow maps are this many texels a side.
const SHADOW_SIDE: u64 = 2048;

/// Irradiance of the sun and mean radiance of the sky, in the scene's unit; none is 0.
pub fn levels(manifest: &Manifest) -> ([f64; 3], [f64; 3]) {
    if let Ok(Some(daylight)) = Daylight::of(manifest) {
        return (daylight.sun, daylight.level.map(|e| e / std::f64::consts::PI));
    }
    let sun = manifest.sun.as_ref().and_then(|s| s.irradiance).unwrap_or_default();
    (sun, manifest.sky.as_ref().and_then(|s| s.radiance).unwrap_or_default())
}

/// Decides sun, shadows and sky; with a free camera and sun, shadows can always fall.
///
/// # Errors
/// [`crate::Error::Input`] for a physical sky that the model refuses.
pub fn lights(manifest: &Manifest, plan: &mut Plan, free: bool) -> Result<()> {
    let free = free || manifest.sun_moves();
    let shadow_bytes = SHADOW_SIDE * SHADOW_SIDE * 4;
    match (&manifest.sun, sun_direction(manifest)) {
        (Some(sun), Some(direction)) => {
            plan.need(Need::new("sun", "the scene has one: three numbers and a direction, its disk by its radius"));
            match plan.shadows(direction, sun.radius_deg.to_radians()) {
                _ if free || !plan.twigs.is_empty() || plan.wood.is_some() => {
                    shadows(manifest, plan, sun.radius_deg.to_radians(), shadow_bytes)
                }
                Ok(()) => shadows(manifest, plan, sun.radius_deg.to_radians(), shadow_bytes),
                Err(why) => plan.leave_out(LeftOut::new("shadow maps", why, shadow_bytes, None)),
            }
        }
        _ => {
            let why = "the scene has no sun: no light loop in the shader, no shadow pass";
            plan.leave_out(LeftOut::new("sun and shadow maps", why, shadow_bytes, None));
        }
    }
    match &manifest.sky {
        Some(sky) if sky.model.is_some() => physical_sky(manifest, plan)?,
        Some(_) => plan.need(Need::new(
            "sky",
            "constant: three numbers, and the lobe's directional albedo where a side is glossy",
        )),
        None => plan.leave_out(LeftOut::new("sky", "the scene has none: its term is not in the shader", 0, None)),
    }
    let mut need = Need::new("multisampling", "edges show");
    need.amount = Some(format!("{} samples a pixel", plan.msaa));
    plan.need(need);
    Ok(())
}

/// How many bands light the leaves, and whether their coefficients are integrated once or come from the polynomials.
fn physical_sky(manifest: &Manifest, plan: &mut Plan) -> Result<()> {
    let Some(daylight) = Daylight::of(manifest)? else { return Ok(()) };
    let mut rows = Vec::new();
    for bands in [3usize, 5, 7] {
        let start = Instant::now();
        let error = daylight.truncation(&[bands], manifest.exposure)?[0];
        rows.push(Row {
            setting: bands,
            error,
            ms: start.elapsed().as_secs_f64() * 1e3,
            bytes: (16 * bands * bands) as u64,
        });
    }
    let row = plan.choose("sky bands", rows, manifest.tolerance);
    let glossy = plan.leaves.iter().any(|l| l.sides.iter().any(|s| s.gloss));
    // A highlight is sharper than diffuse light.
    plan.sky_bands = if glossy { 7 } else { row.map_or(7, |r| r.setting) };
    let n = plan.sky_bands * plan.sky_bands;
    let how = if plan.sun_moves { "from the polynomials" } else { "integrated for this sun and turbidity" };
    let mut need = Need::new(
        "sky",
        format!("preetham, turbidity {}: {n}x3 coefficients, {how}; drawn behind the leaves", daylight.turbidity),
    );
    if let Some(row) = row {
        let cost =
            plan.measured["sky bands"].iter().find(|r| r.setting == plan.sky_bands).map_or(row.error, |r| r.error);
        need.amount = Some(format!("{} bands, displayed error of diffuse light {cost:.1e} (measured)", plan.sky_bands));
    }
    need.bytes = Some(16 * n as u64);
    plan.need(need);
    if plan.sun_moves {
        let mut need = Need::new(
            "sky polynomial (spherical harmonics)",
            "the sun moves: fit sky makes it, milliseconds, before the first picture",
        );
        need.amount = Some("7 bands, sun zenith 0 to 90 degrees, turbidity 2.5 to 6".into());
        plan.need(need);
    }
    Ok(())
}

fn shadows(manifest: &Manifest, plan: &mut Plan, radius: f64, map_bytes: u64) {
    // Spheres around the leaves tell how far a shadow falls at most, and how wide a leaf is beside its penumbra.
    let spheres: Vec<(glam::DVec3, f64)> = plan
        .placements
        .iter()
        .filter_map(|p| plan.leaves[p.leaf].mesh.as_ref().map(|m| (m.bounds(), p.transform)))
        .map(|((c, r), t)| (t.transform_point3(c), r * t.x_axis.truncate().length()))
        .collect();
    let reach = spheres
        .iter()
        .flat_map(|(a, ra)| spheres.iter().map(move |(b, rb)| a.distance(*b) + ra + rb))
        .fold(0.0, f64::max);
    let leaf = spheres.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    let share = if spheres.is_empty() { 1.0 } else { (2.0 * radius.tan() * reach / (2.0 * leaf)).min(1.0) };
    let mean = |c: &[f64; 3]| c.iter().sum::<f64>() / 3.0;
    let (sun, sky) = levels(manifest);
    let (sun, sky) = (mean(&sun) / std::f64::consts::PI, mean(&sky));
    // A leaf reflects about a tenth of the light.
    let contrast = displayed(0.1 * (sun + sky), manifest.exposure) - displayed(0.1 * sky, manifest.exposure);
    let row = plan.choose("shadow samples", accuracy::shadow_samples(contrast, share, map_bytes), manifest.tolerance);
    let mut need = Need::new("shadow maps", "leaves can stand in each other's light");
    if let Some(row) = row {
        plan.shadow_samples = row.setting as u32;
        plan.shadow_resolution = SHADOW_SIDE as u32;
        need.amount = Some(format!(
            "{} over the sun's disk, {SHADOW_SIDE} texels a side, displayed error {:.1e} (measured)",
            row.setting, row.error
        ));
        need.bytes = Some(row.bytes);
    }
    plan.need(need);
}

/// What a plant scene may have and this one has not.
pub fn absent_models(manifest: &Manifest, plan: &mut Plan) {
    // H9 ch. 5: (13+1)·(7+1) coefficients, 49 harmonics, three channels, doubles.
    let polynomial = 14 * 8 * 49 * 3 * 8;
    let fixed = "a fixed sun and turbidity are 49x3 numbers at most, integrated directly: no polynomial in sun height \
     and turbidity";
    let why = match (&manifest.sky, &manifest.sun) {
        (Some(sky), _) if sky.model.is_some() => fixed,
        (Some(_), _) => {
            "a constant sky under a fixed sun is three numbers, not a polynomial in sun height and turbidity"
        }
        _ => "the scene has no sky",
    };
    if !plan.sun_moves {
        plan.leave_out(LeftOut::new("sky polynomial (spherical harmonics)", why, polynomial, None));
    }
    let texels: u64 = plan.leaves.iter().filter(|l| l.used).map(|l| (l.size[0] * l.size[1]) as u64).sum();
    if plan.leaves.iter().all(|l| l.translucency.is_none()) {
        let why = "light through a leaf follows the slab's rho_t a texel; the scene asks for no scattering sideways";
        plan.leave_out(LeftOut::new("translucency maps", why, texels * 8 * 2, None));
    }
    if manifest.views.iter().all(|v| v.kind != ViewKind::Card) {
        plan.leave_out(LeftOut::new("cards", "no view asks for a patch with a closed-form radiance", 0, None));
    }
}
