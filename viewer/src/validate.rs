//! Refuses scenes that contradict themselves before anything reaches the adapter, with the place, what was found and
//! what was expected.

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::passes::bend::{SECTIONS_WIDE, VERTICES_WIDE};
use crate::passes::transfer::{columns, count};
use crate::scene::{Camera, Dome, Interior, Leaf, MOST_BRANCHES, Material, Mesh, Scanner, Scene, SideMaps};

/// Shadow maps larger than this in total are refused (bytes).
const SHADOW_BUDGET: u64 = 2 << 30;

fn wrong(place: impl Into<String>, found: impl ToString, expected: impl ToString) -> Error {
    Error::Scene { place: place.into(), found: found.to_string(), expected: expected.to_string() }
}

pub(crate) fn scene(gpu: &Gpu, scene: &Scene) -> Result<()> {
    for (i, mesh) in scene.meshes.iter().enumerate() {
        check_mesh(i, mesh)?;
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
        let m = instance.transform;
        let scale = [m.x_axis, m.y_axis, m.z_axis].map(|a| a.truncate().length());
        let even = scale.iter().all(|s| s.is_finite() && *s > 0.0 && (s / scale[0] - 1.0).abs() < 1e-3);
        if !even || !m.w_axis.is_finite() {
            return Err(wrong(
                format!("instance {i}, transform"),
                format!("scales {scale:?}"),
                "a rigid motion with one positive scale",
            ));
        }
    }
    for (i, grass) in scene.grass.iter().enumerate() {
        crate::grass::validate(gpu, i, grass)?;
    }
    branches(scene)?;
    sections(gpu, scene)?;
    transfer(gpu, scene)?;
    shares(gpu, scene)?;
    lights(gpu, scene)
}

/// Sections: as many as a texture holds, and one for everything that is carried.
fn sections(gpu: &Gpu, scene: &Scene) -> Result<()> {
    let (count, of_vertices) = scene.sections.as_ref().map_or((0, [].as_slice()), |s| (s.count, &s.of_vertices));
    // A number in single precision names each: it counts to 2^24.
    let rows = (gpu.device.limits().max_texture_dimension_2d as usize).min(8192);
    let most = [rows * SECTIONS_WIDE as usize, rows * VERTICES_WIDE as usize];
    for (what, found, most) in [("sections", count, most[0]), ("vertices of bark", of_vertices.len(), most[1])] {
        if found > most {
            return Err(wrong(what, found, format!("at most {most}")));
        }
    }
    for (i, instance) in scene.instances.iter().enumerate() {
        let Some(carried) = instance.carried else { continue };
        let own = match carried.vertices {
            None => Some(0),
            Some(first) => {
                let end = first as usize + scene.meshes[instance.mesh].positions.len();
                of_vertices.get(first as usize..end).map(|of| of.iter().copied().max().unwrap_or(0))
            }
        };
        if own.is_none_or(|own| carried.first as usize + own as usize >= count) {
            return Err(wrong(format!("instance {i}, section"), format!("{carried:?}"), format!("below {count}")));
        }
    }
    Ok(())
}

/// Shares of the sun: a byte for every vertex of an instance that has them.
fn shares(gpu: &Gpu, scene: &Scene) -> Result<()> {
    let Some(shares) = &scene.sun_shares else { return Ok(()) };
    if gpu.is_gl() {
        return Err(wrong("shares of the sun", "an adapter that is driven by GL", "Vulkan, Metal or DirectX 12"));
    }
    let most = gpu.device.limits().max_storage_buffer_binding_size;
    if shares.len() as u64 > most {
        return Err(wrong("shares of the sun", format!("{} bytes", shares.len()), format!("up to {most}")));
    }
    for (i, instance) in scene.instances.iter().enumerate() {
        let Some(first) = instance.first_share else { continue };
        let end = first as usize + scene.meshes[instance.mesh].positions.len();
        if end > shares.len() {
            let place = format!("instance {i}, shares of the sun");
            return Err(wrong(place, format!("up to number {end}"), format!("below {}", shares.len())));
        }
    }
    Ok(())
}

fn shines(side: &SideMaps) -> bool {
    side.gloss.as_ref().is_some_and(|g| g.iter().any(|t| t[..3].iter().any(|v| *v > 0.0)))
}

/// The transfer, and that everything which stands in the scene has rows in it.
fn transfer(gpu: &Gpu, scene: &Scene) -> Result<()> {
    let Some(transfer) = &scene.transfer else { return Ok(()) };
    if gpu.is_gl() {
        return Err(wrong("transfer", "an adapter that is driven by GL", "Vulkan, Metal or DirectX 12"));
    }
    if !transfer.bands.is_none_or(|b| (1..=7).contains(&b)) || !(1..=7).contains(&transfer.gloss_bands) {
        let found = format!("{:?} and {} for gloss", transfer.bands, transfer.gloss_bands);
        return Err(wrong("transfer, bands", found, "1 to 7"));
    }
    let columns = columns(transfer);
    let rows = transfer.entries.len() / columns;
    let bytes = 8 * transfer.entries.len() as u64;
    let most = gpu.device.limits().max_storage_buffer_binding_size;
    if bytes == 0 || bytes > most || !transfer.entries.len().is_multiple_of(columns) {
        return Err(wrong("transfer, entries", format!("{bytes} bytes"), format!("whole rows, up to {most} bytes")));
    }
    if !transfer.scale.is_finite() {
        return Err(wrong("transfer, scale", transfer.scale, "a finite number"));
    }
    for (i, instance) in scene.instances.iter().enumerate() {
        let mesh = &scene.meshes[instance.mesh];
        if mesh.indices.is_empty() {
            continue;
        }
        let Some(anchors) = &mesh.anchors else {
            return Err(wrong(format!("instance {i}, anchors"), "none", "anchors of its mesh, for the transfer"));
        };
        let glossy = 6 + transfer.gloss_bands * transfer.gloss_bands;
        let known = match scene.leaf(instance.material) {
            Some(leaf) if leaf.sides.iter().any(|(_, s)| shines(s)) => vec![glossy],
            Some(_) => vec![6, glossy],
            None => vec![1],
        };
        let end = instance.first_row as usize + count(anchors) * anchors.rows as usize;
        let whole = anchors.places.len() == mesh.positions.len() && anchors.grid.iter().all(|n| *n > 0);
        if !whole || !known.contains(&(anchors.rows as usize)) || end > rows {
            let found = format!("{} places, {} rows an anchor, up to row {end}", anchors.places.len(), anchors.rows);
            let expected = format!("{} places, {known:?} rows an anchor, below {rows}", mesh.positions.len());
            return Err(wrong(format!("instance {i}, anchors"), found, expected));
        }
    }
    Ok(())
}

/// Material `index` of a scene.
pub(crate) fn material(gpu: &Gpu, scene: &Scene, index: usize) -> Result<()> {
    match scene.materials.get(index) {
        Some(Material::Leaf(leaf)) => check_leaf(gpu, index, leaf),
        Some(Material::Opaque(o)) if !o.albedo.iter().all(|v| (0.0..=1.0).contains(v)) => {
            Err(wrong(format!("opaque {index} ({}), albedo", o.name), format!("{:?}", o.albedo), "0 to 1"))
        }
        Some(Material::Opaque(_)) => Ok(()),
        None => Err(wrong("material", index, format!("below {}", scene.materials.len()))),
    }
}

/// Lights, and how a scene is drawn.
pub(crate) fn lights(gpu: &Gpu, scene: &Scene) -> Result<()> {
    if scene.msaa != 1 && scene.msaa != 4 {
        return Err(wrong("msaa", scene.msaa, "1 or 4"));
    }
    let lights = scene.sky.into_iter().chain([scene.background]).chain(scene.sun.map(|s| s.irradiance)).flatten();
    if let Some(bad) = lights.into_iter().find(|v| !v.is_finite() || *v < 0.0) {
        return Err(wrong("sun, sky or background", bad, "finite and not negative"));
    }
    if let Some(dome) = &scene.dome {
        check_dome(scene, dome)?;
    }
    if let Some(scanner) = &scene.scanner {
        check_scanner(scene, scanner)?;
    }
    if !scene.exposure.is_finite() || scene.exposure < 0.0 {
        return Err(wrong("exposure", scene.exposure, "finite and not negative"));
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

fn check_dome(scene: &Scene, dome: &Dome) -> Result<()> {
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

fn branches(scene: &Scene) -> Result<()> {
    let n = scene.branches.len();
    if n > MOST_BRANCHES {
        return Err(wrong("branches", n, format!("at most {MOST_BRANCHES}")));
    }
    for (i, b) in scene.branches.iter().enumerate() {
        let across = [b.t.dot(b.r), b.r.dot(b.s), b.s.dot(b.t)];
        let unit = [b.t, b.r, b.s].map(|v| v.length() - 1.0);
        if !across.into_iter().chain(unit).all(|v| v.abs() < 1e-3) {
            return Err(wrong(
                format!("branch {i}, t r s"),
                format!("{} {} {}", b.t, b.r, b.s),
                "an orthonormal frame",
            ));
        }
        if !(b.length > 0.0 && b.alpha > 0.0) {
            return Err(wrong(
                format!("branch {i}, length and taper"),
                format!("{} and {}", b.length, b.alpha),
                "both above 0",
            ));
        }
        let numbers = [b.length, b.alpha, b.ln_alpha, b.ell, b.gain]
            .into_iter()
            .chain(b.a)
            .chain(b.still)
            .chain(b.root.to_array());
        let line = b.start.into_iter().chain(b.velocity);
        if !numbers.map(f64::from).chain(line).all(f64::is_finite) {
            return Err(wrong(format!("branch {i}"), "a value that is not finite", "finite values"));
        }
    }
    for (i, instance) in scene.instances.iter().enumerate() {
        let Some(ride) = instance.ride else { continue };
        if ride.branch >= n {
            return Err(wrong(format!("instance {i}, branch"), ride.branch, format!("below {n}")));
        }
        if !ride.at.is_none_or(|at| (0.0..=1.0).contains(&at)) {
            return Err(wrong(format!("instance {i}, place on its branch"), format!("{:?}", ride.at), "0 to 1"));
        }
    }
    let Some(wind) = &scene.wind else { return Ok(()) };
    let sways = scene.branches.iter().any(|b| b.gain != 0.0);
    if (wind.size == 0 && sways) || wind.motion.len() != wind.size as usize * wind.size as usize {
        return Err(wrong("motion texture", format!("{} texels", wind.motion.len()), format!("{0} x {0}", wind.size)));
    }
    if !(wind.time_s.is_finite() && wind.motion.as_flattened().iter().all(|v| v.is_finite())) {
        return Err(wrong("wind", "a value that is not finite", "finite values"));
    }
    Ok(())
}

fn shadow(gpu: &Gpu, scene: &Scene) -> Result<()> {
    let (n, side) = (scene.shadow_samples, scene.shadow_resolution);
    if n == 0 {
        return Ok(());
    }
    // 256 matrices fill a quarter of the smallest uniform buffer every adapter has.
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

fn check_leaf(gpu: &Gpu, index: usize, leaf: &Leaf) -> Result<()> {
    let place = |field: &str| format!("leaf {index} ({}), {field}", leaf.name);
    let limit = gpu.max_side();
    if leaf.width == 0 || leaf.height == 0 || leaf.width > limit || leaf.height > limit {
        return Err(Error::Size { what: place("maps"), width: leaf.width, height: leaf.height, limit });
    }
    if !leaf.thickness_mm.is_finite() || leaf.thickness_mm <= 0.0 {
        return Err(wrong(place("thickness_mm"), leaf.thickness_mm, "finite and above 0"));
    }
    if let Some(n) = leaf.lobe.index()
        && !(n.is_finite() && n > 1.0)
    {
        return Err(wrong(place("lobe index"), n, "finite and above 1"));
    }
    let texels = leaf.width as usize * leaf.height as usize;
    if let Some(mask) = &leaf.mask
        && mask.len() != texels
    {
        return Err(wrong(place("mask"), format!("{} texels", mask.len()), texels));
    }
    if let (Some(front), Some(back)) = (&leaf.sides.front.translucency, &leaf.sides.back.translucency)
        && front.basis != back.basis
    {
        let found = format!("{:?} on the front and {:?} on the back", front.basis, back.basis);
        return Err(wrong(place("translucency.basis"), found, "one basis for both"));
    }
    leaf.sides.iter().try_for_each(|(side, maps)| check_side(gpu, &place(side.name()), texels, maps))
}

fn check_mesh(index: usize, mesh: &Mesh) -> Result<()> {
    let place = |field: &str| format!("mesh {index}, {field}");
    let vertices = mesh.positions.len();
    for (field, n) in [("normals", mesh.normals.len()), ("tangents", mesh.tangents.len()), ("uvs", mesh.uvs.len())] {
        if n != vertices {
            return Err(wrong(place(field), format!("{n} entries"), format!("{vertices}, one a position")));
        }
    }
    if !mesh.indices.len().is_multiple_of(3) {
        return Err(wrong(place("indices"), format!("{} entries", mesh.indices.len()), "a multiple of 3"));
    }
    for detail in &mesh.details {
        if !detail.indices.len().is_multiple_of(3) || detail.indices.iter().any(|i| *i as usize >= vertices) {
            let found = format!("{} entries, up to {:?}", detail.indices.len(), detail.indices.iter().max());
            return Err(wrong(place("details"), found, format!("a multiple of 3, below {vertices}")));
        }
        if !(detail.error >= 0.0 && detail.error.is_finite()) {
            return Err(wrong(place("details"), format!("an error of {}", detail.error), "0 or more"));
        }
    }
    if let Some(bad) = mesh.indices.iter().find(|i| **i as usize >= vertices) {
        return Err(wrong(place("indices"), bad, format!("below {vertices}")));
    }
    if !mesh.positions.iter().all(|p| p.is_finite()) {
        return Err(wrong(place("positions"), "a value that is not finite", "finite positions"));
    }
    Ok(())
}

fn check_side(gpu: &Gpu, place: &str, texels: usize, side: &SideMaps) -> Result<()> {
    let size = |field: &str, n: usize| {
        if n == texels { Ok(()) } else { Err(wrong(format!("{place}.{field}"), format!("{n} texels"), texels)) }
    };
    let finite = |field: &str, ok: bool| {
        if ok { Ok(()) } else { Err(wrong(format!("{place}.{field}"), "a value that is not finite", "finite values")) }
    };
    if let Some(gloss) = &side.gloss {
        size("gloss", gloss.len())?;
        finite("gloss", gloss.as_flattened().iter().all(|v| v.is_finite()))?;
    }
    if let Some(normal) = &side.normal {
        size("normal", normal.len())?;
        finite("normal", normal.as_flattened().iter().all(|v| v.is_finite()))?;
    }
    if let Some(translucency) = &side.translucency {
        for map in translucency.layers() {
            size("translucency", map.len())?;
            finite("translucency", map.as_flattened().iter().all(|v| v.is_finite()))?;
        }
    }
    match &side.interior {
        Interior::Scalars(_) if side.is_black() => Ok(()),
        Interior::Scalars(curve) => {
            size("gamma_delta", side.gamma_delta.len())?;
            finite("gamma_delta", side.gamma_delta.as_flattened().iter().all(|v| v.is_finite()))?;
            let n = curve.rho_d.len();
            if n < 2 || n > gpu.max_side() as usize || curve.rho_t.len() != n {
                let found = format!("{n} and {} points", curve.rho_t.len());
                return Err(wrong(
                    format!("{place}.interior curve"),
                    found,
                    format!("as many of both, 2 to {}", gpu.max_side()),
                ));
            }
            if !(curve.min_mm.is_finite() && curve.max_mm.is_finite() && curve.min_mm < curve.max_mm) {
                let found = format!("{} to {} mm", curve.min_mm, curve.max_mm);
                return Err(wrong(format!("{place}.interior curve"), found, "a rising thickness range"));
            }
            finite("interior curve", curve.rho_d.iter().chain(&curve.rho_t).flatten().all(|v| v.is_finite()))
        }
        Interior::Maps { rho_d, rho_t } => {
            size("interior.rho_d", rho_d.len())?;
            size("interior.rho_t", rho_t.len())?;
            finite("interior maps", rho_d.iter().chain(rho_t).flatten().all(|v| v.is_finite()))
        }
    }
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
