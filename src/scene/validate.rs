//! What a scene manifest must say, beyond having the right fields. An error names file, line and field.

use super::manifest::{Day, Lobe, Manifest, Sky, View, ViewKind};
use crate::plant::beam::{TAPER_MAX, TAPER_MIN};
use crate::sky::preetham;
use crate::{Error, Result};
use std::collections::BTreeSet;

/// Most leaves of a cluster, pixels of a side, and samples: beyond these a typing error is likelier than a wish.
const MOST_LEAVES: usize = 100_000;
const MOST_PIXELS: u32 = 8192;
const MOST_SAMPLES: u32 = 1 << 16;
const MOST_BRANCHES: usize = 128;
const MOST_SECONDS: f64 = 1e6;

struct Place<'a> {
    manifest: &'a Manifest,
    text: &'a str,
}

impl Place<'_> {
    /// An error at `key` of the `index`-th `header` (`""`: the top of the file).
    fn error(&self, header: &str, index: usize, key: &str, what: impl std::fmt::Display) -> Error {
        let file = self.manifest.path.display();
        let place = match line_of(self.text, header, index, key) {
            Some(line) => format!("{file}:{line}"),
            None => file.to_string(),
        };
        let table = header.trim_matches(['[', ']']);
        let field = match (table, key) {
            ("", k) => k.to_string(),
            (t, "") => t.to_string(),
            (t, k) => format!("{t}.{k}"),
        };
        Error::Input { place: format!("{place}: {field}"), what: what.to_string() }
    }

    fn range(&self, header: &str, index: usize, key: &str, value: f64, limits: [f64; 2], unit: &str) -> Result<()> {
        let [low, high] = limits;
        if value >= low && value <= high {
            return Ok(());
        }
        let limits = if high.is_finite() { format!("{low} to {high} {unit}") } else { format!("at least {low} {unit}") };
        Err(self.error(header, index, key, format!("found {value}, expected {}", limits.trim_end())))
    }

    fn positive(&self, header: &str, index: usize, key: &str, value: f64, unit: &str) -> Result<()> {
        if value > 0.0 && value.is_finite() {
            return Ok(());
        }
        Err(self.error(header, index, key, format!("found {value}, expected a positive {unit}")))
    }

    fn finite(&self, header: &str, index: usize, key: &str, values: &[f64]) -> Result<()> {
        if values.iter().all(|v| v.is_finite()) {
            return Ok(());
        }
        Err(self.error(header, index, key, format!("found {values:?}, expected finite numbers")))
    }

    fn colour(&self, header: &str, key: &str, values: &[f64; 3]) -> Result<()> {
        if values.iter().all(|v| v.is_finite() && *v >= 0.0) {
            return Ok(());
        }
        Err(self.error(header, 0, key, format!("found {values:?}, expected three numbers of at least 0")))
    }

    fn leaf(&self, header: &str, index: usize, key: &str, name: &str) -> Result<()> {
        if self.manifest.leaf_index(name).is_some() {
            return Ok(());
        }
        let known: Vec<&str> = self.manifest.leaves.iter().map(|l| l.name.as_str()).collect();
        Err(self.error(header, index, key, format!("found \"{name}\", expected one of the scene's leaves ({})", known.join(", "))))
    }
}

/// Line (from 1) of `key = …` in the `index`-th table with this header, or of the header where the key is not there.
fn line_of(text: &str, header: &str, index: usize, key: &str) -> Option<usize> {
    let (mut seen, mut inside, mut fallback) = (0, header.is_empty(), None);
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.starts_with('[') {
            if inside {
                break;
            }
            if line.split('#').next().map(str::trim) == Some(header) {
                inside = seen == index;
                seen += 1;
                if inside {
                    fallback = Some(number + 1);
                }
            }
        } else if inside && line.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('=')) {
            return Some(number + 1);
        }
    }
    fallback
}

/// Checks everything the types do not.
///
/// # Errors
/// [`Error::Input`] for the first thing that is wrong.
pub fn validate(m: &Manifest, text: &str) -> Result<()> {
    let p = Place { manifest: m, text };
    if m.schema != 1 {
        return Err(p.error("", 0, "schema", format!("found {}, expected 1", m.schema)));
    }
    if m.name.is_empty() || m.name.chars().any(|c| !(c.is_ascii_alphanumeric() || c == '-' || c == '_')) {
        return Err(p.error("", 0, "name", format!("found \"{}\", expected letters, digits, - and _ (it names files)", m.name)));
    }
    p.range("", 0, "tolerance", m.tolerance, [1e-6, 0.5], "of the displayed range")?;
    p.positive("", 0, "exposure", m.exposure, "number")?;
    p.colour("", "background", &m.background)?;
    leaves(&p)?;
    branches(&p)?;
    placements(&p)?;
    lights(&p)?;
    views(&p)?;
    for (key, value, most) in [
        ("width", m.check.width, MOST_PIXELS),
        ("height", m.check.height, MOST_PIXELS),
        ("samples", m.check.samples, MOST_SAMPLES),
        ("frames", m.check.frames, MOST_SAMPLES),
    ] {
        p.range("[check]", 0, key, f64::from(value), [1.0, f64::from(most)], "")?;
    }
    Ok(())
}

fn leaves(p: &Place) -> Result<()> {
    const HEADER: &str = "[[leaf]]";
    let mut names = BTreeSet::new();
    for (i, leaf) in p.manifest.leaves.iter().enumerate() {
        let plain = !leaf.name.is_empty() && leaf.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        if !plain {
            return Err(p.error(HEADER, i, "name", format!("found \"{}\", expected letters, digits, - and _", leaf.name)));
        }
        if !names.insert(&leaf.name) {
            return Err(p.error(HEADER, i, "name", format!("\"{}\" is used twice, expected one leaf a name", leaf.name)));
        }
        let own = leaf.fit.is_some() || leaf.capture.is_some() || leaf.scan.is_some();
        if let Some(like) = &leaf.like {
            p.leaf(HEADER, i, "like", like)?;
            if own {
                return Err(p.error(HEADER, i, "like", "given beside a fit, capture or scan of its own; expected one of the two"));
            }
            if p.manifest.leaf_index(like).is_some_and(|k| p.manifest.leaves[k].like.is_some()) {
                return Err(p.error(
                    HEADER,
                    i,
                    "like",
                    format!("\"{like}\" is like another one itself; expected a leaf with data of its own"),
                ));
            }
        } else if !own {
            return Err(p.error(HEADER, i, "fit", "missing; expected a fit folder, a capture or a scan"));
        }
        if leaf.capture.is_some() && leaf.scan.is_some() {
            return Err(p.error(HEADER, i, "scan", "given beside a capture; expected one of the two"));
        }
        if let Some(scan) = &leaf.scan {
            if scan.size.is_some() && super::make::size(scan).is_none() {
                let found = scan.size.as_deref().unwrap_or_default();
                return Err(p.error(HEADER, i, "scan", format!("size: found \"{found}\", expected WIDTHxHEIGHT such as 240x180")));
            }
            for side in scan.field_mm.iter().flatten() {
                p.range(HEADER, i, "scan", *side, [0.1, 1e4], "mm of field")?;
            }
            p.range(HEADER, i, "scan", scan.frames.unwrap_or(100) as f64, [8.0, 10_000.0], "frames")?;
            p.range(HEADER, i, "scan", scan.noise.unwrap_or(0.0), [0.0, 1.0], "relative noise")?;
        }
        match (leaf.lobe, leaf.index) {
            (Lobe::CookTorrance, Some(n)) => p.range(HEADER, i, "index", n, [1.0, 4.0], "")?,
            (Lobe::CookTorrance, None) => return Err(p.error(HEADER, i, "index", "missing; the cook-torrance lobe needs one")),
            (_, Some(_)) => return Err(p.error(HEADER, i, "index", "given, but only the cook-torrance lobe has one")),
            (_, None) => {}
        }
    }
    Ok(())
}

fn branches(p: &Place) -> Result<()> {
    const HEADER: &str = "[[branch]]";
    let mut names = BTreeSet::new();
    for (i, b) in p.manifest.branches.iter().enumerate() {
        let plain = !b.name.is_empty() && b.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        if !plain {
            return Err(p.error(HEADER, i, "name", format!("found \"{}\", expected letters, digits, - and _", b.name)));
        }
        if !names.insert(&b.name) {
            return Err(p.error(HEADER, i, "name", format!("\"{}\" is used twice, expected one branch a name", b.name)));
        }
        p.range(HEADER, i, "length_mm", b.length_mm, [1.0, 1e5], "mm")?;
        p.range(HEADER, i, "radius_mm", b.radius_mm, [1e-3, b.length_mm], "mm")?;
        if let Some(taper) = b.taper {
            p.range(HEADER, i, "taper", taper, [TAPER_MIN, TAPER_MAX], "(tip radius over root radius)")?;
        }
        if let Some(load) = b.load_over_stiffness_mm {
            p.range(HEADER, i, "load_over_stiffness_mm", load, [0.0, 1e6], "mm")?;
        }
        for (key, given) in [("taper", b.taper.is_some()), ("load_over_stiffness_mm", b.load_over_stiffness_mm.is_some())] {
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
        if !b.bark.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Err(p.error(HEADER, i, "bark", format!("found {:?}, expected three reflectances, 0 to 1", b.bark)));
        }
        p.range(HEADER, i, "lean_per_m_s", b.lean_per_m_s, [0.0, 1.0], "of the length per m/s")?;
        p.range(HEADER, i, "damping", b.damping, [0.01, 10.0], "of the critical one")?;
        if let Some(f) = b.resonance_hz {
            p.range(HEADER, i, "resonance_hz", f, [1e-3, 1e3], "Hz")?;
        }
    }
    if p.manifest.branches.len() > MOST_BRANCHES {
        let found = p.manifest.branches.len();
        return Err(p.error(HEADER, MOST_BRANCHES, "name", format!("found {found} branches, expected at most {MOST_BRANCHES}")));
    }
    let Some(wind) = &p.manifest.wind else { return Ok(()) };
    p.range("[wind]", 0, "speed_m_s", wind.speed_m_s, [0.0, 100.0], "m/s")?;
    p.finite("[wind]", 0, "azimuth_deg", &[wind.azimuth_deg])?;
    p.range("[wind]", 0, "turbulence", wind.turbulence, [1e-3, 2.0], "of the mean speed")?;
    p.range("[wind]", 0, "time_s", wind.time_s, [-MOST_SECONDS, MOST_SECONDS], "s")
}

fn placements(p: &Place) -> Result<()> {
    let m = p.manifest;
    for (i, instance) in m.instances.iter().enumerate() {
        const HEADER: &str = "[[instance]]";
        p.leaf(HEADER, i, "leaf", &instance.leaf)?;
        p.finite(HEADER, i, "position_mm", &instance.position_mm)?;
        p.finite(HEADER, i, "rotation_deg", &instance.rotation_deg)?;
        p.positive(HEADER, i, "scale", instance.scale, "number")?;
        match &instance.branch {
            Some(name) if m.branch_index(name).is_none() => {
                let known: Vec<&str> = m.branches.iter().map(|b| b.name.as_str()).collect();
                let what = format!("found \"{name}\", expected one of the scene's branches ({})", known.join(", "));
                return Err(p.error(HEADER, i, "branch", what));
            }
            Some(_) => {
                let at = instance.at.ok_or_else(|| p.error(HEADER, i, "at", "missing; an instance on a branch needs it"))?;
                p.range(HEADER, i, "at", at, [0.0, 1.0], "(root to tip)")?;
                p.finite(HEADER, i, "offset_mm", &[instance.offset_mm.unwrap_or(0.0)])?;
            }
            None => {
                for (key, given) in [("at", instance.at.is_some()), ("offset_mm", instance.offset_mm.is_some())] {
                    if given {
                        return Err(p.error(HEADER, i, key, "given, but only instances on a branch have one"));
                    }
                }
            }
        }
    }
    if let Some(cluster) = &m.cluster {
        const HEADER: &str = "[cluster]";
        if cluster.leaves.is_empty() {
            return Err(p.error(HEADER, 0, "leaves", "empty, expected at least one leaf"));
        }
        for name in &cluster.leaves {
            p.leaf(HEADER, 0, "leaves", name)?;
        }
        p.range(HEADER, 0, "count", cluster.count as f64, [1.0, MOST_LEAVES as f64], "leaves")?;
        p.range(HEADER, 0, "length_mm", cluster.length_mm, [0.0, 1e6], "mm")?;
        p.range(HEADER, 0, "offset_mm", cluster.offset_mm, [0.0, 1e6], "mm")?;
        p.range(HEADER, 0, "droop_deg", cluster.droop_deg, [-180.0, 180.0], "degrees")?;
        p.range(HEADER, 0, "spread_deg", cluster.spread_deg, [0.0, 180.0], "degrees")?;
        p.positive(HEADER, 0, "scale", cluster.scale, "number")?;
    }
    if let Some(tree) = &m.tree {
        const HEADER: &str = "[tree]";
        if tree.leaves.is_empty() {
            return Err(p.error(HEADER, 0, "leaves", "empty, expected at least one leaf"));
        }
        for name in &tree.leaves {
            p.leaf(HEADER, 0, "leaves", name)?;
        }
        p.range(HEADER, 0, "count", tree.count as f64, [1.0, MOST_LEAVES as f64], "leaves")?;
        p.range(HEADER, 0, "height_mm", tree.height_mm, [1.0, 1e6], "mm")?;
        p.range(HEADER, 0, "crown_mm", tree.crown_mm, [1.0, 1e6], "mm")?;
        p.range(HEADER, 0, "offset_mm", tree.offset_mm, [0.0, 1e6], "mm")?;
        p.range(HEADER, 0, "droop_deg", tree.droop_deg, [-180.0, 180.0], "degrees")?;
        p.range(HEADER, 0, "spread_deg", tree.spread_deg, [0.0, 180.0], "degrees")?;
        p.positive(HEADER, 0, "scale", tree.scale, "number")?;
        if !tree.bark.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Err(p.error(HEADER, 0, "bark", format!("found {:?}, expected three reflectances, 0 to 1", tree.bark)));
        }
    }
    if m.instances.is_empty() && m.cluster.is_none() && m.tree.is_none() {
        return Err(p.error("", 0, "instance", "missing; expected at least one [[instance]], a [cluster] or a [tree]"));
    }
    Ok(())
}

fn lights(p: &Place) -> Result<()> {
    if let Some(sun) = &p.manifest.sun {
        p.range("[sun]", 0, "zenith_deg", sun.zenith_deg, [0.0, 180.0], "degrees")?;
        p.finite("[sun]", 0, "azimuth_deg", &[sun.azimuth_deg])?;
        match &sun.irradiance {
            Some(irradiance) => p.colour("[sun]", "irradiance", irradiance)?,
            None if p.manifest.physical_sky() => {}
            None => return Err(p.error("[sun]", 0, "irradiance", "missing; only a sun under a physical sky has its light from the model")),
        }
        p.range("[sun]", 0, "radius_deg", sun.radius_deg, [0.0, 45.0], "degrees")?;
    }
    if let Some(sky) = &p.manifest.sky {
        one_sky(p, sky)?;
    }
    if p.manifest.sun_moves() && !p.manifest.physical_sky() {
        let (header, key) = if p.manifest.day.is_some() { ("[day]", "") } else { ("[sun]", "moves") };
        return Err(p.error(header, 0, key, "given, but only a scene with a physical sky (sky.model) has a sun that moves"));
    }
    if let Some(day) = &p.manifest.day {
        one_day(p, day)?;
    }
    if p.manifest.sun.is_none() && p.manifest.sky.is_none() {
        return Err(p.error("", 0, "sun", "missing, and no [sky] either; expected some light"));
    }
    Ok(())
}

fn one_sky(p: &Place, sky: &Sky) -> Result<()> {
    const HEADER: &str = "[sky]";
    if let Some(radiance) = &sky.radiance {
        for (key, given) in [
            ("model", sky.model.is_some()),
            ("turbidity", sky.turbidity.is_some()),
            ("ground_albedo", sky.ground_albedo.is_some()),
            ("scale", sky.scale.is_some()),
        ] {
            if given {
                return Err(p.error(HEADER, 0, key, "given beside radiance; a constant sky has none, a physical one no radiance"));
            }
        }
        return p.colour(HEADER, "radiance", radiance);
    }
    if sky.model.is_none() {
        return Err(p.error(HEADER, 0, "radiance", "missing, and no model either; expected a constant radiance or model = \"preetham\""));
    }
    let Some(sun) = &p.manifest.sun else {
        return Err(p.error(HEADER, 0, "model", "given without a [sun]; a physical sky needs one"));
    };
    p.range("[sun]", 0, "zenith_deg", sun.zenith_deg, [0.0, 90.0], "degrees (the sun of a physical sky stands above the horizon)")?;
    let Some(turbidity) = sky.turbidity else {
        return Err(p.error(HEADER, 0, "turbidity", "missing; a physical sky needs one"));
    };
    if p.manifest.sun_moves() {
        p.range(HEADER, 0, "turbidity", turbidity, preetham::TRUSTED, "where the sun moves (what the polynomials were fitted to)")?;
    }
    p.range(HEADER, 0, "turbidity", turbidity, preetham::TURBIDITIES, "")?;
    for albedo in sky.ground_albedo.iter().flatten() {
        p.range(HEADER, 0, "ground_albedo", *albedo, [0.0, 1.0], "a channel")?;
    }
    sky.scale.map_or(Ok(()), |scale| p.positive(HEADER, 0, "scale", scale, "number of scene units a kcd/m\u{b2}"))
}

fn one_day(p: &Place, day: &Day) -> Result<()> {
    const HEADER: &str = "[day]";
    p.range(HEADER, 0, "latitude_deg", day.latitude_deg, [-90.0, 90.0], "degrees")?;
    p.range(HEADER, 0, "declination_deg", day.declination_deg, [-23.45, 23.45], "degrees")?;
    if day.hours.is_empty() || day.hours.len() > 64 {
        return Err(p.error(HEADER, 0, "hours", format!("found {} of them, expected 1 to 64", day.hours.len())));
    }
    for hour in &day.hours {
        p.range(HEADER, 0, "hours", *hour, [0.0, 24.0], "hours")?;
        if super::daylight::sun_of(day, *hour).0 > std::f64::consts::FRAC_PI_2 + 1e-9 {
            return Err(p.error(HEADER, 0, "hours", format!("the sun is below the horizon at {hour}, expected hours of daylight")));
        }
    }
    Ok(())
}

fn views(p: &Place) -> Result<()> {
    const HEADER: &str = "[[view]]";
    if p.manifest.views.is_empty() {
        return Err(p.error("", 0, "view", "missing; expected at least one [[view]]"));
    }
    let mut names = BTreeSet::new();
    for (i, view) in p.manifest.views.iter().enumerate() {
        if view.name.is_empty() || view.name.chars().any(|c| !(c.is_ascii_alphanumeric() || c == '-' || c == '_')) {
            return Err(p.error(HEADER, i, "name", format!("found \"{}\", expected letters, digits, - and _", view.name)));
        }
        if !names.insert(&view.name) {
            return Err(p.error(HEADER, i, "name", format!("\"{}\" is used twice, expected one view a name", view.name)));
        }
        one_view(p, i, view)?;
    }
    Ok(())
}

fn one_view(p: &Place, i: usize, view: &View) -> Result<()> {
    const HEADER: &str = "[[view]]";
    let missing = |key: &str| p.error(HEADER, i, key, format!("missing; view \"{}\" needs it", view.name));
    let (Some(eye), Some(target)) = (view.eye_mm, view.target_mm) else {
        return Err(missing(if view.eye_mm.is_none() { "eye_mm" } else { "target_mm" }));
    };
    p.finite(HEADER, i, "eye_mm", &eye)?;
    p.finite(HEADER, i, "target_mm", &target)?;
    let forward = glam::DVec3::from(target) - glam::DVec3::from(eye);
    if forward.length() < 1e-9 {
        return Err(p.error(HEADER, i, "target_mm", "is where the eye is, expected another point"));
    }
    let up = glam::DVec3::from(view.up.unwrap_or([0.0, 0.0, 1.0]));
    p.finite(HEADER, i, "up", &up.to_array())?;
    if forward.normalize().cross(up.normalize_or_zero()).length() < 1e-6 {
        return Err(p.error(HEADER, i, "up", "points along the line of sight, expected a direction across it"));
    }
    p.range(HEADER, i, "fov_deg", view.fov_deg.ok_or_else(|| missing("fov_deg"))?, [0.1, 150.0], "degrees")?;
    p.range(HEADER, i, "max_error", view.max_error.ok_or_else(|| missing("max_error"))?, [0.0, 1.0], "")?;
    match view.kind {
        ViewKind::Perspective => {
            p.range(HEADER, i, "flip_p99", view.flip_p99.ok_or_else(|| missing("flip_p99"))?, [0.0, 1.0], "")?;
            for (key, given) in [("leaf", view.leaf.is_some()), ("rotation_deg", view.rotation_deg.is_some())] {
                if given {
                    return Err(p.error(HEADER, i, key, "given, but only card views have one"));
                }
            }
        }
        ViewKind::Card => {
            p.leaf(HEADER, i, "leaf", view.leaf.as_deref().ok_or_else(|| missing("leaf"))?)?;
            p.finite(HEADER, i, "rotation_deg", &view.rotation_deg.unwrap_or_default())?;
            if view.flip_p99.is_some() {
                return Err(p.error(HEADER, i, "flip_p99", "given, but a card is judged by max_error alone"));
            }
        }
    }
    if let Some(time) = view.time_s {
        let what = match (&p.manifest.wind, view.kind) {
            (_, ViewKind::Card) => "given, but a card does not move",
            (None, _) => "given, but the scene has no [wind]",
            _ => "",
        };
        if !what.is_empty() {
            return Err(p.error(HEADER, i, "time_s", what));
        }
        p.range(HEADER, i, "time_s", time, [-MOST_SECONDS, MOST_SECONDS], "s")?;
    }
    if let Some(ms) = view.frame_ms {
        p.positive(HEADER, i, "frame_ms", ms, "time")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    const GOOD: &str = r#"
schema = 1
name = "s"
tolerance = 0.004
[[leaf]]
name = "elm"
fit = "fits/elm"
[[instance]]
leaf = "elm"
[sun]
zenith_deg = 30
irradiance = [3, 3, 3]
[[view]]
name = "a"
kind = "perspective"
eye_mm = [0, -10, 100]
target_mm = [0, 0, 0]
fov_deg = 30
flip_p99 = 0.1
max_error = 0.1
"#;

    fn verdict(text: &str) -> String {
        let dir = tempfile::tempdir().unwrap();
        let path: PathBuf = dir.path().join("s.toml");
        std::fs::write(&path, text).unwrap();
        match Manifest::read(&path) {
            Ok(_) => "ok".into(),
            Err(e) => {
                assert_eq!(e.exit_code(), 2);
                e.to_string().replace(&format!("{}/", dir.path().display()), "")
            }
        }
    }

    #[test]
    fn a_mistake_is_named_with_its_line_and_field() {
        assert_eq!(verdict(GOOD), "ok");
        for (from, to, expected) in [
            ("zenith_deg = 30", "zenith_deg = 300", "s.toml:11: sun.zenith_deg: found 300, expected 0 to 180 degrees"),
            ("zenith_deg = 30", "zenit_deg = 30", "s.toml:11: unknown field `zenit_deg`"),
            ("leaf = \"elm\"", "leaf = \"oak\"", "s.toml:9: instance.leaf: found \"oak\", expected one of the scene's leaves (elm)"),
            ("fov_deg = 30", "", "s.toml:13: view.fov_deg: missing; view \"a\" needs it"),
            ("target_mm = [0, 0, 0]", "target_mm = [0, -10, 100]", "s.toml:17: view.target_mm: is where the eye is"),
            ("tolerance = 0.004", "tolerance = nan", "s.toml:4: tolerance: found NaN"),
            ("schema = 1", "schema = 2", "s.toml:2: schema: found 2, expected 1"),
            ("fit = \"fits/elm\"", "", "s.toml:5: leaf.fit: missing"),
            (
                "leaf = \"elm\"",
                "leaf = \"elm\"\nbranch = \"twig\"\nat = 0.5",
                "s.toml:10: instance.branch: found \"twig\", expected one of the scene's branches ()",
            ),
            ("leaf = \"elm\"", "leaf = \"elm\"\nat = 0.5", "s.toml:10: instance.at: given, but only instances on a branch have one"),
            ("max_error = 0.1", "max_error = 0.1\ntime_s = 2", "s.toml:21: view.time_s: given, but the scene has no [wind]"),
            ("[sun]", "[wind]\nspeed_m_s = -3\nseed = 1\n[sun]", "s.toml:11: wind.speed_m_s: found -3, expected 0 to 100 m/s"),
            (
                "[sun]",
                "[[branch]]\nname = \"b\"\nlength_mm = 100\nradius_mm = 1\ntaper = 2\ndirection = [1, 0, 0]\nbark = [0.1, 0.1, 0.1]\n[sun]",
                "s.toml:14: branch.taper: found 2, expected 0.0001 to 1.25 (tip radius over root radius)",
            ),
            (
                "[sun]",
                "[[branch]]\nname = \"b\"\nlength_mm = 100\nradius_mm = 1\ndirection = [0, 0, 0]\nbark = [0.1, 0.1, 0.1]\n[sun]",
                "s.toml:14: branch.direction: found no length, expected the way from root to tip",
            ),
        ] {
            assert!(GOOD.contains(from));
            let found = verdict(&GOOD.replacen(from, to, 1));
            assert!(found.starts_with(expected), "{found}\nexpected {expected}");
        }
    }
}
