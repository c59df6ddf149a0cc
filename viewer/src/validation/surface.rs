//! Refuses materials and meshes that contradict themselves.

use super::wrong;
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::scene::{AlbedoPattern, Interior, LeafMaterial, Material, Mesh, Scene, SideMaps};

/// Validates material `index` of a scene.
pub(crate) fn material(gpu: &Gpu, scene: &Scene, index: usize) -> Result<()> {
    match scene.materials.get(index) {
        Some(Material::Leaf(leaf)) => check_leaf(gpu, index, leaf),
        Some(Material::Opaque(o)) if !o.albedo.iter().all(|v| (0.0..=1.0).contains(v)) => {
            Err(wrong(format!("opaque {index} ({}), albedo", o.name), format!("{:?}", o.albedo), "0 to 1"))
        }
        Some(Material::Opaque(o)) => {
            o.pattern.as_ref().map_or(Ok(()), |pattern| check_pattern(gpu, &format!("{index} ({})", o.name), pattern))
        }
        None => Err(wrong("material", index, format!("below {}", scene.materials.len()))),
    }
}

fn check_pattern(gpu: &Gpu, name: &str, pattern: &AlbedoPattern) -> Result<()> {
    let place = |field: &str| format!("opaque {name}, pattern, {field}");
    let AlbedoPattern { width, height, texels, corner, size } = pattern;
    let limit = gpu.max_side();
    if *width == 0 || *height == 0 || *width > limit || *height > limit {
        return Err(Error::Size { what: place("texels"), width: *width, height: *height, limit });
    }
    let count = *width as usize * *height as usize;
    if texels.len() != count {
        return Err(wrong(place("texels"), texels.len(), count));
    }
    if let Some(bad) = texels.iter().flatten().find(|v| !(0.0..=1.0).contains(*v)) {
        return Err(wrong(place("texels"), bad, "0 to 1"));
    }
    if !corner.iter().all(|v| v.is_finite()) {
        return Err(wrong(place("corner"), format!("{corner:?}"), "finite"));
    }
    if !size.iter().all(|v| v.is_finite() && *v > 0.0) {
        return Err(wrong(place("size"), format!("{size:?}"), "finite and above 0"));
    }
    Ok(())
}

fn check_leaf(gpu: &Gpu, index: usize, leaf: &LeafMaterial) -> Result<()> {
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

pub(super) fn check_mesh(index: usize, mesh: &Mesh) -> Result<()> {
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
