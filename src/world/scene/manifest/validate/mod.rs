//! Checks what a scene manifest must state, beyond having the right fields. An error names file, line and field.

mod branches;
mod grass;
mod leaves;
mod lights;
mod place;
mod placements;
mod views;

use super::{CheckSettings, SceneManifest};
use crate::manifest::Result;
use place::{ManifestText, plain};

/// The largest numbers of pixels along a side, of samples, and of seconds of a wind. A larger number is more likely a
/// typing error than meant.
const MOST_PIXELS: u32 = 8192;
const MOST_SAMPLES: u32 = 1 << 16;
const MOST_SECONDS: f64 = 1e6;

/// Checks everything that the types cannot ensure.
///
/// # Errors
/// [`Error::Input`] for the first fault.
pub fn validate(m: &SceneManifest, text: &str) -> Result<()> {
    let p = ManifestText { manifest: m, text };
    if m.schema != 1 {
        return Err(p.error("", 0, "schema", format!("found {}, expected 1", m.schema)));
    }
    if !plain(&m.name) {
        return Err(p.error(
            "",
            0,
            "name",
            format!("found \"{}\", expected letters, digits, - and _ (it names files)", m.name),
        ));
    }
    if let Some(tolerance) = m.tolerance {
        p.range("", 0, "tolerance", tolerance, [1e-6, 0.5], "of the displayed range")?;
    }
    p.positive("", 0, "exposure", m.exposure, "number")?;
    if let Some(share) = m.bloom {
        p.range("", 0, "bloom", share, [0.0, 0.5], "of the light")?;
    }
    p.colour("", "background", &m.background)?;
    leaves::leaves(&p)?;
    placements::placements(&p)?;
    branches::branches(&p)?;
    branches::wind(&p)?;
    grass::grass(&p)?;
    lights::lights(&p)?;
    views::views(&p)?;
    for (key, value, most) in [
        ("width", m.check.width, MOST_PIXELS),
        ("height", m.check.height, MOST_PIXELS),
        ("samples", m.check.samples, MOST_SAMPLES),
        ("frames", m.check.frames, MOST_SAMPLES),
    ] {
        p.range("[check]", 0, key, f64::from(value), [1.0, f64::from(most)], "")?;
    }
    p.range("[check]", 0, "seconds", m.check.seconds, [0.0, 60.0], "s")?;
    p.range("[check]", 0, "fps", m.check.fps, [1.0, 240.0], "frames a second")?;
    if m.check.seconds > 0.0 {
        let least = f64::from(CheckSettings::FILM_BLOCK);
        for (key, value) in [("width", m.check.width), ("height", m.check.height)] {
            p.range("[check]", 0, key, f64::from(value), [least, f64::INFINITY], "pixels, for a film's blocks")?;
        }
        if m.wind.is_none() {
            return Err(p.error("[check]", 0, "seconds", "given, but the scene has no [wind], so that nothing moves"));
        }
        if m.check.film_frames() < 3 {
            let found = format!("found {} s at {} frames a second", m.check.seconds, m.check.fps);
            return Err(p.error("[check]", 0, "seconds", format!("{found}, expected at least three frames")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::{SceneSun, SunLight};
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
        match SceneManifest::read(&path) {
            Ok(_) => "ok".into(),
            Err(e) => {
                assert!(e.is_usage());
                e.to_string().replace(&format!("{}/", dir.path().display()), "")
            }
        }
    }

    #[test]
    fn a_mistake_is_named_with_its_line_and_field() {
        assert_eq!(verdict(GOOD), "ok");
        for (from, to, expected) in [
            ("zenith_deg = 30", "zenith_deg = 300", "s.toml:11: sun.zenith_deg: found 300, expected 0 to 180 degrees"),
            ("zenith_deg = 30", "zenit_deg = 30", "s.toml:11: sun.zenit_deg: no field of a sun; expected zenith_deg"),
            (
                "leaf = \"elm\"",
                "leaf = \"oak\"",
                "s.toml:9: instance.leaf: found \"oak\", expected one of the scene's leaves (elm)",
            ),
            ("fov_deg = 30", "", "s.toml:13: view.fov_deg: missing; view \"a\" needs it"),
            (
                "fov_deg = 30",
                "fov_deg = \"wide\"",
                "s.toml:18: view.fov_deg: invalid type: string \"wide\", expected f64",
            ),
            (
                "fov_deg = 30",
                "fov_deg = 30\nleaf = \"elm\"",
                "s.toml:19: view.leaf: given, but view \"a\" is a perspective view, which shows the whole scene; \
                 expected its fields name, kind, eye_mm, target_mm, up, fov_deg, time_s, flip_p99, max_error, \
                 frame_ms, blocks, judged_by",
            ),
            (
                "max_error = 0.1",
                "max_error = 0.1\nblokcs = 8",
                "s.toml:21: view.blokcs: given, but view \"a\" is a perspective view, which shows the whole scene; \
                 expected blocks of its fields name, kind",
            ),
            ("\"perspective\"", "\"card\"", "s.toml:13: view.leaf: missing; view \"a\" needs it"),
            (
                "\"perspective\"",
                "\"card\"\nleaf = \"elm\"",
                "s.toml:20: view.flip_p99: given, but view \"a\" is a card, which does not move and is judged by \
                 max_error alone; expected its fields name, kind, leaf, eye_mm, target_mm, up, fov_deg, rotation_deg, \
                 max_error, frame_ms",
            ),
            (
                "\"perspective\"",
                "\"capture\"\nleaf = \"elm\"",
                "s.toml:17: view.eye_mm: given, but view \"a\" is a capture view, which has the camera and the light \
                 of its scan; expected its fields name, kind, leaf, side, pass, frame, max_error",
            ),
            (
                "\"perspective\"",
                "\"panorama\"",
                "s.toml:15: view.kind: unknown variant `panorama`, expected one of `perspective`, `card`, `capture`",
            ),
            ("[[view]]", "[view]", "s.toml:13: view: found table, expected [[view]] tables"),
            ("target_mm = [0, 0, 0]", "target_mm = [0, -10, 100]", "s.toml:17: view.target_mm: is where the eye is"),
            ("tolerance = 0.004", "tolerance = nan", "s.toml:4: tolerance: found NaN"),
            ("schema = 1", "schema = 2", "s.toml:2: schema: found 2, expected 1"),
            ("name = \"s\"", "name = \"s\"\nbloom = 5", "s.toml:4: bloom: found 5, expected 0 to 0.5 of the light"),
            ("fit = \"fits/elm\"", "", "s.toml:5: leaf.fit: missing"),
            (
                "max_error = 0.1",
                "max_error = 0.1\ntime_s = 2",
                "s.toml:21: view.time_s: given, but the scene has no [wind]",
            ),
            (
                "[sun]",
                "[check]\nseconds = 1\n[sun]",
                "s.toml:11: check.seconds: given, but the scene has no [wind], so that nothing moves",
            ),
            (
                "[sun]",
                "[check]\nseconds = 0.05\n[wind]\nspeed_m_s = 3\nseed = 1\n[sun]",
                "s.toml:11: check.seconds: found 0.05 s at 30 frames a second, expected at least three frames",
            ),
            (
                "[sun]",
                "[check]\nwidth = 9\nseconds = 1\n[wind]\nspeed_m_s = 3\nseed = 1\n[sun]",
                "s.toml:11: check.width: found 9, expected at least 16 pixels, for a film's blocks",
            ),
            (
                "[sun]",
                "[wind]\nspeed_m_s = -3\nseed = 1\n[sun]",
                "s.toml:11: wind.speed_m_s: found -3, expected 0 to 100 m/s",
            ),
            (
                "[sun]",
                "[cluster]\nleaves = [\"elm\"]\n[sun]",
                "s.toml:10: cluster: [cluster] is no longer read; expected a [[plant]]",
            ),
            (
                "[sun]",
                "[[plant]]\nfile = \"p.glb\"\nmaterials = { a = \"elm\" }\n[[plant.branch]]\nname = \"b\"\n\
                     taper = 2\n[sun]",
                "s.toml:15: plant.branch.taper: found 2, expected 0.0001 to 1.25 (tip radius over root radius)",
            ),
            (
                "[sun]",
                "[[plant]]\nfile = \"p.glb\"\nmaterials = { a = \"elm\" }\n[[plant.branch]]\nlevel = 1\nfit = \"f\"\n\
                     [sun]",
                "s.toml:13: plant.branch.measured: missing; a level has no name that its fit could hold",
            ),
            (
                "[sun]",
                "[[plant]]\nfile = \"p.glb\"\nmaterials = { a = \"elm\" }\n[[plant.branch]]\nname = \"b\"\ntaper = 1\n\
                 [[plant.branch]]\nname = \"b\"\ntaper = 0.5\n[sun]",
                "s.toml:17: plant.branch.name: \"b\" is given twice for one plant, expected each once",
            ),
        ] {
            assert!(GOOD.contains(from));
            let found = verdict(&GOOD.replacen(from, to, 1));
            assert!(found.starts_with(expected), "{found}\nexpected {expected}");
        }
    }

    const SHAPED: &str = "mesh = \"m.glb\"\n";
    const UNIFORM: &str = "uniform = { rho_d = [[0.1, 0.2, 0.1], [0.1, 0.2, 0.1]], rho_t = [0.1, 0.2, 0.1] }\n";
    const LOOK: &str = "look = { albedo = \"a.png\", transfer = \"srgb\", width_mm = 60, rho_t_factor = 0.5 }\n";
    const LAYERS: &str = "foliar = { absorption = [0.9, 0.5, 1.9] }\n";

    /// Each kind of leaf has its own fields. What another kind has is refused with those, on its line.
    #[test]
    fn a_field_of_another_kind_of_leaf_is_refused_with_the_kinds_own_fields() {
        let own = "expected its fields name, like, uniform, mesh, part, mesh_unit, mesh_up, discs, lobe, index";
        let of_fits = "expected interior of its fields name, like, fit, capture, scan, other_side, mesh, part, \
                       mesh_unit, mesh_up, lobe, index, interior, translucency";
        let even = format!("{UNIFORM}{SHAPED}");
        let layers = format!("{LAYERS}{SHAPED}");
        // What stands in place of the fit, its first wrong line and field, and what is said of it.
        for (of, at, expected) in [
            (format!("{even}fit = \"f\"\n"), "9: leaf.fit", format!("is uniform and has no maps; {own}")),
            (format!("{even}{LAYERS}"), "9: leaf.foliar", format!("is uniform and has no maps; {own}")),
            (format!("{even}interior = \"maps\"\n"), "9: leaf.interior", "is uniform".into()),
            (format!("{even}translucency = {{}}\n"), "9: leaf.translucency", "is uniform".into()),
            (
                format!("{UNIFORM}messh = \"m\"\n"),
                "8: leaf.messh",
                "is uniform and has no maps; expected mesh of".into(),
            ),
            (format!("{LOOK}scan = {{ spec = \"e\" }}\n"), "8: leaf.scan", "is stated by its look".into()),
            (format!("{layers}lobe = \"ggx\"\n"), "9: leaf.lobe", "is stated by its layers".into()),
            (format!("{layers}index = 1.4\n"), "9: leaf.index", "is stated by its layers".into()),
            ("fit = \"f\"\ndiscs = \"d\"\n".into(), "8: leaf.discs", "is drawn by the maps of a fit".into()),
            (
                "fit = \"f\"\ninteror = 1\n".into(),
                "8: leaf.interor",
                format!("is drawn by the maps of a fit; {of_fits}"),
            ),
            (format!("like = \"elm\"\n{SHAPED}fit = \"f\"\n"), "9: leaf.fit", "is like another one".into()),
        ] {
            let found = verdict(&GOOD.replacen("fit = \"fits/elm\"\n", &of, 1));
            let expected = format!("s.toml:{at}: given, but leaf \"elm\" {expected}");
            assert!(found.starts_with(&expected), "{found}\nexpected {expected}");
        }
        for (of, expected) in [
            (UNIFORM.into(), "s.toml:5: leaf.mesh: missing; a uniform leaf needs a mesh, or discs"),
            (format!("{even}discs = \"d.txt\"\n"), "s.toml:9: leaf.discs: given beside a mesh"),
            (format!("{layers}lobe = \"ggz\"\n"), "s.toml:9: leaf.lobe: unknown variant `ggz`"),
            ("fit = 5\n".into(), "s.toml:7: leaf.fit: invalid type: integer `5`, expected path"),
            ("captur = \"c\"\n".into(), "s.toml:7: leaf.captur: no field of leaf \"elm\"; expected capture"),
            ("unifrom = {}\n".into(), "s.toml:7: leaf.unifrom: no field of leaf \"elm\"; expected uniform"),
            ("like = \"oak\"\n".into(), "s.toml:7: leaf.like: found \"oak\", expected one of the scene's leaves (elm)"),
            ("like = \"elm\"\n".into(), "s.toml:7: leaf.like: \"elm\" is like another one itself"),
        ] {
            let found = verdict(&GOOD.replacen("fit = \"fits/elm\"\n", &of, 1));
            assert!(found.starts_with(expected), "{found}\nexpected {expected}");
        }
    }

    /// What a kind does not have may still be given where it says what is so without it.
    #[test]
    fn leaves_and_suns_keep_everything_that_was_stated() {
        let parse = |text: &str| SceneManifest::parse(text, std::path::Path::new("s.toml")).unwrap();
        let plain = "interior = \"scalars\"\n";
        for of in [
            format!("{UNIFORM}{SHAPED}{plain}lobe = \"ggx\"\n"),
            format!("{LOOK}{plain}lobe = \"cook-torrance\"\nindex = 1.5\n"),
            format!("{LAYERS}{SHAPED}{plain}lobe = \"beckmann\"\n"),
        ] {
            let with = GOOD.replacen("fit = \"fits/elm\"\n", &of, 1);
            let without = with.replacen(plain, "", 1).replacen("lobe = \"beckmann\"\n", "", 1);
            assert_eq!(parse(&with), parse(&without), "{of}");
        }
        // A leaf that is like another one has the data of that one, and states how it is drawn itself.
        let twin =
            "[[leaf]]\nname = \"twin\"\nlike = \"elm\"\nlobe = \"ggx\"\ninterior = \"maps\"\ntranslucency = {}\n";
        let both = parse(&GOOD.replacen("[[instance]]", &format!("{twin}[[instance]]"), 1));
        let [elm, like] = &both.leaves[..] else { panic!("{:?}", both.leaves) };
        let fit = super::super::FitOrigin { fit: Some("fits/elm".into()), capture: None, scan: None, other_side: None };
        assert_eq!((elm.fit(), like.fit(), like.data_name()), (Some(&fit), Some(&fit), "elm"));
        assert_ne!((elm.lobe, elm.interior), (like.lobe, like.interior));
        assert!(elm.translucency.is_none() && like.translucency.is_some());
        let layered = format!("{LAYERS}{SHAPED}{twin}");
        let both = parse(&GOOD.replacen("fit = \"fits/elm\"\n", &layered, 1));
        assert!(both.leaves[0].layers().is_some() && both.leaves[0].layers() == both.leaves[1].layers());
        assert_eq!(both.leaves[0].lobe(), both.leaves[1].lobe());
        // The sun's light is stated, or the model's own.
        let sun = parse(GOOD).sun.unwrap();
        let stated = SceneSun {
            zenith_deg: 30.0,
            azimuth_deg: 0.0,
            light: SunLight::Stated([3.0; 3]),
            radius_deg: 0.2666,
            moves: false,
        };
        assert_eq!(sun, stated);
        let sky = "radius_deg = 1\nazimuth_deg = 20\nmoves = true\n[sky]\nmodel = \"preetham\"\nturbidity = 3\n";
        let moving = SceneSun { azimuth_deg: 20.0, light: SunLight::Sky, radius_deg: 1.0, moves: true, ..stated };
        assert_eq!(parse(&GOOD.replacen("irradiance = [3, 3, 3]\n", sky, 1)).sun.unwrap(), moving);
        for (to, expected) in [
            ("", "s.toml:10: sun.irradiance: missing; only a sun under a physical sky"),
            ("iradiance = [3, 3, 3]\n", "s.toml:12: sun.iradiance: no field of a sun; expected irradiance"),
            (
                "irradiance = [3, 3, 3]\nradius = 1\n",
                "s.toml:13: sun.radius: given, which is no field of a sun; expected",
            ),
            ("irradiance = [3, 3]\n", "s.toml:12: sun.irradiance: "),
            ("irradiance = [3, 3, -1]\n", "s.toml:12: sun.irradiance: found"),
        ] {
            let found = verdict(&GOOD.replacen("irradiance = [3, 3, 3]\n", to, 1));
            assert!(found.starts_with(expected), "{found}\nexpected {expected}");
        }
    }
}
