//! `mesophyll grow` and `mesophyll import`, as programs.

use crate::common::skips::{Need, skip};
use crate::programs::{python, shown};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
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

/// A file of a plant with 230 leaves, and how high the highest is (m): as nodes stand, and at an animation's first key.
struct Sapling {
    path: PathBuf,
    height: [f64; 2],
}

impl Sapling {
    /// What a reader found in the file is what is in it.
    fn is(&self, found: &Value, height: f64) {
        let top = found["top_m"].as_f64().unwrap();
        assert_eq!(found["leaves"].as_u64(), Some(230), "{}: {found}", self.path.display());
        assert!((top - height).abs() < 1e-4 * height, "{}: {found}, {height} m", self.path.display());
    }
}

/// A sapling as it was grown, posed in a wind, and in motion.
fn saplings(folder: &Path) -> [Sapling; 3] {
    let scene = format!("{}/data/scenes/breeze.toml", env!("CARGO_MANIFEST_DIR"));
    let spec = preset("bird-cherry-sapling");
    let export = |words: &[&str], to: &str| {
        let (code, stderr) = mesophyll(&[words, &["-o", to]].concat(), folder);
        assert_eq!(code, 0, "{stderr}");
        let path = folder.join(to);
        let plant = mesophyll::plants::file::read(&path).unwrap();
        let height = 1e-3 * plant.leaves.iter().map(|leaf| leaf.transform.w_axis.z).fold(0.0, f64::max);
        Sapling { path, height: [height; 2] }
    };
    let posed = |time: &str, to: &str| export(&["export", &scene, "--time", time, "--to", "gltf"], to);
    let first = posed("0", "first.glb").height[0];
    let words = ["export", &scene, "--from", "0", "--until", "0.4", "--step", "0.1", "--to", "gltf"];
    let mut moving = export(&words, "moving.glb");
    assert!((first - moving.height[0]).abs() > 1e-3 * first);
    moving.height[1] = first;
    [export(&["grow", &spec], "grown.glb"), posed("2.5", "posed.glb"), moving]
}

/// three.js loads the files in a browser without an error.
#[test]
fn three_js_reads_plants() {
    let ask = "const p = require('path'), three = require.resolve('three');
        console.log(p.dirname(p.dirname(three)))";
    let found = Command::new("node").args(["-e", ask]).output().ok().filter(|out| out.status.success());
    let Some(found) = found else { return skip(Need::Peer, "no three (npm install three, NODE_PATH)") };
    let three = String::from_utf8(found.stdout).unwrap().trim().to_string();
    let folder = tempfile::tempdir().unwrap();
    for one in saplings(folder.path()) {
        let imports = json!({"imports": {
            "three": format!("file://{three}/build/three.module.js"),
            "gltf-loader": format!("file://{three}/examples/jsm/loaders/GLTFLoader.js"),
        }});
        let page = format!(
            "<!doctype html><html><body><script type=\"importmap\">{imports}</script><script type=\"module\">
            const FILE = \"file://{}\";
            {}</script></body></html>",
            one.path.display(),
            include_str!("three.js")
        );
        let Some(bytes) = shown(folder.path(), &page) else { return };
        let found = String::from_utf8(bytes).unwrap();
        one.is(&serde_json::from_str(&found).unwrap_or_else(|e| panic!("{e}: {found}")), one.height[0]);
    }
}

/// Blender imports the files.
#[test]
fn blender_reads_plants() {
    let folder = tempfile::tempdir().unwrap();
    for one in saplings(folder.path()) {
        let script = format!(
            "import bpy, json, os
out = os.dup(1); os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath='{}')
bpy.context.scene.frame_set(0)
bpy.context.view_layer.update()
made_of = lambda o: o.type == 'MESH' and o.data.materials and o.data.materials[0].name
leaves = [o for o in bpy.data.objects if (made_of(o) or '').startswith('leaf')]
found = {{'leaves': len(leaves), 'top_m': max(o.matrix_world.translation.z for o in leaves)}}
os.write(out, json.dumps(found).encode())",
            one.path.display()
        );
        let Some(found) = python("bpy", &script, folder.path()) else { return };
        one.is(&found, one.height[1]);
    }
}
