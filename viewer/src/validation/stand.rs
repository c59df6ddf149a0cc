//! Refuses plants in many places that contradict the rest of their scene.

use super::{rigid, wrong};
use crate::error::Result;
use crate::gpu::Gpu;
use crate::scene::Scene;

/// Validates stands: every place and pose, what carries their instances, and that the vertex stage can read them.
pub(super) fn stands(gpu: &Gpu, scene: &Scene) -> Result<()> {
    let named = scene.instances.iter().enumerate().filter_map(|(i, instance)| Some((i, instance, instance.stand?)));
    for (i, instance, k) in named {
        let Some(stand) = scene.stands.get(k as usize) else {
            return Err(wrong(format!("instance {i}, stand"), k, format!("below {}", scene.stands.len())));
        };
        if instance.floor || instance.first_share.is_some() {
            let found = "a floor, or shares of the sun";
            return Err(wrong(format!("instance {i}, stand"), found, "neither where plants stand in many places"));
        }
        let own = stand.first..stand.first + stand.sections;
        if let Some(carried) = instance.carried.filter(|c| !own.contains(&c.first)) {
            let expected = format!("a section of the stand's first pose ({own:?})");
            return Err(wrong(format!("instance {i}, section"), carried.first, expected));
        }
    }
    let Some(first) = scene.stands.first() else { return Ok(()) };
    let reads = gpu.adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::VERTEX_STORAGE);
    if !reads {
        let found = format!("{} places on {}, whose vertex stage reads no buffers", first.places.len(), gpu.info.name);
        let expected = "an adapter with Vulkan, Metal, DirectX 12 or a newer OpenGL, or fewer plants";
        return Err(wrong("stands", found, expected));
    }
    if scene.transfer.is_some() {
        return Err(wrong("stands", "light between leaves beside them", "one of the two"));
    }
    let count = scene.sections.as_ref().map_or(0, |s| s.count) as u64;
    let most = gpu.device.limits().max_storage_buffer_binding_size / 64;
    for (k, stand) in scene.stands.iter().enumerate() {
        let end = u64::from(stand.first) + u64::from(stand.sections) * u64::from(stand.poses);
        if end > count || stand.poses == 0 {
            let found = format!("{} poses up to section {end}", stand.poses);
            return Err(wrong(format!("stand {k}, poses"), found, format!("at least 1, up to section {count}")));
        }
        if stand.places.len() as u64 > most {
            return Err(wrong(format!("stand {k}, places"), stand.places.len(), format!("at most {most}")));
        }
        for (i, place) in stand.places.iter().enumerate() {
            rigid(&place.transform, || format!("stand {k}, place {i}, transform"))?;
            if place.pose >= stand.poses {
                let expected = format!("below {}", stand.poses);
                return Err(wrong(format!("stand {k}, place {i}, pose"), place.pose, expected));
            }
        }
    }
    Ok(())
}
