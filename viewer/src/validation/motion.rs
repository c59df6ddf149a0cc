//! Refuses sections and winds that contradict themselves.

use super::wrong;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::scene::Scene;

/// Validates sections: a buffer must hold all of them at so many `times`, the vertex stage must read it, and everything
/// that is carried must have a section.
pub(crate) fn sections(gpu: &Gpu, scene: &Scene, times: usize) -> Result<()> {
    let (count, of_vertices) = scene.sections.as_ref().map_or((0, [].as_slice()), |s| (s.count, &s.of_vertices));
    let reads = gpu.adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::VERTEX_STORAGE);
    if count > 0 && !reads {
        let found = format!("{count} on {}, whose vertex stage reads no buffers of numbers", gpu.info.name);
        let expected = "an adapter with Vulkan, Metal, DirectX 12 or a newer OpenGL, or a scene in which nothing moves";
        return Err(wrong("sections", found, expected));
    }
    // A number in single precision names the section of a vertex, and such numbers are exact up to 2^24.
    let limits = gpu.device.limits();
    let bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    let most = (bytes / (32 * times) as u64).min(1 << 24);
    if count as u64 > most {
        return Err(wrong("sections", count, format!("at most {most}")));
    }
    let seats = scene.sections.as_ref().and_then(|s| s.poses.as_ref()).map_or(count, |poses| poses.seats.len());
    if seats != count {
        return Err(wrong("sections, seats", seats, format!("{count}, one for each section")));
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

/// Validates the wind's time.
pub(super) fn wind(scene: &Scene) -> Result<()> {
    match &scene.wind {
        Some(wind) if !wind.time_s.is_finite() => Err(wrong("wind, time", wind.time_s, "a finite time")),
        _ => Ok(()),
    }
}
