//! Refuses scenes that contradict themselves before anything reaches the adapter. The error names the place, what was
//! found and what was expected.

mod motion;
mod stand;
mod surface;
mod transfer;

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::scene::{Backdrop, Camera, Scanner, Scene, SkyDome};
use glam::Mat4;
pub(crate) use motion::sections;
pub(crate) use surface::material;

/// The largest memory of all shadow maps together (bytes).
const SHADOW_BUDGET: u64 = 2 << 30;

fn wrong(place: impl Into<String>, found: impl ToString, expected: impl ToString) -> Error {
    Error::Scene { place: place.into(), found: found.to_string(), expected: expected.to_string() }
}

pub(crate) fn scene(gpu: &Gpu, scene: &Scene) -> Result<()> {
    for (i, mesh) in scene.meshes.iter().enumerate() {
        surface::check_mesh(i, mesh)?;
    }
    for i in 0..scene.materials.len() {
        material(gpu, scene, i)?;
    }
    for (i, instance) in scene.instances.iter().enumerate() {
        let indices =
            [("mesh", instance.mesh, scene.meshes.len()), ("material", instance.material, scene.materials.len())];
        if let Some((what, found, count)) = indices.into_iter().find(|(_, index, count)| index >= count) {
            return Err(wrong(format!("instance {i}, {what}"), found, format!("below {count}")));
        }
        rigid(&instance.transform, || format!("instance {i}, transform"))?;
    }
    for (i, grass) in scene.grass.iter().enumerate() {
        crate::grass::validate(gpu, i, grass)?;
    }
    motion::wind(scene)?;
    sections(gpu, scene, 1)?;
    stand::stands(gpu, scene)?;
    transfer::transfer(gpu, scene)?;
    transfer::shares(gpu, scene)?;
    lights(gpu, scene)
}

/// Refuses a transform that is no rigid motion with a uniform scale.
fn rigid(m: &Mat4, place: impl Fn() -> String) -> Result<()> {
    let scale = [m.x_axis, m.y_axis, m.z_axis].map(|a| a.truncate().length());
    let even = scale.iter().all(|s| s.is_finite() && *s > 0.0 && (s / scale[0] - 1.0).abs() < 1e-3);
    if !even || !m.w_axis.is_finite() {
        return Err(wrong(place(), format!("scales {scale:?}"), "a rigid motion with one positive scale"));
    }
    Ok(())
}

/// Validates the lights and the settings with which a scene is drawn.
pub(crate) fn lights(gpu: &Gpu, scene: &Scene) -> Result<()> {
    if scene.msaa != 1 && scene.msaa != 4 {
        return Err(wrong("msaa", scene.msaa, "1 or 4"));
    }
    let lights = scene.sky.into_iter().chain([scene.background]).chain(scene.sun.map(|s| s.irradiance)).flatten();
    if let Some(bad) = lights.into_iter().find(|v| !v.is_finite() || *v < 0.0) {
        return Err(wrong("sun, sky or background", bad, "finite and not negative"));
    }
    if let Some(backdrop) = &scene.backdrop {
        check_backdrop(gpu, backdrop)?;
    }
    if let Some(dome) = &scene.dome {
        check_dome(scene, dome)?;
        dome.picture.iter().try_for_each(|picture| check_backdrop(gpu, picture))?;
    }
    if let Some(scanner) = &scene.scanner {
        check_scanner(scene, scanner)?;
    }
    if !scene.exposure.is_finite() || scene.exposure < 0.0 {
        return Err(wrong("exposure", scene.exposure, "finite and not negative"));
    }
    if let Some(share) = scene.bloom.filter(|share| !(0.0..=1.0).contains(share)) {
        return Err(wrong("bloom", share, "0 to 1"));
    }
    if let Some(sun) = scene.sun {
        if (sun.direction.length() - 1.0).abs() > 1e-3 {
            return Err(wrong("sun, direction", sun.direction, "a unit vector"));
        }
        if !(0.0..0.5).contains(&sun.radius) {
            return Err(wrong("sun, radius", sun.radius, "0 up to 0.5 rad"));
        }
        shadow(gpu, scene)?;
    }
    Ok(())
}

fn check_scanner(scene: &Scene, scanner: &Scanner) -> Result<()> {
    if scene.sun.is_some() || scene.sky.is_some() || scene.dome.is_some() {
        return Err(wrong("scanner", "a sun or a sky beside it", "the tube as the only light"));
    }
    if (scanner.camera.length() - 1.0).abs() > 1e-3 || scanner.camera.z <= 0.0 {
        return Err(wrong("scanner, camera", scanner.camera, "a unit vector above the plane"));
    }
    let lengths = [scanner.pixel_mm, scanner.height_mm, scanner.length_mm];
    if !lengths.iter().all(|v| v.is_finite() && *v > 0.0)
        || !(0.0..scanner.height_mm).contains(&scanner.radius_mm)
        || !scanner.at_mm.is_finite()
    {
        return Err(wrong("scanner", format!("{scanner:?}"), "positive lengths and a radius below the height"));
    }
    Ok(())
}

fn check_backdrop(gpu: &Gpu, backdrop: &Backdrop) -> Result<()> {
    let Backdrop { width, height, texels, turn } = backdrop;
    let limit = gpu.max_side();
    if *width == 0 || *height == 0 || *width > limit || *height > limit {
        return Err(Error::Size { what: "backdrop".into(), width: *width, height: *height, limit });
    }
    if texels.len() != *width as usize * *height as usize {
        return Err(wrong("backdrop", format!("{} texels", texels.len()), "as many as columns times rows"));
    }
    if !turn.is_finite() {
        return Err(wrong("backdrop, turn", turn, "a finite number"));
    }
    match texels.as_flattened().iter().find(|v| !v.is_finite() || **v < 0.0) {
        Some(bad) => Err(wrong("backdrop", bad, "finite and not negative")),
        None => Ok(()),
    }
}

fn check_dome(scene: &Scene, dome: &SkyDome) -> Result<()> {
    if scene.sky.is_some() {
        return Err(wrong("dome", "a constant sky beside it", "one of the two"));
    }
    if crate::dome::bands(dome).is_none() {
        return Err(wrong(
            "dome, harmonics",
            format!("{} coefficients", dome.harmonics.len()),
            "1, 4, 9, 16, 25, 36 or 49",
        ));
    }
    let numbers = dome
        .harmonics
        .as_flattened()
        .iter()
        .chain(dome.perez.as_flattened())
        .chain(&dome.scale)
        .chain(dome.ground.iter().flatten());
    if let Some(bad) = numbers.chain([&dome.strength]).find(|v| !v.is_finite()) {
        return Err(wrong("dome", bad, "finite numbers"));
    }
    if (dome.sun.length() - 1.0).abs() > 1e-3 {
        return Err(wrong("dome, sun", dome.sun, "a unit vector"));
    }
    Ok(())
}

fn shadow(gpu: &Gpu, scene: &Scene) -> Result<()> {
    let (n, side) = (scene.shadow_samples, scene.shadow_resolution);
    if n == 0 {
        return Ok(());
    }
    // 256 matrices fill a quarter of the smallest uniform buffer that every adapter has.
    let most = gpu.max_layers().min(256);
    if n > most {
        return Err(wrong("shadow_samples", n, format!("at most {most} on this adapter")));
    }
    if !(16..=gpu.max_side()).contains(&side) {
        return Err(wrong("shadow_resolution", side, format!("16 to {} on this adapter", gpu.max_side())));
    }
    let bytes = u64::from(n) * u64::from(side) * u64::from(side) * 4;
    if bytes > SHADOW_BUDGET {
        return Err(wrong("shadow maps", format!("{bytes} bytes in all"), format!("at most {SHADOW_BUDGET}")));
    }
    Ok(())
}

pub(crate) fn camera(camera: &Camera) -> Result<()> {
    let ahead = camera.target - camera.eye;
    if !(ahead.is_finite() && ahead.length() > 0.0) {
        return Err(wrong(
            "camera, eye and target",
            format!("{} and {}", camera.eye, camera.target),
            "two different points",
        ));
    }
    if !(camera.up.is_finite() && ahead.normalize().cross(camera.up).length() > 1e-6) {
        return Err(wrong("camera, up", camera.up, "a direction off the line of sight"));
    }
    if !(camera.fov_y_deg > 0.0 && camera.fov_y_deg < 180.0) {
        return Err(wrong("camera, fov_y_deg", camera.fov_y_deg, "between 0 and 180"));
    }
    Ok(())
}

pub(crate) fn picture(gpu: &Gpu, width: u32, height: u32) -> Result<()> {
    let limit = gpu.max_side();
    if width == 0 || height == 0 || width > limit || height > limit {
        return Err(Error::Size { what: "picture".into(), width, height, limit });
    }
    Ok(())
}
