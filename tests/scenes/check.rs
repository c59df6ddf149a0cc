//! The check: pictures of generated leaves are compared with the reference, and a picture that must fail fails.
#![cfg(feature = "render")]

use crate::blade::{Blade, copy, edit, rehash, scene, tamper};
use crate::json;
use crate::skips::no_adapter;
use serde_json::Value;
use std::path::Path;
use std::process::Output;

const CARD: &str = r#"
[[view]]
name = "card"
kind = "card"
leaf = "elm"
eye_mm = [20, -40, 90]
target_mm = [0, 0, 0]
fov_deg = 10
max_error = 1e-3
"#;

fn check(path: &Path, args: &[&str]) -> Output {
    let out = path.with_extension("out");
    assert_cmd::Command::cargo_bin("mesophyll")
        .unwrap()
        .arg("check")
        .arg(path)
        .arg("--json")
        .arg("--out")
        .arg(out)
        .args(args)
        .output()
        .unwrap()
}

#[test]
fn a_leaf_lit_from_the_front_matches_its_reference_and_its_closed_form() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let output = check(&scene(dir.path(), "front", "elm", Some(30.0), Some(0.3), CARD), &[]);
    if no_adapter(&output) {
        return;
    }
    let report = json(&output);
    assert_eq!(output.status.code(), Some(0), "{report:#}");
    assert_eq!(report["passed"], true);
    assert!(report["adapter"].as_str().is_some_and(|a| !a.is_empty()));
    for view in report["views"].as_array().unwrap() {
        for key in ["flip_mean", "flip_p99", "max_error", "frame_ms_median", "frame_ms_p95"] {
            assert!(view[key].is_number(), "{key}: {view:#}");
        }
        for key in ["image", "reference", "difference"] {
            assert!(dir.path().join("front.out").join(view[key].as_str().unwrap()).is_file());
        }
    }
    let card = &report["views"][1];
    assert!(card["max_error"].as_f64().unwrap() < 1e-3 && card["noise_max_error"].as_f64().unwrap() < 1e-3, "{card:#}");
    // The pictures show something.
    assert!(report["views"][0]["interior_share"].as_f64().unwrap() > 0.5);
}

#[test]
fn light_through_the_leaf_matches_too() {
    let dir = tempfile::tempdir().unwrap();
    Blade::default().write(&dir.path().join("fits/elm"), "elm");
    let output = check(&scene(dir.path(), "back", "elm", Some(150.0), None, CARD), &[]);
    if !no_adapter(&output) {
        assert_eq!(output.status.code(), Some(0), "{:#}", json(&output));
    }
}

#[test]
fn pigment_maps_and_shadows_match_too() {
    let dir = tempfile::tempdir().unwrap();
    Blade { pigment: 0.3, ..Blade::default() }.write(&dir.path().join("fits/elm"), "elm");
    let above = "[[instance]]\nleaf = \"elm\"\nposition_mm = [14, 9, 25]\nrotation_deg = [20, -15, 40]\nscale = 0.6\n";
    let path = scene(dir.path(), "two", "elm", Some(35.0), Some(0.2), above);
    let text = std::fs::read_to_string(&path)
        .unwrap()
        .replace("fit = \"fits/elm\"", "fit = \"fits/elm\"\ninterior = \"maps\"");
    std::fs::write(&path, text).unwrap();
    let output = check(&path, &[]);
    if no_adapter(&output) {
        return;
    }
    let report = json(&output);
    assert_eq!(output.status.code(), Some(0), "{report:#}");
    let uploads = report["uploads"].to_string();
    assert!(uploads.contains("front rho_d") && !uploads.contains("gamma_delta"), "{uploads}");
    assert!(report["pipelines"].to_string().contains("shadow"), "{}", report["pipelines"]);
}

#[test]
fn goldens_that_must_fail_do_fail_with_and_without_new_hashes() {
    let dir = tempfile::tempdir().unwrap();
    let kept = dir.path().join("kept");
    // Bumps and γ are as strong as veins make them, and the sides differ.
    let blade = Blade { sigma_s: [[11.0, 12.0, 10.0], [16.0, 18.0, 15.0]], bump: 0.25, ..Blade::default() };
    blade.write(&kept, "elm");
    let fit = dir.path().join("fits/elm");
    let fresh = || {
        let _ = std::fs::remove_dir_all(&fit);
        copy(&kept, &fit);
    };
    fresh();
    let front = scene(dir.path(), "front", "elm", Some(50.0), None, "");
    let back = scene(dir.path(), "back", "elm", Some(150.0), None, "");
    for path in [&front, &back] {
        let output = check(path, &["--update-golden"]);
        if no_adapter(&output) {
            return;
        }
        assert_eq!(output.status.code(), Some(0), "{:#}", json(&output));
        let output = check(path, &[]);
        assert_eq!(output.status.code(), Some(0), "untouched: {:#}", json(&output));
        assert_eq!(
            (&json(&output)["views"][0]["golden_flip_mean"], &json(&output)["views"][0]["golden_changed"]),
            (&0.0.into(), &0.0.into())
        );
    }
    let cases = [
        ("mirrored normal", &front),
        ("swapped sides", &front),
        ("thicker", &back),
        ("thicker in fit.toml alone", &back),
        ("sRGB read as linear", &front),
    ];
    for (how, path) in cases {
        for hashed in [false, true] {
            fresh();
            tamper(how, &fit);
            if hashed {
                rehash(&fit);
            }
            // Hashes do not affect the picture. With the old hashes, the golden alone must detect the change.
            let output = check(path, if hashed { &[] } else { &["--goldens-only"] });
            let report = json(&output);
            assert_eq!(
                (output.status.code(), &report["passed"]),
                (Some(1), &Value::Bool(false)),
                "{how}, hashed anew: {hashed}: {report:#}"
            );
            // Without new hashes, the changed files are named. Here `fit.toml` is always written with a hash of its
            // own; tests/scenes/goldens.rs edits its text.
            if !hashed && how != "thicker in fit.toml alone" {
                assert!(report["failures"][0].as_str().unwrap().contains("changed since it was fitted"), "{how}");
            }
            // The picture alone fails, whatever the hashes say. The exception is the mean in `fit.toml`, because the
            // thickness map is drawn and says nothing about it.
            assert!(how == "thicker in fit.toml alone" || report["views"][0]["passed"] == false, "{how}: {report:#}");
        }
    }
}

/// Leaves of two species on a twig shade each other. One of the two fits is tampered with.
#[test]
fn a_cluster_with_one_tampered_fit_fails_too() {
    let dir = tempfile::tempdir().unwrap();
    let kept = dir.path().join("kept");
    let elm = Blade { sigma_s: [[11.0, 12.0, 10.0], [16.0, 18.0, 15.0]], bump: 0.25, ..Blade::default() };
    elm.write(&kept, "elm");
    Blade { sigma_a: [[0.5, 0.7, 2.4], [0.5, 0.7, 2.2]], ..Blade::default() }
        .write(&dir.path().join("fits/oak"), "oak");
    let fit = dir.path().join("fits/elm");
    copy(&kept, &fit);
    let sprig = "schema = 1\nname = \"sprig\"\nseed = 5\nheight_mm = 60\n[crown]\nbase = 0.0\nradius_mm = 60\nprofile \
                 = \
                 [[0, 1.0], [1.0, 1.0]]\n[wood]\ntwig_radius_mm = 1\npipe_exponent = 2\n[[level]]\ncount = 1\nsides = \
                 6\n\
                 rings = 2\n[leaves]\ncount = 3\nangle_deg = 70\ndroop_deg = 25\nspread_deg = 14\nlength_mm = 52\n\
                 width_mm = 30\npetiole_mm = 2\n";
    std::fs::write(dir.path().join("sprig.toml"), sprig).unwrap();
    let plant = |leaf: &str, more: &str| {
        format!(
            "[[plant]]\ngrow = \"sprig.toml\"\nmaterials = {{ leaf = \"{leaf}\", bark = [0.1, 0.1, 0.1] }}\n{more}\n"
        )
    };
    let twig = [
        "[[leaf]]\nname = \"oak\"\nfit = \"fits/oak\"\n".into(),
        plant("elm", "position_mm = [0, 0, -30]"),
        plant("oak", "position_mm = [4, 2, -22]\nrotation_deg = [0, 0, 60]"),
    ]
    .concat();
    let path = scene(dir.path(), "twig", "elm", Some(40.0), Some(0.2), &twig);
    let text = std::fs::read_to_string(&path).unwrap();
    let mut text = text.replace("[[instance]]\nleaf = \"elm\"\n", "");
    // A small picture of a wide scene, with thresholds of three times the reference's own noise there.
    for (from, to) in [
        ("eye_mm = [10, -25, 90]", "eye_mm = [60, -130, 90]"),
        ("target_mm = [0, 0, 2]", "target_mm = [0, 0, -4]"),
        ("fov_deg = 30", "fov_deg = 36"),
        ("flip_p99 = 0.15", "flip_p99 = 0.2"),
        ("width = 160\nheight = 120\nsamples = 32", "width = 112\nheight = 84\nsamples = 16"),
    ] {
        assert!(text.contains(from));
        text = text.replace(from, to);
    }
    std::fs::write(&path, text).unwrap();
    let output = check(&path, &["--update-golden"]);
    if no_adapter(&output) {
        return;
    }
    let untouched = json(&check(&path, &[]));
    assert_eq!(untouched["passed"], true, "untouched: {untouched:#}");
    println!(
        "noise of the reference: {} {}",
        untouched["views"][0]["noise_flip_p99"], untouched["views"][0]["noise_max_error"]
    );
    // The effect of old hashes and of the path-traced reference does not depend on the number of leaves. The test above
    // tests it.
    for how in ["mirrored normal", "swapped sides", "thicker", "sRGB read as linear"] {
        std::fs::remove_dir_all(&fit).unwrap();
        copy(&kept, &fit);
        tamper(how, &fit);
        rehash(&fit);
        let output = check(&path, &["--goldens-only"]);
        let report = json(&output);
        assert_eq!((output.status.code(), &report["passed"]), (Some(1), &Value::Bool(false)), "{how}: {report:#}");
        assert_eq!(report["views"][0]["passed"], false, "{how}: {report:#}");
    }
}

#[test]
fn an_unneeded_map_leaves_the_picture_alone_and_a_needed_one_changes_it() {
    let dir = tempfile::tempdir().unwrap();
    let fit = dir.path().join("fits/elm");
    Blade::default().write(&fit, "elm");
    Blade::default().write(&dir.path().join("fits/spare"), "spare");
    let path =
        scene(dir.path(), "front", "elm", Some(30.0), None, "[[leaf]]\nname = \"spare\"\nfit = \"fits/spare\"\n");
    let picture = || {
        let output = check(&path, &[]);
        (!no_adapter(&output)).then(|| (std::fs::read(dir.path().join("front.out/above.png")).unwrap(), json(&output)))
    };
    let Some((before, report)) = picture() else { return };
    assert_eq!(report["passed"], true, "{report:#}");
    let uploads = report["uploads"].to_string();
    for absent in ["back gamma_delta", "back normal", "back gloss", "back slab curve", "shadow", "albedo", "leaf 1"] {
        assert!(!uploads.contains(absent), "{absent} of {uploads}");
    }
    assert!(
        uploads.contains("front gamma_delta") && uploads.contains("front normal") && uploads.contains("front gloss"),
        "{uploads}"
    );
    assert_eq!(report["pipelines"].as_array().unwrap().len(), 2, "{}", report["pipelines"]);
    for unneeded in ["fits/elm/back.exr", "fits/elm/front_err.exr", "fits/spare/front.exr"] {
        edit(&dir.path().join(unneeded), |_, v| 0.5 * v + 0.1);
    }
    let Some((after, report)) = picture() else { return };
    assert_eq!(report["passed"], true, "{report:#}");
    assert!(before == after, "an unneeded map changed the picture");
    edit(&fit.join("front.exr"), |c, v| if c.starts_with("gamma") { 0.9 * v } else { v });
    let Some((after, report)) = picture() else { return };
    assert_eq!(report["passed"], false);
    assert!(before != after, "a needed map did not change the picture");
}

#[test]
fn what_cannot_be_read_is_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let fit = dir.path().join("fits/elm");
    Blade { width: 24, height: 18, texel_mm: 2.0, ..Blade::default() }.write(&fit, "elm");
    let path = scene(dir.path(), "front", "elm", Some(30.0), None, "");
    let said = |code: i32, part: &str| {
        let output = check(&path, &["--quiet"]);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let ours: Vec<&str> = text.lines().filter(|l| l.starts_with("mesophyll:")).collect();
        assert_eq!(output.status.code(), Some(code), "{text}");
        assert!(ours.len() == 1 && ours[0].contains(part), "{text}");
    };
    let bytes = std::fs::read(fit.join("front.exr")).unwrap();
    std::fs::write(fit.join("front.exr"), &bytes[..bytes.len() / 2]).unwrap();
    said(2, "front.exr");
    std::fs::write(fit.join("front.exr"), &bytes).unwrap();
    std::fs::remove_file(fit.join("blade.glb")).unwrap();
    said(2, "blade.glb: no such file");
    std::fs::write(fit.join("blade.glb"), b"glTF").unwrap();
    said(2, "blade.glb: not a readable glTF file");
    let gltf = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"../../../secret.bin","byteLength":4}]}"#;
    std::fs::write(dir.path().join("leaf.gltf"), gltf).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("fit = \"fits/elm\"", "fit = \"fits/elm\"\nmesh = \"leaf.gltf\"")).unwrap();
    said(2, "leads outside the file's folder");
    std::fs::write(&path, text.replace("fits/elm", "fits/oak")).unwrap();
    said(2, "there is no fit at");
}
