//! Checks where leaves stand: single leaves and whole plants, and what is below them.

use super::place::ManifestText;
use crate::manifest::{GRAINS_A_TILE, MOST_LEAF_RESONANCE, Result, SceneMaterial};

/// The largest number of plants of a `[[plant]]`.
const MOST_PLANTS: usize = 2_000_000;
/// Least and largest factor on the scale of single plants.
const SCALES: [f64; 2] = [1e-3, 1e3];

pub fn placements(p: &ManifestText) -> Result<()> {
    let m = p.manifest;
    for (i, instance) in m.instances.iter().enumerate() {
        const HEADER: &str = "[[instance]]";
        p.leaf(HEADER, i, "leaf", &instance.leaf)?;
        p.finite(HEADER, i, "position_mm", &instance.position_mm)?;
        p.finite(HEADER, i, "rotation_deg", &instance.rotation_deg)?;
        p.positive(HEADER, i, "scale", instance.scale, "number")?;
        if instance.unit.is_some() && instance.positions.is_none() {
            return Err(p.error(HEADER, i, "unit", "given without a list of positions"));
        }
    }
    plants(p)?;
    if let Some(ground) = &m.ground {
        const HEADER: &str = "[ground]";
        if ground.albedo.iter().all(|v| v.is_nan()) {
            return Err(p.error(HEADER, 0, "albedo", "missing; expected three reflectances, 0 to 1, or a spectrum"));
        }
        p.reflectance(HEADER, 0, "albedo", &ground.albedo)?;
        match (ground.reach_mm, &m.periodic) {
            (Some(_), Some(_)) => {
                return Err(p.error(HEADER, 0, "reach_mm", "given, but the ground of a periodic scene covers it"));
            }
            (Some(reach), None) => p.positive(HEADER, 0, "reach_mm", reach, "length in mm")?,
            (None, None) => return Err(p.error(HEADER, 0, "reach_mm", "missing; half the width of the ground")),
            (None, Some(_)) => {}
        }
        p.finite(HEADER, 0, "height_mm", &[ground.height_mm])?;
        if let Some(hill) = &ground.hill {
            p.range(HEADER, 0, "hill.radius_mm", hill.radius_mm, [1.0, 1e6], "mm")?;
            let most = hill.radius_mm;
            p.range(HEADER, 0, "hill.height_mm", hill.height_mm, [-most, most], "mm, up to the radius")?;
            p.finite(HEADER, 0, "hill.position_mm", &hill.position_mm)?;
            let leans = m.wind.is_some() && m.grass.iter().any(|g| g.lean_per_m_s > 0.0);
            for (what, given) in [
                ("[transfer]", m.transfer.is_some()),
                ("[periodic]", m.periodic.is_some()),
                ("grain_mm", ground.grain_mm.is_some()),
                ("a lawn that the wind leans", leans),
            ] {
                if given {
                    let told = format!("given beside {what}, for which the ground is level; expected one of the two");
                    return Err(p.error(HEADER, 0, "hill", told));
                }
            }
        }
        if let Some(grain) = ground.grain_mm {
            let across = m.periodic.as_ref().map(|p| p.size_mm[0].max(p.size_mm[1]));
            let across = across.or(ground.reach_mm.map(|r| 2.0 * r)).unwrap_or_default();
            // The ground has at most 256 × 256 of the squares that repeat.
            p.range(HEADER, 0, "grain_mm", grain, [across / (256.0 * GRAINS_A_TILE), 1e6], "mm")?;
            p.range(HEADER, 0, "contrast", ground.contrast(), [0.0, 1.0], "")?;
        } else if ground.contrast.is_some() {
            return Err(p.error(
                HEADER,
                0,
                "contrast",
                "given without grain_mm, the size of what differs from the mean",
            ));
        }
    }
    if let Some(periodic) = &m.periodic {
        for size in periodic.size_mm {
            p.positive("[periodic]", 0, "size_mm", size, "length in mm")?;
        }
    }
    if m.instances.is_empty() && m.plants.is_empty() && m.grass.is_empty() {
        let what = "missing; expected at least one [[instance]], a [[plant]] or a [[grass]]";
        return Err(p.error("", 0, "instance", what));
    }
    Ok(())
}

/// Checks whole plants: where they come from, what their materials are, where they stand.
fn plants(p: &ManifestText) -> Result<()> {
    const HEADER: &str = "[[plant]]";
    for (i, plant) in p.manifest.plants.iter().enumerate() {
        match (&plant.file, &plant.grow) {
            (Some(_), Some(_)) => {
                return Err(p.error(HEADER, i, "grow", "given beside a file; expected one of the two"));
            }
            (None, None) => {
                return Err(p.error(HEADER, i, "file", "missing; expected a file, or grow = a description"));
            }
            (Some(_), None) if plant.grow_seed.is_some() => {
                return Err(p.error(HEADER, i, "grow_seed", "given, but a file is not grown"));
            }
            _ => {}
        }
        for matter in plant.materials.values() {
            match matter {
                SceneMaterial::Leaf(name) => p.leaf(HEADER, i, "materials", name)?,
                SceneMaterial::Bark(bark) => p.reflectance(HEADER, i, "materials", bark)?,
            }
        }
        p.finite(HEADER, i, "position_mm", &plant.position_mm)?;
        p.finite(HEADER, i, "rotation_deg", &plant.rotation_deg)?;
        p.positive(HEADER, i, "scale", plant.scale, "number")?;
        p.positive(HEADER, i, "leaf_scale", plant.leaf_scale, "number")?;
        p.range(HEADER, i, "drag_n_s_m3", plant.drag_n_s_m3, [0.0, 1e3], "N per m/s and m²")?;
        p.range(HEADER, i, "damping", plant.damping, [0.01, 10.0], "of the critical one")?;
        p.range(HEADER, i, "wood_kg_m3", plant.wood_kg_m3, [1.0, 1e4], "kg/m³")?;
        p.range(HEADER, i, "leaf_kg_m2", plant.leaf_kg_m2, [0.0, 100.0], "kg/m²")?;
        if let Some(flutter) = &plant.flutter {
            p.range(HEADER, i, "flutter.deg_per_m_s", flutter.deg_per_m_s, [1e-6, 100.0], "degrees per m/s")?;
            let unit = "Hz: above, it would repeat within ten minutes";
            p.range(HEADER, i, "flutter.resonance_hz", flutter.resonance_hz, [0.05, MOST_LEAF_RESONANCE], unit)?;
            p.range(HEADER, i, "flutter.damping", flutter.damping, [0.2, 10.0], "of the critical one")?;
        }
        p.range(HEADER, i, "count", plant.count as f64, [1.0, MOST_PLANTS as f64], "plants")?;
        if plant.positions.is_some() && (plant.count > 1 || plant.area_mm.is_some()) {
            let told = "given beside a count or an area; expected one of the two";
            return Err(p.error(HEADER, i, "positions", told));
        }
        if plant.unit.is_some() && plant.positions.is_none() {
            return Err(p.error(HEADER, i, "unit", "given without a list of positions"));
        }
        if let Some([low, high]) = plant.scales {
            p.range(HEADER, i, "scales", low, SCALES, "")?;
            p.range(HEADER, i, "scales", high, [low, SCALES[1]], "")?;
        }
        match plant.area_mm {
            Some(area) => area.iter().try_for_each(|a| p.positive(HEADER, i, "area_mm", *a, "length in mm"))?,
            None if plant.positions.is_some() => {}
            None if plant.count > 1 => {
                return Err(p.error(HEADER, i, "area_mm", "missing; several plants need an area"));
            }
            None => {}
        }
    }
    Ok(())
}
