//! `mesophyll dress` on cards: what the outline keeps, coordinates beyond the picture, colours of vertices, cards of
//! whole twigs, and files without materials.

use crate::export::with_blade;
use crate::plants::validated;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// A plant of one mesh called `leaves`: squares of `side` metres in a row, whose texture coordinates are moved by
/// `shift`. `more` is added to the primitive, and `material` is the only one.
fn squares(file: &Path, count: u32, side: f32, shift: f32, colours: bool, material: Option<Value>) {
    let corners = [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let (mut bin, mut views) = (Vec::<u8>::new(), Vec::new());
    let mut add = |floats: Vec<f32>| {
        views.push(json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": 4 * floats.len()}));
        bin.extend(floats.iter().flat_map(|v| v.to_le_bytes()));
    };
    let all = || (0..count).flat_map(|k| corners.map(|[x, y]| (k as f32, x, y)));
    add(all().flat_map(|(k, x, y)| [(2.0 * k + x) * side, y * side, 0.0]).collect());
    add(all().flat_map(|(_, x, y)| [x + shift, 1.0 - y + shift]).collect());
    add(all().flat_map(|_| [0.5, 0.5, 0.5, 1.0]).collect());
    let indices = (0..count).flat_map(|k| [0, 1, 2, 0, 2, 3].map(|i: u32| 4 * k + i));
    views.push(json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": 24 * count}));
    bin.extend(indices.flat_map(|i| i.to_le_bytes()));
    let n = 4 * count;
    let high = [(2.0 * (count - 1) as f32 + 1.0) * side, side, 0.0];
    let mut primitive = json!({"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 3});
    if colours {
        primitive["attributes"]["COLOR_0"] = json!(2);
    }
    let mut root = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"name": "leaves", "primitives": [primitive]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": n, "type": "VEC3", "min": [0, 0, 0], "max": high},
            {"bufferView": 1, "componentType": 5126, "count": n, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5126, "count": n, "type": "VEC4"},
            {"bufferView": 3, "componentType": 5125, "count": 6 * count, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"uri": "data.bin", "byteLength": bin.len()}],
    });
    if let Some(material) = material {
        root["materials"] = json!([material]);
        root["meshes"][0]["primitives"][0]["material"] = json!(0);
    }
    std::fs::write(file, serde_json::to_vec(&root).unwrap()).unwrap();
    std::fs::write(file.with_file_name("data.bin"), bin).unwrap();
}

/// Dresses `plant.gltf`; the answer as JSON, and the file.
fn dressed(folder: &Path, name: &str, options: &[&str]) -> (Value, Value) {
    let leaf = format!("{name}=elm");
    let words = [&["dress", "plant.gltf", "--leaf", &leaf, "-o", "out.glb", "--json"][..], options].concat();
    let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(words).current_dir(folder).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let bytes = std::fs::read(folder.join("out.glb")).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    if let Some(said) = validated(&folder.join("out.glb")) {
        assert!(said.starts_with("0 "), "{said}");
    }
    (serde_json::from_slice(&out.stdout).unwrap(), serde_json::from_slice(&bytes[20..20 + length]).unwrap())
}

/// A rectangle says nothing of a leaf's outline, so that the fit's is cut out of it although its material was opaque.
#[test]
fn an_opaque_rectangle_gets_the_outline() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    squares(&dir.path().join("plant.gltf"), 3, 0.03, 0.0, false, Some(json!({"name": "Leaf"})));
    let (said, root) = dressed(dir.path(), "Leaf", &[]);
    assert_eq!(root["materials"][1]["alphaMode"], "MASK");
    // The sample's mask, texel by texel, is what the squares keep.
    let maps = mesophyll::files::image::read_exr(&dir.path().join("elm/front.exr")).unwrap();
    let mask = maps.get("mask.Y").unwrap();
    let on = mask.iter().filter(|m| **m != 0.0).count() as f64 / mask.len() as f64;
    let share = said["share_on_the_blade"].as_f64().unwrap();
    assert!((share - on).abs() < 0.05, "{share} {on}");
}

/// Coordinates beyond the picture show it again, as the source's sampler says; where it says nothing, it repeats.
#[test]
fn coordinates_beyond_the_picture_go_on_as_in_the_source() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    let plant = dir.path().join("plant.gltf");
    squares(&plant, 3, 0.03, 0.0, false, Some(json!({"name": "Leaf"})));
    let (inside, root) = dressed(dir.path(), "Leaf", &[]);
    assert_eq!(root["samplers"][0]["wrapS"], 33071);
    squares(&plant, 3, 0.03, 4.0, false, Some(json!({"name": "Leaf"})));
    let (moved, root) = dressed(dir.path(), "Leaf", &[]);
    assert_eq!([&root["samplers"][0]["wrapS"], &root["samplers"][0]["wrapT"]], [&json!(10497), &json!(10497)]);
    let [a, b] = [&inside, &moved].map(|said| said["share_on_the_blade"].as_f64().unwrap());
    assert!((a - b).abs() < 0.02, "{a} {b}");
}

/// Colours of vertices would tint the fit; they are dropped and listed. A file without materials is dressed by the name
/// of its mesh.
#[test]
fn colours_of_vertices_are_dropped_and_meshes_have_names() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    squares(&dir.path().join("plant.gltf"), 2, 0.03, 0.0, true, None);
    let (said, root) = dressed(dir.path(), "leaves", &[]);
    let list = root["meshes"][0]["primitives"].as_array().unwrap();
    assert!(list.len() == 2 && list.iter().all(|p| p["attributes"]["COLOR_0"].is_null()), "{list:?}");
    assert!(said["undressed"].to_string().contains("its vertex colours (COLOR_0) were left out"), "{said}");
    let names: Vec<&str> = root["materials"].as_array().unwrap().iter().map(|m| m["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["sample front", "sample back"]);
}

/// A card many times as long as the blade (30 mm) is a twig: it is warned about, and leaves are scattered over it.
#[test]
fn a_card_of_a_twig_is_warned_about_and_scattered_over() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    let material = json!({"name": "Leaf", "alphaMode": "MASK"});
    squares(&dir.path().join("plant.gltf"), 1, 0.6, 0.0, false, Some(material));
    let (said, _) = dressed(dir.path(), "Leaf", &[]);
    let warning = said["warnings"].to_string();
    assert!(warning.contains("0.60 m long") && warning.contains("--scatter"), "{warning}");
    assert_eq!(said["scattered"], 0);
    let (said, root) = dressed(dir.path(), "Leaf", &["--scatter"]);
    assert_eq!(said["warnings"], json!([]));
    // Half of the card's .36 m² is covered by leaves of 30 × 20 mm, as far as the mask fills these.
    let maps = mesophyll::files::image::read_exr(&dir.path().join("elm/front.exr")).unwrap();
    let mask = maps.get("mask.Y").unwrap();
    let filled = mask.iter().filter(|m| **m != 0.0).count() as f64 / mask.len() as f64;
    let want = 0.5 * 0.36 / (0.03 * 0.02 * filled);
    let found = said["scattered"].as_f64().unwrap();
    assert!((found / want - 1.0).abs() < 0.05, "{found} {want}");
    let primitives = root["meshes"][0]["primitives"].as_array().unwrap();
    assert_eq!(primitives.len(), 2);
    let positions = &root["accessors"][primitives[0]["attributes"]["POSITION"].as_u64().unwrap() as usize];
    assert_eq!(positions["count"].as_f64(), Some(4.0 * found));
    // They lie on the card, at most half a leaf beyond its border.
    for (name, low, high) in [("min", -0.02, 0.05), ("max", 0.55, 0.62)] {
        for c in 0..2 {
            let v = positions[name][c].as_f64().unwrap();
            assert!((low..high).contains(&v), "{name} {c}: {v}");
        }
    }
}
