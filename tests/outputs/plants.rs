//! `mesophyll grow` and `mesophyll import`, as programs.

use crate::common::skips::{Need, skip};
use std::path::Path;
use std::process::Command;

fn mesophyll(args: &[&str], folder: &Path) -> (i32, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(args).current_dir(folder).output().unwrap();
    (out.status.code().unwrap_or(-1), String::from_utf8_lossy(&out.stderr).into_owned())
}

fn preset(name: &str) -> String {
    format!("{}/data/plants/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn the_same_seed_is_the_same_file_and_its_branches_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let grow = |args: &[&str]| {
        let spec = preset("bird-cherry-sapling");
        let (code, stderr) = mesophyll(&[&["grow", &spec], args].concat(), folder.path());
        assert_eq!(code, 0, "{stderr}");
    };
    grow(&["-o", "a.glb"]);
    grow(&["-o", "b.glb", "--seed", "2"]);
    grow(&["-o", "c.glb", "--seed", "3"]);
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("a.glb") == bytes("b.glb") && bytes("a.glb") != bytes("c.glb"));
    let (code, stderr) = mesophyll(&["import", "a.glb", "-o", "found"], folder.path());
    assert_eq!(code, 0, "{stderr}");
    let table = std::fs::read_to_string(folder.path().join("found/branches.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    let header = "branch,parent,at,level,length_mm,root_radius_mm,tip_radius_mm,x,y,z,dx,dy,dz,confidence,status";
    assert_eq!((lines[0], lines.len()), (header, 42));
    assert!(lines[1..].iter().all(|l| l.ends_with(",ok")));
    // Places are in the file's own frame (y up, mm). The trunk begins at the origin.
    let trunk: Vec<&str> = lines[1].split(',').collect();
    let number = |k: usize| trunk[k].parse::<f64>().unwrap();
    assert!(number(11) > 0.98 && number(4) > 1100.0 && (7..10).all(|k| number(k).abs() < 1e-3), "{trunk:?}");
}

#[test]
fn bad_plants_write_nothing() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("no.glb"), b"glTF").unwrap();
    std::fs::write(folder.path().join("no.toml"), b"schema = 1\n").unwrap();
    for (args, expected) in [
        (&["import", "no.glb", "-o", "out"][..], "not a readable glTF file"),
        (&["import", "gone.glb", "-o", "out"], "no such file"),
        (&["grow", "no.toml", "-o", "out"], "missing field"),
    ] {
        let (code, stderr) = mesophyll(args, folder.path());
        assert!(code == 2 && stderr.contains(expected) && stderr.lines().count() == 1, "{code} {stderr}");
        assert!(!folder.path().join("out").exists());
    }
}

/// Errors and warnings of Khronos' validator in a file; a skip where it is not installed.
pub fn validated(file: &Path) -> Option<String> {
    let script = "const v = require('gltf-validator'), fs = require('fs');
        v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))
            .then(r => console.log(r.issues.numErrors, r.issues.numWarnings));";
    let node = |script: &str, file: &Path| Command::new("node").args(["-e", script]).arg(file).output();
    if !node("require('gltf-validator')", Path::new("")).is_ok_and(|out| out.status.success()) {
        skip(Need::Peer, "no gltf-validator (npm install gltf-validator, NODE_PATH)");
        return None;
    }
    Some(String::from_utf8_lossy(&node(script, file).unwrap().stdout).trim().to_string())
}

/// Khronos' validator finds no errors and no warnings.
#[test]
fn the_validator_has_nothing_to_say() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["elm-twig", "bird-cherry-sapling", "wych-elm"] {
        let path = folder.path().join("plant.glb");
        let (code, stderr) = mesophyll(&["grow", &preset(name), "-o", "plant.glb"], folder.path());
        assert_eq!(code, 0, "{stderr}");
        let Some(said) = validated(&path) else { return };
        assert_eq!(said, "0 0", "{name}");
    }
}
