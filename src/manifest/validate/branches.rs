//! Branches and the wind that bends them.

use super::MOST_SECONDS;
use super::place::Place;
use crate::Result;
use mesophyll_plant::beam::{TAPER_MAX, TAPER_MIN};

/// The largest number of branches that the renderer takes.
const MOST_BRANCHES: usize = 128;

pub fn branches(p: &Place) -> Result<()> {
    const HEADER: &str = "[[branch]]";
    let mut names = p.names(HEADER, "branch");
    for (i, b) in p.manifest.branches.iter().enumerate() {
        names.take(i, &b.name)?;
        p.range(HEADER, i, "length_mm", b.length_mm, [1.0, 1e5], "mm")?;
        p.range(HEADER, i, "radius_mm", b.radius_mm, [1e-3, b.length_mm], "mm")?;
        if let Some(taper) = b.taper {
            p.range(HEADER, i, "taper", taper, [TAPER_MIN, TAPER_MAX], "(tip radius over root radius)")?;
        }
        if let Some(load) = b.load_over_stiffness_mm {
            p.range(HEADER, i, "load_over_stiffness_mm", load, [0.0, 1e6], "mm")?;
        }
        for (key, given) in
            [("taper", b.taper.is_some()), ("load_over_stiffness_mm", b.load_over_stiffness_mm.is_some())]
        {
            if given && b.fit.is_some() {
                return Err(p.error(HEADER, i, key, "given beside a fit, which says it; expected one of the two"));
            }
        }
        if b.measured.is_some() && b.fit.is_none() {
            return Err(p.error(HEADER, i, "measured", "given without a fit that could hold it"));
        }
        p.finite(HEADER, i, "position_mm", &b.position_mm)?;
        p.finite(HEADER, i, "direction", &b.direction)?;
        if glam::DVec3::from(b.direction).length() < 1e-9 {
            return Err(p.error(HEADER, i, "direction", "found no length, expected the way from root to tip"));
        }
        p.reflectance(HEADER, i, "bark", &b.bark)?;
        p.range(HEADER, i, "lean_per_m_s", b.lean_per_m_s, [0.0, 1.0], "of the length per m/s")?;
        p.range(HEADER, i, "damping", b.damping, [0.01, 10.0], "of the critical one")?;
        if let Some(f) = b.resonance_hz {
            p.range(HEADER, i, "resonance_hz", f, [1e-3, 1e3], "Hz")?;
        }
    }
    if p.manifest.branches.len() > MOST_BRANCHES {
        let found = p.manifest.branches.len();
        return Err(p.error(
            HEADER,
            MOST_BRANCHES,
            "name",
            format!("found {found} branches, expected at most {MOST_BRANCHES}"),
        ));
    }
    let Some(wind) = &p.manifest.wind else { return Ok(()) };
    p.range("[wind]", 0, "speed_m_s", wind.speed_m_s, [0.0, 100.0], "m/s")?;
    p.finite("[wind]", 0, "azimuth_deg", &[wind.azimuth_deg])?;
    p.range("[wind]", 0, "turbulence", wind.turbulence, [1e-3, 2.0], "of the mean speed")?;
    p.range("[wind]", 0, "time_s", wind.time_s, [-MOST_SECONDS, MOST_SECONDS], "s")
}
