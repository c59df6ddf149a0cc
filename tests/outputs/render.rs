//! `mesophyll render` and `mesophyll eval canopy` as programs: pictures with closed forms, canopies with published
//! answers, and refusals.

use crate::common::skips::no_adapter;
use crate::common::{refused, run, succeeded};
use mesophyll::files::image::{ChannelMaps, Packing, read_exr, write_exr};
use std::f64::consts::PI;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A file of discs as a scene reads it (m): radius, centre, normal.
pub fn discs(dir: &Path, name: &str, list: &[[f64; 7]]) {
    let text: String = list.iter().fold(String::new(), |mut text, d| {
        let _ = writeln!(text, "{}", d.map(|v| v.to_string()).join(" "));
        text
    });
    std::fs::write(dir.join(name), text).unwrap();
}

const LEAF: &str = "\
[[leaf]]
name = \"disc\"
discs = \"one.txt\"
uniform = { rho_d = [[0.3, 0.4, 0.5], [0.2, 0.25, 0.3]], rho_t = [0.35, 0.3, 0.25] }
[[instance]]
leaf = \"disc\"
";

/// A wide level disc that fills the picture, seen from 50 mm above; `light` is the rest of the scene.
fn scene(dir: &Path, leaf: &str, light: &str) -> PathBuf {
    discs(dir, "one.txt", &[[1000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]);
    let path = dir.join("s.toml");
    let text = format!(
        "schema = 1\nname = \"s\"\nbackground = [0.7, 0.6, 0.5]\n{leaf}{light}[[view]]\nname = \"down\"\nkind = \
         \"perspective\"\neye_mm = [3, 4, 50]\ntarget_mm = [3, 4, 0]\nup = [0, 1, 0]\nfov_deg = 40\n[[view]]\nname = \
         \"up\"\nkind = \"perspective\"\neye_mm = [3, 4, 50]\ntarget_mm = [3, 4, 100]\nup = [0, 1, 0]\nfov_deg = \
         20\n[check]\nwidth = 32\nheight = 24\n"
    );
    std::fs::write(&path, text).unwrap();
    path
}

fn arguments<'a>(scene: &'a Path, out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let mut args = vec!["render", scene.to_str().unwrap(), "-o", out.to_str().unwrap()];
    args.extend(more);
    args
}

/// The mean of a channel over all pixels, and its standard error.
fn mean(maps: &ChannelMaps, channel: &str) -> (f64, f64) {
    let values = maps.get(channel).unwrap();
    let errors = maps.get(&format!("error.{channel}")).unwrap();
    let n = values.len() as f64;
    let sum: f64 = values.iter().map(|v| f64::from(*v)).sum();
    let square: f64 = errors.iter().map(|e| f64::from(*e).powi(2)).sum();
    (sum / n, square.sqrt() / n)
}

/// Light from two sides in closed form: the sun on the lit side, and skies that differ above and below.
#[test]
fn a_wide_disc_meets_its_closed_form() {
    let dir = tempfile::tempdir().unwrap();
    let texels = |above: f32, below: f32| {
        let mut map = ChannelMaps::new(256, 128);
        for channel in ["R", "G", "B"] {
            map.push(channel, (0..256 * 128).map(|k| if k < 256 * 64 { above } else { below }).collect());
        }
        write_exr(&dir.path().join("sky.exr"), &map, Packing::Zip).unwrap();
    };
    texels(2.0, 0.5);
    let light = "[sun]\nzenith_deg = 35\nirradiance = [3, 3, 3]\n[sky]\nenvironment = \"sky.exr\"\n";
    let (scene, out) = (scene(dir.path(), LEAF, light), dir.path().join("out"));
    let output = run(arguments(&scene, &out, &["--samples", "64"]));
    succeeded(&output);
    assert!(String::from_utf8_lossy(&output.stdout).contains("down: 64 paths a pixel"));
    let maps = read_exr(&out.join("down.exr")).unwrap();
    for (channel, rho_d, rho_t) in [("R", 0.3, 0.35), ("G", 0.4, 0.3), ("B", 0.5, 0.25)] {
        let want = rho_d * (2.0 + 3.0 * 35f64.to_radians().cos() / PI) + rho_t * 0.5;
        let (found, error) = mean(&maps, channel);
        assert!(error < 2e-3 * want, "{channel}: ± {error} is too coarse");
        // Between the two rows at the horizon the map changes linearly, which adds 7e-5 of its light from above.
        assert!((found - want).abs() < 4.0 * error + 2e-4, "{channel}: {found} ± {error}, expected {want}");
    }
    // A view of the sky sees the map, without noise.
    let sky = read_exr(&out.join("up.exr")).unwrap();
    assert!(sky.get("G").unwrap().iter().all(|v| *v == 2.0) && sky.get("error.G").unwrap().iter().all(|e| *e == 0.0));
    assert!(out.join("down.png").exists() && out.join("render.json").exists());
    // With direct light alone the picture is the same.
    let one = dir.path().join("one");
    succeeded(&run(arguments(&scene, &one, &["--samples", "16", "--bounces", "1", "--view", "down"])));
    let (direct, error) = mean(&read_exr(&one.join("down.exr")).unwrap(), "G");
    assert!((direct - mean(&maps, "G").0).abs() < 4.0 * error + 1e-3);
    assert!(!one.join("up.exr").exists());
}

/// A disc that reflects and transmits all light cannot be distinguished from the sky. The background stands behind it.
#[test]
fn a_white_disc_vanishes_and_the_sun_is_seen() {
    let dir = tempfile::tempdir().unwrap();
    let white = LEAF
        .replace(
            "[[0.3, 0.4, 0.5], [0.2, 0.25, 0.3]]",
            "[[0.333333, 0.333333, 0.333333], [0.333333, 0.333333, 0.333333]]",
        )
        .replace("[0.35, 0.3, 0.25]", "[0.666667, 0.666667, 0.666667]");
    let scene = scene(dir.path(), &white, "[sky]\nradiance = [1.5, 1.5, 1.5]\n");
    let out = dir.path().join("out");
    succeeded(&run(arguments(&scene, &out, &["--samples", "4"])));
    let maps = read_exr(&out.join("down.exr")).unwrap();
    for channel in ["R", "G", "B"] {
        assert!(maps.get(channel).unwrap().iter().all(|v| (v - 1.5).abs() < 1e-5), "{channel}");
    }
    let up = read_exr(&out.join("up.exr")).unwrap();
    assert!(up.get("R").unwrap().iter().all(|v| *v == 0.7));
    // The sun's disk is drawn where a view looks at it, with as much light as its irradiance.
    let scene = self::scene(dir.path(), LEAF, "[sun]\nzenith_deg = 0\nradius_deg = 3\nirradiance = [2, 2, 2]\n");
    let sun = dir.path().join("sun");
    succeeded(&run(arguments(&scene, &sun, &["--samples", "256", "--view", "up"])));
    let seen = read_exr(&sun.join("up.exr")).unwrap();
    let step = 2.0 * 10f64.to_radians().tan() / 24.0;
    let mut light = 0.0;
    for (k, v) in seen.get("R").unwrap().iter().enumerate() {
        let (x, y) = ((k % 32) as f64 - 15.5, (k / 32) as f64 - 11.5);
        let r2 = (x * x + y * y) * step * step;
        // Solid angle of a pixel times the cosine on a surface that faces the sun.
        light += (f64::from(*v) - 0.7) * step * step / (1.0 + r2).powi(2);
    }
    assert!((light - 2.0).abs() < 0.01, "{light}");
}

#[test]
fn an_error_ends_a_picture_and_more_paths_go_on_with_it() {
    let dir = tempfile::tempdir().unwrap();
    let light = "[sun]\nzenith_deg = 35\nirradiance = [3, 3, 3]\n[sky]\nradiance = [1, 1, 1]\n";
    let scene = scene(dir.path(), LEAF, light);
    // A crowd of discs that shade each other.
    let place = |k: u32, q: f64| ((f64::from(k) * q).sin() * 43_758.5).rem_euclid(0.04) - 0.02;
    let crowd: Vec<[f64; 7]> = (1..60)
        .map(|k| [0.006, place(k, 1.3), place(k, 2.7), place(k, 5.9), place(k, 7.1), place(k, 9.7), 0.02])
        .collect();
    discs(dir.path(), "one.txt", &crowd);
    let out = dir.path().join("out");
    let json = |more: &[&str]| -> serde_json::Value {
        let output = run(arguments(&scene, &out, &[&["--view", "down", "--json"], more].concat()));
        succeeded(&output);
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()[0].clone()
    };
    let error = |v: &serde_json::Value| v["median_relative_error"].as_f64().unwrap();
    let by_error = json(&["--error", "0.02"]);
    assert!(error(&by_error) <= 0.02 && by_error["done"] == true);
    let first = read_exr(&out.join("down.exr")).unwrap();
    let paths = by_error["samples"][0].as_u64().unwrap();
    let more = json(&["--samples", &(4 * paths).to_string(), "--resume"]);
    assert_eq!(more["samples"][1].as_u64(), Some(4 * paths));
    assert!(error(&more) < 0.75 * error(&by_error), "{more} {by_error}");
    let second = read_exr(&out.join("down.exr")).unwrap();
    assert!(first.get("R") != second.get("R"));
    // A view that shows only sky has no error to wait for.
    let empty = dir.path().join("empty");
    succeeded(&run(arguments(&scene, &empty, &["--view", "up", "--error", "0.02"])));
    // A picture with another seed is not continued.
    let other = run(arguments(&scene, &out, &["--view", "down", "--samples", "8", "--seed", "9", "--resume"]));
    refused(&other, 2, &["down.progress.exr", "another scene, size, seed or number of bounces"]);
}

#[test]
fn what_cannot_be_drawn_is_refused_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let sky = dir.path().join("sky.exr");
    let light = "[sky]\nenvironment = \"sky.exr\"\n";
    let scene = |leaf: &str, light: &str| self::scene(dir.path(), leaf, light);
    let told = |scene: &Path, words: &[&str]| refused(&run(arguments(scene, &out, &["--samples", "2"])), 2, words);
    let map = |width: usize, height: usize, at: Option<(usize, f32)>, channels: &[&str]| {
        let mut map = ChannelMaps::new(width, height);
        for channel in channels {
            let mut values = vec![1.0; width * height];
            if let Some((k, v)) = at {
                values[k..].fill(v);
            }
            map.push(*channel, values);
        }
        write_exr(&sky, &map, Packing::Raw).unwrap();
    };
    const RGB: [&str; 3] = ["R", "G", "B"];
    let s = scene(LEAF, light);
    told(&s, &["sky.exr", "no such file"]);
    map(64, 64, None, &RGB);
    told(&s, &["sky.exr", "64×64", "twice as many columns as rows"]);
    map(64, 32, None, &RGB[..2]);
    told(&s, &["sky.exr", "B", "no such channel"]);
    map(64, 32, Some((3 * 64 + 5, f32::NAN)), &RGB);
    told(&s, &["sky.exr", "channel R, column 5, row 3: found NaN"]);
    map(64, 32, Some((0, -2.0)), &RGB);
    told(&s, &["sky.exr", "found -2"]);
    map(64, 32, None, &RGB);
    let bytes = std::fs::read(&sky).unwrap();
    std::fs::write(&sky, &bytes[..bytes.len() / 2]).unwrap();
    told(&s, &["sky.exr"]);
    let constant = "[sky]\nradiance = [1, 1, 1]\n";
    told(&scene(&LEAF.replace("0.35, 0.3", "0.75, 0.3"), constant), &["uniform", "rho_d + rho_t of the front, R"]);
    told(&scene(&LEAF.replace("discs = \"one.txt\"\n", ""), constant), &["leaf.mesh: missing"]);
    told(&scene(&LEAF.replace("rho_t =", "m = 0, rho_t ="), constant), &["uniform", "found 0"]);
    discs(dir.path(), "bad.txt", &[[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]);
    told(&scene(&LEAF.replace("one.txt", "bad.txt"), constant), &["bad.txt", "disc 1: radius 0"]);
    let s = scene(LEAF, constant);
    refused(&run(arguments(&s, &out, &["--view", "nowhere"])), 2, &["--view: found \"nowhere\"", "down, up"]);
    let zero = run(arguments(&s, &out, &["--samples", "0"]));
    assert_eq!(zero.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&zero.stderr).contains("'0' for '--samples"));
    // A check needs limits that a picture does not.
    refused(&run(["check", s.to_str().unwrap()]), 2, &["tolerance: missing; a check needs it"]);
    // On a full disk, the finished part of the picture is kept.
    #[cfg(target_os = "linux")]
    {
        std::fs::create_dir_all(&out).unwrap();
        std::os::unix::fs::symlink("/dev/full", out.join("down.exr")).unwrap();
        let full = run(arguments(&s, &out, &["--samples", "4", "--view", "down"]));
        refused(&full, 1, &["down.exr", "the disk is full"]);
        std::fs::remove_file(out.join("down.exr")).unwrap();
        succeeded(&run(arguments(&s, &out, &["--samples", "4", "--view", "down", "--resume"])));
    }
}

/// A level square of half width 1 m as glTF, from positions alone: no normals, no texture coordinates.
fn square(dir: &Path) {
    let corners: [[f32; 3]; 4] = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    std::fs::write(dir.join("square.bin"), &bytes).unwrap();
    let json = serde_json::json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "buffers": [{ "uri": "square.bin", "byteLength": bytes.len() }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 12 }
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-1, -1, 0], "max": [1, 1,
                0] },
            { "bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR" }
        ]
    });
    std::fs::write(dir.join("square.gltf"), json.to_string()).unwrap();
}

/// A mesh with positions only is flat. The path tracer lights it correctly and so do, with its gloss, the real-time
/// renderer and the reference of `check`.
#[test]
fn a_stated_leaf_needs_no_maps() {
    let dir = tempfile::tempdir().unwrap();
    square(dir.path());
    let leaf = LEAF.replace("discs = \"one.txt\"", "mesh = \"square.gltf\"");
    let light = "[sun]\nzenith_deg = 35\nirradiance = [3, 3, 3]\n[sky]\nradiance = [0.5, 0.5, 0.5]\n";
    let scene = scene(dir.path(), &leaf, light);
    let out = dir.path().join("out");
    succeeded(&run(arguments(&scene, &out, &["--samples", "16", "--view", "down"])));
    let maps = read_exr(&out.join("down.exr")).unwrap();
    for (channel, rho_d, rho_t) in [("R", 0.3, 0.35), ("G", 0.4, 0.3), ("B", 0.5, 0.25)] {
        let want = rho_d * (0.5 + 3.0 * 35f64.to_radians().cos() / PI) + rho_t * 0.5;
        let (found, error) = mean(&maps, channel);
        assert!((found - want).abs() < 4.0 * error + 1e-5, "{channel}: {found} ± {error}, expected {want}");
    }
    let text = std::fs::read_to_string(&scene).unwrap();
    let text = text
        .replace("rho_t =", "rho_s = [0.1, 0.1, 0.1], m = 0.3, rho_t =")
        .replace("schema = 1\n", "schema = 1\ntolerance = 0.004\n")
        .replace("fov_deg = 40\n", "fov_deg = 40\nflip_p99 = 0.05\nmax_error = 0.02\n")
        .replace("fov_deg = 20\n", "fov_deg = 20\nflip_p99 = 0.05\nmax_error = 0.02\n");
    std::fs::write(&scene, text).unwrap();
    let checked = run(["check", scene.to_str().unwrap(), "--out", dir.path().join("check").to_str().unwrap()]);
    if !no_adapter(&checked) {
        succeeded(&checked);
    }
}
