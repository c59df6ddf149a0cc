//! Checks what a scene states about branches of its plants, and the wind that moves them.

use super::MOST_SECONDS;
use super::place::ManifestText;
use crate::manifest::{BranchOverride, Result};
use mesophyll_plants::mechanics::beam::{TAPER_MAX, TAPER_MIN};
use std::collections::BTreeSet;

/// Checks the branches of all plants.
pub fn branches(p: &ManifestText) -> Result<()> {
    let mut before = 0;
    for plant in &p.manifest.plants {
        let mut seen = BTreeSet::new();
        for (k, own) in plant.branches.iter().enumerate() {
            branch(p, before + k, own)?;
            if !seen.insert((own.name.as_deref(), own.level)) {
                let (key, what) = match (&own.name, own.level) {
                    (Some(name), _) => ("name", format!("\"{name}\"")),
                    (None, level) => ("level", level.unwrap_or(0).to_string()),
                };
                let what = format!("{what} is given twice for one plant, expected each once");
                return Err(p.error(HEADER, before + k, key, what));
            }
        }
        before += plant.branches.len();
    }
    Ok(())
}

const HEADER: &str = "[[plant.branch]]";

fn branch(p: &ManifestText, i: usize, own: &BranchOverride) -> Result<()> {
    match (&own.name, own.level) {
        (Some(_), Some(_)) => return Err(p.error(HEADER, i, "level", "given beside a name; expected one of the two")),
        (None, None) => return Err(p.error(HEADER, i, "name", "missing; expected a branch's name, or a level")),
        _ => {}
    }
    let ranges = [
        ("taper", own.taper, [TAPER_MIN, TAPER_MAX], "(tip radius over root radius)"),
        ("load_over_stiffness_mm", own.load_over_stiffness_mm, [0.0, 1e6], "mm"),
        ("lean_per_m_s", own.lean_per_m_s, [0.0, 1.0], "of the length per m/s"),
        ("resonance_hz", own.resonance_hz, [1e-3, 1e3], "Hz"),
        ("damping", own.damping, [0.01, 10.0], "of the critical one"),
    ];
    for (key, value, limits, unit) in ranges {
        value.map_or(Ok(()), |value| p.range(HEADER, i, key, value, limits, unit))?;
    }
    for (key, given) in
        [("taper", own.taper.is_some()), ("load_over_stiffness_mm", own.load_over_stiffness_mm.is_some())]
    {
        if given && own.fit.is_some() {
            return Err(p.error(HEADER, i, key, "given beside a fit, which says it; expected one of the two"));
        }
    }
    if own.measured.is_some() && own.fit.is_none() {
        return Err(p.error(HEADER, i, "measured", "given without a fit that could hold it"));
    }
    if own.fit.is_some() && own.measured.is_none() && own.name.is_none() {
        return Err(p.error(HEADER, i, "measured", "missing; a level has no name that its fit could hold"));
    }
    let says = ranges.iter().any(|r| r.1.is_some()) || own.fit.is_some();
    if !says {
        return Err(p.error(HEADER, i, "name", "nothing is stated for it; expected a taper, a load, a fit or a sway"));
    }
    Ok(())
}

/// Checks the wind.
pub fn wind(p: &ManifestText) -> Result<()> {
    let Some(wind) = &p.manifest.wind else { return Ok(()) };
    p.range("[wind]", 0, "speed_m_s", wind.speed_m_s, [0.0, 100.0], "m/s")?;
    p.finite("[wind]", 0, "azimuth_deg", &[wind.azimuth_deg])?;
    p.range("[wind]", 0, "turbulence", wind.turbulence, [1e-3, 2.0], "of the mean speed")?;
    p.range("[wind]", 0, "time_s", wind.time_s, [-MOST_SECONDS, MOST_SECONDS], "s")
}
