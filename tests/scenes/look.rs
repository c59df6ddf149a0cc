//! A leaf from one picture: planned, checked, drawn by both renderers and exported, and nowhere called fitted. The
//! picture has one colour, so that its radiance has a closed form.

use crate::common::{refused, run, succeeded};
use crate::skips::no_adapter;
use serde_json::Value;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

const CODES: [u8; 3] = [100, 150, 60];
const IRRADIANCE: f64 = 3.0;
const FACTOR: f64 = 0.7;

/// The light of a number of 8 bits by IEC 61966-2-1.
fn light(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// A scene with an elliptic leaf under a vertical sun, seen from above and from below.
fn scene(folder: &Path) -> PathBuf {
    let inside = |x: u32, y: u32| ((f64::from(x) - 59.5) / 56.0).hypot((f64::from(y) - 29.5) / 26.0) < 1.0;
    let [r, g, b] = CODES;
    let pixel = |x, y| image::Rgba([r, g, b, if inside(x, y) { 255 } else { 0 }]);
    image::RgbaImage::from_fn(120, 60, pixel).save(folder.join("leaf.png")).unwrap();
    let view = |name: &str, z: i32| {
        format!(
            "[[view]]\nname = \"{name}\"\nkind = \"perspective\"\neye_mm = [0, -0.5, {z}]\ntarget_mm = [0, 0, \
             0]\nfov_deg = 30\nflip_p99 = 0.15\nmax_error = 0.012\n"
        )
    };
    let text = format!(
        "schema = 1\nname = \"look\"\ntolerance = 0.004\n[[leaf]]\nname = \"picture\"\nlook = {{ albedo = \
         \"leaf.png\", transfer = \"srgb\", rho_t_factor = {FACTOR}, width_mm = 60 }}\n[[instance]]\nleaf = \
         \"picture\"\n[sun]\nzenith_deg = 0\nirradiance = [3, 3, 3]\n{}{}[check]\nwidth = 96\nheight = 72\nsamples = \
         16\nframes = 2\n",
        view("above", 100),
        view("below", -100)
    );
    let path = folder.join("look.toml");
    std::fs::write(&path, text).unwrap();
    path
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The radiance of a view by the closed form: ρd E/π from above, ρt E/π from below.
fn radiance(view: &str) -> [f64; 3] {
    let factor = if view == "above" { 1.0 } else { FACTOR };
    CODES.map(|code| factor * light(code) * IRRADIANCE / PI)
}

/// What an earlier folder has is not made again, and what belongs to another picture there is left alone.
#[test]
fn pictures_are_drawn_from_what_an_earlier_run_made() {
    let dir = tempfile::tempdir().unwrap();
    let path = scene(dir.path());
    let [first, second, third] = ["first", "second", "third"].map(|name| dir.path().join(name));
    let draw = |out: &Path, more: &[&str]| {
        run([&["render", text(&path), "-o", text(out), "--samples", "4", "--view", "above"], more].concat())
    };
    succeeded(&draw(&first, &[]));
    let record = first.join("fits/picture/fit.toml");
    let before = std::fs::read(&record).unwrap();
    succeeded(&draw(&second, &["--run", text(&first)]));
    // In another size from the same fit; the leaf fills the middle of both.
    let small = dir.path().join("small");
    succeeded(&draw(&small, &["--run", text(&first), "--size", "40x30"]));
    let maps = mesophyll::files::image::read_exr(&small.join("above.exr")).unwrap();
    assert_eq!((maps.width, maps.height, small.join("fits").exists()), (40, 30, false));
    assert!(!second.join("fits").exists());
    assert_eq!(std::fs::read(first.join("above.png")).unwrap(), std::fs::read(second.join("above.png")).unwrap());
    image::RgbaImage::from_pixel(120, 60, image::Rgba([50, 60, 70, 255])).save(dir.path().join("leaf.png")).unwrap();
    refused(&draw(&third, &["--run", text(&first)]), 2, &["--run", "first", "changed"]);
    refused(&draw(&third, &["--run", text(&dir.path().join("none"))]), 2, &["--run", "none", "earlier run"]);
    assert_eq!(std::fs::read(&record).unwrap(), before);
    assert!(!third.join("above.png").exists());
}

#[test]
fn a_leaf_from_one_picture_is_drawn_by_both_renderers_and_called_stated() {
    let dir = tempfile::tempdir().unwrap();
    let path = scene(dir.path());
    let out = dir.path().join("out");
    let plan = run(["plan", text(&path)]);
    succeeded(&plan);
    let said = String::from_utf8(plan.stdout).unwrap();
    assert!(said.contains("stated look picture: stated, not fitted") && !said.contains("fit picture"), "{said}");
    // The path tracer.
    let pictures = dir.path().join("traced");
    succeeded(&run(["render", text(&path), "-o", text(&pictures), "--samples", "4"]));
    for view in ["above", "below"] {
        let maps = mesophyll::files::image::read_exr(&pictures.join(format!("{view}.exr"))).unwrap();
        let middle = maps.height / 2 * maps.width + maps.width / 2;
        for (name, want) in ["R", "G", "B"].into_iter().zip(radiance(view)) {
            let found = f64::from(maps.get(name).unwrap()[middle]);
            assert!((found / want - 1.0).abs() < 2e-3, "{view} {name}: {found} {want}");
        }
    }
    // The real-time renderer, and the comparison of both.
    let check = run(["check", text(&path), "--out", text(&out), "--json"]);
    let drawn = !no_adapter(&check);
    if drawn {
        let report = crate::json(&check);
        assert!(check.status.success(), "{report:#}");
        let stated = report["stated"][0].as_str().unwrap_or_default();
        assert!(stated.contains("picture: stated, not fitted") && stated.contains("0.7 times"), "{report:#}");
        for view in ["above", "below"] {
            let picture = image::open(out.join(format!("{view}.png"))).unwrap().into_rgb8();
            for (found, x) in picture.get_pixel(48, 36).0.into_iter().zip(radiance(view)) {
                let shown = x / (1.0 + x);
                let want = 255.0 * (1.055 * shown.powf(1.0 / 2.4) - 0.055);
                assert!((f64::from(found) - want).abs() <= 1.5, "{view}: {found} {want}");
            }
        }
        // The plan of a scene whose maps are made names every value.
        let said = String::from_utf8(run(["plan", text(&path), "--out", text(&out)]).stdout).unwrap();
        assert!(said.contains("picture: stated, not fitted: thickness: 0.2 mm"), "{said}");
        let report = dir.path().join("report.html");
        succeeded(&run(["report", text(&out.join("fits/picture")), "-o", text(&report)]));
        let said = std::fs::read_to_string(report).unwrap();
        assert!(said.contains("stated look") && said.contains("nothing of it was measured"), "{said}");
        assert!(!said.contains("leaf fit") && !said.contains("look fit"), "{said}");
        // Another picture makes other maps.
        let [r, g, b] = CODES;
        let [w, h] = [120, 60];
        image::RgbaImage::from_fn(w, h, |x, _| image::Rgba([r / 2, g, b, if x > 20 && x < 90 { 255 } else { 0 }]))
            .save(dir.path().join("leaf.png"))
            .unwrap();
        let said = String::from_utf8(run(["plan", text(&path), "--out", text(&out)]).stdout).unwrap();
        assert!(said.contains("its pictures, or what is stated beside them, changed"), "{said}");
    }
    // Nothing is drawn where something is stated twice, or has no scale.
    let good = std::fs::read_to_string(scene(dir.path())).unwrap();
    for (from, to, words) in [
        (", width_mm = 60", "", "look.toml:6: leaf.look: width_mm: missing; a picture has no scale"),
        ("look = {", "fit = \"f\"\nlook = {", "is stated by its look; expected its fields name, like, look, mesh"),
        ("look = {", "translucency = {}\nlook = {", "leaf.translucency: given, but leaf"),
    ] {
        std::fs::write(&path, good.replacen(from, to, 1)).unwrap();
        refused(&run(["plan", text(&path)]), 2, &[words]);
    }
}

#[test]
fn a_look_of_its_own_file_is_imported_exported_and_put_on_a_plant() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    scene(dir.path());
    let stated = "albedo = \"leaf.png\"\ntransfer = \"srgb\"\nrho_t_factor = 0.7\nwidth_mm = 60\nrho_s = [0.03, 0.03, \
                  0.03]\n";
    std::fs::write(at("picture.toml"), stated).unwrap();
    let leaf = at("leaf");
    let made = run(["import", text(&at("picture.toml")), "-o", text(&leaf), "--json"]);
    succeeded(&made);
    let told = crate::json(&made);
    assert_eq!(told["kind"], "look");
    assert!(told["stated"].to_string().contains("slope m 0.2 (nobody stated it"), "{told:#}");
    // Every export says that nothing was measured, also in its record.
    for (format, name) in [("mitsuba", "mitsuba"), ("gltf-translucent", "leaf.glb"), ("obj", "leaf.obj")] {
        let to = at(name);
        let exported = run(["export", text(&leaf), "--to", format, "-o", text(&to), "--json"]);
        succeeded(&exported);
        let loss = &crate::json(&exported)["loss"];
        assert!(loss["left_out"].to_string().contains("picture: stated, not fitted"), "{format}: {loss:#}");
        // The material keeps the stated colours.
        if format == "mitsuba" {
            let albedo: Vec<f64> =
                serde_json::from_value(loss["surfaces"][0]["front"]["albedo"]["transmitted"].clone()).unwrap();
            for (found, code) in albedo.into_iter().zip(CODES) {
                assert!((found - FACTOR * light(code)).abs() < 1e-3, "{found} {}", FACTOR * light(code));
            }
        }
    }
    refused(&run(["export", text(&leaf), "--to", "sigma", "-o", text(&at("sigma"))]), 2, &["stated, not fitted"]);
    refused(&run(["fit", "translucency", text(&leaf), "-o", text(&at("tr"))]), 2, &["kind", "stated, not fitted"]);
    let plant = at("dressed.glb");
    let material = format!("elm={}", text(&leaf));
    let dressed = run(["dress", "data/plants/dense-twig.glb", "--leaf", &material, "--make-uv", "-o", text(&plant)]);
    succeeded(&dressed);
    let loss: Value = serde_json::from_slice(&std::fs::read(at("dressed.glb.loss.json")).unwrap()).unwrap();
    assert!(loss["left_out"].to_string().contains("stated, not fitted"), "{loss:#}");
    // A whole scene finds the folder by its name, or makes the maps of its own look.
    let text_of = std::fs::read_to_string(at("look.toml")).unwrap();
    let start = text_of.find("look = {").unwrap();
    let end = start + text_of[start..].find('\n').unwrap();
    std::fs::write(at("named.toml"), format!("{}fit = \"leaf\"{}", &text_of[..start], &text_of[end..])).unwrap();
    for (scene, run_folder) in [("named.toml", "run-1"), ("look.toml", "run-2")] {
        let (scene, to, with) = (at(scene), at(&format!("{run_folder}-pbrt")), at(run_folder));
        let words = ["export", text(&scene), "--to", "pbrt", "-o", text(&to), "--run", text(&with), "--json"];
        let exported = run(words);
        succeeded(&exported);
        assert!(crate::json(&exported)["loss"].to_string().contains("stated, not fitted"), "{}", scene.display());
    }
    // A card compares a leaf with its tissue.
    let card = "[[view]]\nname = \"card\"\nkind = \"card\"\nleaf = \"picture\"\neye_mm = [20, -50, 120]\n";
    let card = format!("{card}target_mm = [0, 0, 0]\nfov_deg = 2\nmax_error = 1e-3\n");
    for scene in ["named.toml", "look.toml"] {
        let with = std::fs::read_to_string(at(scene)).unwrap() + &card;
        std::fs::write(at("card.toml"), with).unwrap();
        refused(&run(["plan", text(&at("card.toml"))]), 2, &["card.toml", "picture", "expected a fitted leaf"]);
    }
    assert!(!at("run-1").exists() && at("run-2/fits/picture/fit.toml").is_file());
}
