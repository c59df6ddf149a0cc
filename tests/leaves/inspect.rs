//! `mesophyll inspect`, run as a program.

use crate::samples::write_capture;
use mesophyll::files::image::{self, ChannelMaps, Packing};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn mesophyll(args: &[&str], folder: &Path) -> (i32, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(args).current_dir(folder).output().unwrap();
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
}

fn look(folder: &Path, more: &[&str]) -> (i32, Value) {
    let (code, stdout, stderr) = mesophyll(&[&["inspect", "scan", "--json"], more].concat(), folder);
    (code, serde_json::from_str(&stdout).unwrap_or_else(|e| panic!("{e}: {stdout}{stderr}")))
}

fn lines(found: &Value, list: &str) -> String {
    found[list].as_array().unwrap().iter().map(|p| format!("{}\n", p.as_str().unwrap())).collect()
}

#[test]
fn a_whole_capture_passes_and_its_noise_is_seen() {
    let dir = tempfile::tempdir().unwrap();
    write_capture(&dir.path().join("scan"), &["front", "back"], &["x", "y"], 0.02);
    let (code, found) = look(dir.path(), &[]);
    assert_eq!(code, 0, "{}", lines(&found, "problems"));
    assert_eq!(lines(&found, "problems"), "");
    assert_eq!(lines(&found, "warnings"), "");
    let noise = found["noise"]["relative"].as_f64().unwrap();
    assert!((noise - 0.02).abs() < 0.003, "{noise} against the 2 % that were added");
    // The disk has π · 11 · 8 texels, apart from its rim.
    let leaf = found["leaf_texels"].as_f64().unwrap();
    assert!((leaf - std::f64::consts::PI * 88.0).abs() < 15.0, "{leaf}");
    assert_eq!(found["passes"].as_array().unwrap().len(), 4);
    let (code, text, _) = mesophyll(&["inspect", "scan"], dir.path());
    assert!(code == 0 && text.contains("This capture can be fitted.") && text.contains("48 of 48 frames"), "{text}");
}

#[test]
fn a_noise_that_is_stated_wrongly_is_a_warning() {
    let dir = tempfile::tempdir().unwrap();
    let scan = dir.path().join("scan");
    write_capture(&scan, &["front"], &["x"], 0.02);
    let toml = std::fs::read_to_string(scan.join("capture.toml")).unwrap();
    std::fs::write(scan.join("capture.toml"), toml.replace("noise_relative = 0.02", "noise_relative = 0.002")).unwrap();
    let (code, found) = look(dir.path(), &[]);
    assert!(code == 0 && lines(&found, "warnings").contains("times the stated"), "{}", lines(&found, "warnings"));
}

#[test]
fn what_follows_from_absence_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let scan = dir.path().join("scan");
    write_capture(&scan, &["front"], &["x"], 0.01);
    std::fs::remove_dir_all(scan.join("white")).unwrap();
    let (code, found) = look(dir.path(), &[]);
    assert_eq!(code, 0, "{}", lines(&found, "problems"));
    let notes = lines(&found, "notes");
    for said in [
        "pass \"y\" is absent",
        "the back is absent",
        "white/ is absent",
        "dark.exr is absent",
        "mask.exr is absent",
        "along the normal",
    ] {
        assert!(notes.contains(said), "{said} is not in\n{notes}");
    }
}

#[test]
fn every_problem_is_listed_not_only_the_first() {
    let dir = tempfile::tempdir().unwrap();
    let scan = dir.path().join("scan");
    write_capture(&scan, &["front", "back"], &["x", "y"], 0.01);
    for k in [3, 7, 8] {
        std::fs::remove_file(scan.join(format!("front/x/{k:04}.exr"))).unwrap();
    }
    let cut = scan.join("front/x/0020.exr");
    let bytes = std::fs::read(&cut).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).unwrap();
    let mut small = ChannelMaps::new(10, 18);
    ["R", "G", "B"].iter().for_each(|c| small.push(*c, vec![0.1; 180]));
    image::write_exr(&scan.join("front/y/0001.exr"), &small, Packing::Raw).unwrap();
    let mut grey = ChannelMaps::new(24, 18);
    grey.push("Y", vec![0.1; 432]);
    image::write_exr(&scan.join("front/y/0002.exr"), &grey, Packing::Raw).unwrap();
    std::fs::write(scan.join("front/y/0003.exr"), b"this is no picture").unwrap();
    for k in 0..48 {
        let mut blind = ChannelMaps::new(24, 18);
        ["R", "G", "B"].iter().for_each(|c| blind.push(*c, vec![f32::NAN; 432]));
        image::write_exr(&scan.join(format!("back/x/{k:04}.exr")), &blind, Packing::Raw).unwrap();
        let mut full = ChannelMaps::new(24, 18);
        ["R", "G", "B"].iter().for_each(|c| full.push(*c, vec![1.0; 432]));
        image::write_exr(&scan.join(format!("back/y/{k:04}.exr")), &full, Packing::Raw).unwrap();
    }
    std::fs::remove_file(scan.join("back/lightbox.exr")).unwrap();
    std::fs::remove_file(scan.join("white/x/0005.exr")).unwrap();
    let (code, found) = look(dir.path(), &[]);
    assert_eq!(code, 2);
    let problems = lines(&found, "problems");
    for said in [
        "front/x: 3 of 48 frames are missing: 0003, 0007–0008",
        "front/x/0020.exr",
        "front/y/0001.exr: size: found 10 × 18, expected 24 × 18",
        "front/y/0002.exr: R: no such channel; the file holds Y",
        "front/y/0003.exr",
        "back/x: no reading anywhere",
        "back/y: every sample looked at is 1 (saturated everywhere?)",
        "back/lightbox.exr: missing",
        "white/x: 1 of 48 frames are missing: 0005",
    ] {
        assert!(problems.contains(said), "{said} is not in\n{problems}");
    }
    let (code, _, stderr) = mesophyll(&["inspect", "scan", "--quiet"], dir.path());
    let count = found["problems"].as_array().unwrap().len();
    assert!(code == 2 && stderr.contains(&format!("it has {count} problems")), "{stderr}");
}

#[test]
fn only_a_deep_look_reads_every_sample() {
    let dir = tempfile::tempdir().unwrap();
    let scan = dir.path().join("scan");
    write_capture(&scan, &["front"], &["x"], 0.01);
    // No window of the quick look includes frame 40. Its first block becomes unreadable, and its last row stays intact.
    let path = scan.join("front/x/0040.exr");
    // (The samples are smooth, because noise is stored uncompressed, and no reader can detect a change there.)
    let mut smooth = ChannelMaps::new(24, 18);
    ["R", "G", "B"].iter().for_each(|c| smooth.push(*c, (0..432).map(|i| (i / 24) as f32 * 0.01).collect()));
    image::write_exr(&path, &smooth, Packing::Zip).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let header = bytes
        .windows(2)
        .rposition(|w| w == [0x78, 0x5e] || w == [0x78, 0x9c] || w == [0x78, 0x01] || w == [0x78, 0xda]);
    let first = bytes.windows(2).position(|w| w == &bytes[header.unwrap()..header.unwrap() + 2]).unwrap();
    bytes[first + 4..first + 20].iter_mut().for_each(|b| *b ^= 0xa5);
    std::fs::write(&path, bytes).unwrap();
    let (code, found) = look(dir.path(), &[]);
    assert_eq!(code, 0, "{}", lines(&found, "problems"));
    let (code, found) = look(dir.path(), &["--deep"]);
    assert_eq!(code, 2);
    assert!(lines(&found, "problems").contains("0040.exr"), "{}", lines(&found, "problems"));
}

#[test]
fn clipped_frames_are_a_warning() {
    let dir = tempfile::tempdir().unwrap();
    let scan = dir.path().join("scan");
    write_capture(&scan, &["front"], &["x"], 0.01);
    for k in 0..48 {
        let path = scan.join(format!("front/x/{k:04}.exr"));
        let mut maps = image::read_exr(&path).unwrap();
        maps.channels.iter_mut().for_each(|(_, s)| s.iter_mut().for_each(|v| *v = v.min(0.05)));
        image::write_exr(&path, &maps, Packing::Zip).unwrap();
    }
    let (code, found) = look(dir.path(), &[]);
    assert!(code == 0 && lines(&found, "warnings").contains("clipped?"), "{}", lines(&found, "warnings"));
}

#[test]
fn a_manifest_that_cannot_be_read_is_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let scan = dir.path().join("scan");
    write_capture(&scan, &["front"], &["x"], 0.01);
    let toml = std::fs::read_to_string(scan.join("capture.toml")).unwrap();
    for (change, to, said) in [
        ("thickness_mm = 0.2", "thickness_mm = -0.2", "thickness_mm: found -0.2"),
        ("radius_mm = 2.5", "radius_mm = 2.5\ncolour = 3", "unknown field `colour`"),
        ("frames = 48", "frames = 3", "8 to 10000 frames"),
        ("frames = 48", "frames = 4000000000000000", "8 to 10000 frames"),
        ("schema = 1", "schema = 2", "schema: found 2"),
    ] {
        std::fs::write(scan.join("capture.toml"), toml.replace(change, to)).unwrap();
        let (code, found) = look(dir.path(), &[]);
        let problems = lines(&found, "problems");
        assert!(code == 2 && problems.contains(said) && problems.contains("capture.toml"), "{said}: {problems}");
    }
    let (code, _, stderr) = mesophyll(&["inspect", "nowhere"], dir.path());
    assert!(code == 2 && stderr.lines().count() == 1, "{stderr}");
}
