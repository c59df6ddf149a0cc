//! Refuses a transfer, and shares of the sun, that do not fit the scene.

use super::wrong;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::passes::transfer::columns;
use crate::scene::{Scene, SideMaps};

/// Validates shares of the sun: there is one byte for every vertex of an instance that has shares.
pub(super) fn shares(gpu: &Gpu, scene: &Scene) -> Result<()> {
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

/// Validates the transfer. Everything that stands in the scene must have rows in it.
pub(super) fn transfer(gpu: &Gpu, scene: &Scene) -> Result<()> {
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
    // The light that arrives takes 16 bytes a row.
    let bytes = (8 * transfer.entries.len()).max(16 * rows) as u64;
    let most = gpu.device.limits().max_storage_buffer_binding_size;
    if transfer.entries.is_empty() || bytes > most || !transfer.entries.len().is_multiple_of(columns) {
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
        if !(1..=8).contains(&anchors.levels) || instance.first_level >= anchors.levels || instance.first_row >> 28 != 0
        {
            let found =
                format!("level {} of {}, first row {}", instance.first_level, anchors.levels, instance.first_row);
            let expected = "one of 1 to 8 levels, and a row below 268435456";
            return Err(wrong(format!("instance {i}, anchors"), found, expected));
        }
        let whole = anchors.places.len() == mesh.positions.len() && anchors.grid.iter().all(|n| *n > 0);
        let count = if whole { anchors.count(instance.first_level) } else { 0 };
        let end = instance.first_row as usize + count * anchors.rows as usize;
        if !whole || !known.contains(&(anchors.rows as usize)) || end > rows {
            let found = format!("{} places, {} rows an anchor, up to row {end}", anchors.places.len(), anchors.rows);
            let expected = format!("{} places, {known:?} rows an anchor, below {rows}", mesh.positions.len());
            return Err(wrong(format!("instance {i}, anchors"), found, expected));
        }
    }
    Ok(())
}
