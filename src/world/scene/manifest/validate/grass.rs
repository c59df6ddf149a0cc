//! Checks grass: it needs a ground, and its slices come from a fit or from stated figures.

use super::place::ManifestText;
use crate::manifest::Result;

/// The largest number of rectangles in a lawn. Each is an instance for the path tracer.
const MOST_TILES: usize = 1_000_000;
/// The largest number of rectangles in an irregular lawn. Each has 64 instances for every material of its blades.
const MOST_IRREGULAR: usize = MOST_TILES / 64;
/// The largest distance of a lawn's middle from the origin along x or y (mm). Single precision has steps of 1/16 mm
/// there.
const FARTHEST: f64 = 1e6;
/// The renderer's own limit.
const MOST_STEPS: f64 = 256.0;

pub fn grass(p: &ManifestText) -> Result<()> {
    const HEADER: &str = "[[grass]]";
    let m = p.manifest;
    let mut names = p.names(HEADER, "lawn");
    for (i, grass) in m.grass.iter().enumerate() {
        names.take(i, &grass.name)?;
        if m.ground.is_none() {
            return Err(p.error(HEADER, i, "", "given without a [ground]; grass stands on the ground"));
        }
        for (what, given) in [("[transfer]", m.transfer.is_some()), ("[periodic]", m.periodic.is_some())] {
            if given {
                let told = format!("given beside {what}, which knows no [[grass]]; expected one of the two");
                return Err(p.error(HEADER, i, "", told));
            }
        }
        for (key, given) in [("slices", grass.slices.is_some()), ("texels", grass.texels.is_some())] {
            if given && grass.fit.is_some() {
                return Err(p.error(HEADER, i, key, "given beside a fit, which has its own; expected one of the two"));
            }
        }
        if let Some(slices) = grass.slices {
            p.range(HEADER, i, "slices", slices as f64, [1.0, 64.0], "slices")?;
        }
        if let Some(texels) = grass.texels
            && !texels.iter().all(|n| n.is_power_of_two() && (4..=1024).contains(n))
        {
            return Err(p.error(HEADER, i, "texels", format!("found {texels:?}, expected powers of two, 4 to 1024")));
        }
        if !grass.position_mm.iter().all(|v| v.abs() <= FARTHEST) {
            let found = format!("found {:?}, expected numbers from -{FARTHEST:.0} to {FARTHEST:.0}", grass.position_mm);
            return Err(p.error(HEADER, i, "position_mm", found));
        }
        p.range(HEADER, i, "steps", grass.steps as f64, [1.0, MOST_STEPS], "slices")?;
        p.range(HEADER, i, "lean_per_m_s", grass.lean_per_m_s, [0.0, 1.0], "of the height per m/s")?;
        let irregular = grass.irregular_seed.is_some();
        if irregular && grass.slices.is_some_and(|n| !n.is_multiple_of(8)) {
            let found =
                format!("found {:?}, expected a multiple of 8 beside irregular_seed", grass.slices.unwrap_or(0));
            return Err(p.error(HEADER, i, "slices", found));
        }
        let tiles = grass.tiles[0].saturating_mul(grass.tiles[1]);
        let most = if irregular { MOST_IRREGULAR } else { MOST_TILES };
        if !(1..=most).contains(&tiles) {
            let found = format!("found {:?}, expected 1 to {most} rectangles together", grass.tiles);
            return Err(p.error(HEADER, i, "tiles", found));
        }
    }
    Ok(())
}
