//! Pictures that are made to be looked at: the real-time renderer shows what the path tracer shows, with the film's
//! curve, the camera's exposure, the bands of a leaf as colours, and the ground's grain.

use crate::common::{refused, run, succeeded};
use crate::skips;
use std::path::{Path, PathBuf};

/// Two matte leaves over a ground in the colour of leaves, under a physical sky. They do not light each other, and the
/// path tracer follows direct light alone.
fn scene(folder: &Path, name: &str, more: &str, ground: &str) -> PathBuf {
    std::fs::copy("fits/elm/blade.glb", folder.join("leaf.glb")).unwrap();
    let path = folder.join(format!("{name}.toml"));
    let text = format!(
        "schema = 1\nname = \"{name}\"\nexposure = 0.2\n{more}\n[[leaf]]\nname = \"leaf\"\nmesh = \"leaf.glb\"\n\
         uniform = {{ rho_d = [[0.06, 0.14, 0.04], [0.08, 0.16, 0.06]], rho_t = [0.05, 0.12, 0.02] }}\n\
         [[instance]]\nleaf = \"leaf\"\nposition_mm = [0, 0, 60]\n[[instance]]\nleaf = \"leaf\"\n\
         position_mm = [70, 40, 90]\nrotation_deg = [30, 20, 50]\n\
         [ground]\nalbedo = [0.06, 0.14, 0.04]\nreach_mm = 4000\n{ground}\n[sun]\nzenith_deg = 40\nazimuth_deg = 150\n\
         [sky]\nmodel = \"preetham\"\nturbidity = 3\n[[view]]\nname = \"side\"\nkind = \"perspective\"\n\
         eye_mm = [0, -420, 160]\ntarget_mm = [20, 0, 80]\nfov_deg = 34\n[check]\nwidth = 168\nheight = 112\n"
    );
    std::fs::write(&path, text).unwrap();
    path
}

const CAMERA: &str = "[camera]\nf_number = 6.7\nshutter_s = 0.008";
const GRAIN: &str = "grain_mm = 14\ncontrast = 0.6";

/// The FLIP of the real-time picture of a scene from the pictures in a folder, mean and 99 %; `None` without an
/// adapter.
fn flip(scene: &Path, out: &Path, against: &Path) -> Option<[f64; 2]> {
    let words = [scene, Path::new("-o"), out, Path::new("--real-time"), Path::new("--against"), against];
    let words = words.map(|w| w.to_str().unwrap());
    let output = run([&["render", "--json"], &words[..]].concat());
    if skips::no_adapter(&output) {
        return None;
    }
    succeeded(&output);
    let views: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(views[0]["size"], serde_json::json!([168, 112]));
    assert!(out.join("side.exr").is_file() && out.join("side.png").is_file());
    Some([0, 1].map(|k| views[0]["flip"][k].as_f64().unwrap()))
}

/// With everything the two pictures are alike. Where the real-time renderer leaves out one of curve, colours and grain,
/// they are farther apart.
#[test]
fn real_time_pictures_are_shown_as_traced_ones() {
    let dir = tempfile::tempdir().unwrap();
    let bands = "channels = \"bands\"";
    let whole = scene(dir.path(), "whole", bands, &format!("{GRAIN}\n{CAMERA}"));
    let traced = dir.path().join("traced");
    let words = ["render", whole.to_str().unwrap(), "-o", traced.to_str().unwrap(), "--samples", "256"];
    succeeded(&run([&words[..], &["--bounces", "1"]].concat()));
    let Some([mean, p99]) = flip(&whole, &dir.path().join("whole-drawn"), &traced) else { return };
    println!("whole: {mean} {p99}");
    assert!(mean < 0.07, "{mean} {p99}");
    for (name, more, ground) in [
        ("reinhard", bands, GRAIN.to_string()),
        ("srgb", "", format!("{GRAIN}\n{CAMERA}")),
        ("even", bands, CAMERA.to_string()),
    ] {
        let other = scene(dir.path(), name, more, &ground);
        let [other, _] = flip(&other, &dir.path().join(format!("{name}-drawn")), &traced).unwrap();
        println!("{name}: {other}");
        assert!(other > 1.2 * mean, "{name}: {other} {mean}");
    }
}

/// Light between leaves falls on the ground's grain. The path tracer follows all scatterings here; without the grain
/// the picture is farther from its own.
#[test]
fn light_between_leaves_falls_on_the_grain() {
    let dir = tempfile::tempdir().unwrap();
    let between = "[transfer]\npaths = 128";
    let whole = scene(dir.path(), "grained", "", &format!("{GRAIN}\n{CAMERA}\n{between}"));
    let traced = dir.path().join("traced");
    succeeded(&run(["render", whole.to_str().unwrap(), "-o", traced.to_str().unwrap(), "--samples", "128"]));
    let Some([mean, p99]) = flip(&whole, &dir.path().join("grained-drawn"), &traced) else { return };
    let even = scene(dir.path(), "even", "", &format!("{CAMERA}\n{between}"));
    let [other, _] = flip(&even, &dir.path().join("even-drawn"), &traced).unwrap();
    println!("grained: {mean} {p99}, even: {other}");
    assert!(mean < 0.07 && other > 1.2 * mean, "{mean} {p99}, even: {other}");
}

#[test]
fn what_does_not_go_together_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = scene(dir.path(), "wrong", "channels = \"rgb\"", "");
    let out = dir.path().join("out");
    let words = ["render", path.to_str().unwrap(), "-o", out.to_str().unwrap()];
    refused(&run(words), 2, &["wrong.toml", "channels", "rgb", "bands"]);
    // Options that exclude or need each other are refused with the usage beside the sentence.
    for (more, named) in [(&["--real-time", "--samples", "4"][..], "--samples"), (&["--against", "."], "--real-time")] {
        let output = run([&words[..], more].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && said.contains(more[0]) && said.contains(named), "{said}");
    }
    assert!(!out.exists());
}
