//! `mesophyll dress` as a program: fitted leaves on plants that others wrote, read back with the `gltf` crate.

use crate::export::with_blade;
use crate::plants::validated;
use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

fn mesophyll(args: &[&str], folder: &Path) -> (i32, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_mesophyll")).args(args).current_dir(folder).output().unwrap();
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
}

fn root(file: &Path) -> Value {
    let bytes = std::fs::read(file).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

/// A rhombus of 4 × 2 whose base is at `foot`, turned; its corners are base, right, tip and left of who looks at the
/// front with the tip up.
fn rhombus(turn: DQuat, foot: DVec3) -> [DVec3; 4] {
    [(0.0, 0.0), (2.0, -1.0), (4.0, 0.0), (2.0, 1.0)].map(|(x, y)| turn * DVec3::new(x, y, 0.0) + foot)
}

/// A plant in two files: two leaves without texture coordinates and a box in one mesh (material `green`), a card with a
/// cut-out (no name), and a stem (`bark`).
fn plant(folder: &Path) {
    let turn = |a: f64, b: f64| DQuat::from_euler(glam::EulerRot::XYZ, a, b, 0.4);
    let mut leaves: Vec<DVec3> = rhombus(turn(0.3, -0.5), turn(0.3, -0.5) * DVec3::new(2.0, 0.0, 0.0)).to_vec();
    leaves.extend(rhombus(turn(-1.1, 0.2), turn(-1.1, 0.2) * DVec3::new(3.0, 0.0, 0.0)));
    let mut indices: Vec<u32> = [0, 1, 2, 0, 2, 3].into_iter().chain([4, 5, 6, 4, 6, 7]).collect();
    leaves.extend(
        (0..8).map(|k| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)) - DVec3::splat(9.0)),
    );
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    indices.extend(sides.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d].map(|k: u32| 8 + k)));
    let card = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
    let (mut bin, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |bytes: Vec<u8>, accessor: Value| {
        views.push(json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len()}));
        bin.extend(&bytes);
        let mut accessor = accessor;
        accessor["bufferView"] = json!(views.len() - 1);
        accessors.push(accessor);
    };
    let places = |list: &[DVec3]| {
        let all: Vec<[f32; 3]> = list.iter().map(|p| p.as_vec3().to_array()).collect();
        let bound = |pick: fn(f32, f32) -> f32| [0, 1, 2].map(|c| all.iter().map(|p| p[c]).reduce(pick).unwrap());
        let bytes: Vec<u8> = all.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let [low, high] = [bound(f32::min), bound(f32::max)];
        (bytes, json!({"componentType": 5126, "count": all.len(), "type": "VEC3", "min": low, "max": high}))
    };
    let (bytes, accessor) = places(&leaves);
    add(bytes, accessor);
    let count = indices.len();
    add(
        indices.iter().flat_map(|i| i.to_le_bytes()).collect(),
        json!({"componentType": 5125, "count": count, "type": "SCALAR"}),
    );
    let (bytes, accessor) = places(&card);
    add(bytes, accessor);
    let normals: Vec<u8> = [0f32, 0.0, 1.0].iter().cycle().take(12).flat_map(|v| v.to_le_bytes()).collect();
    add(normals, json!({"componentType": 5126, "count": 4, "type": "VEC3"}));
    let uvs: Vec<u8> = [0.25f32, 0.5, 0.5, 0.5, 0.5, 0.25, 0.25, 0.25].iter().flat_map(|v| v.to_le_bytes()).collect();
    add(uvs, json!({"componentType": 5126, "count": 4, "type": "VEC2"}));
    add([0u8, 1, 2, 0, 2, 3, 0, 0].to_vec(), json!({"componentType": 5121, "count": 6, "type": "SCALAR"}));
    let root = json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2], "extras": {"kept": [1.25, "word"]}}],
        "nodes": [{"mesh": 0}, {"mesh": 1, "translation": [0.1, 0.2, 0.3]}, {"mesh": 2}],
        "meshes": [
            {"name": "crown", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]},
            {"primitives": [
                {"attributes": {"POSITION": 2, "NORMAL": 3, "TEXCOORD_0": 4}, "indices": 5, "material": 2},
            ]},
            {"primitives": [{"attributes": {"POSITION": 2}, "material": 1, "mode": 2}]},
        ],
        "materials": [{"name": "green"}, {"name": "bark"}, {"alphaMode": "MASK"}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"uri": "plant%20data.bin", "byteLength": bin.len()}],
    });
    std::fs::write(folder.join("plant.gltf"), serde_json::to_vec(&root).unwrap()).unwrap();
    std::fs::write(folder.join("plant data.bin"), bin).unwrap();
}

/// Leaves without coordinates are laid along the fitted blade by their own axes, on both sides; what is not flat and
/// what has another material stay as they are.
#[test]
fn leaves_without_coordinates_are_laid_along_the_blade() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    plant(dir.path());
    let (code, _, stderr) = mesophyll(&["dress", "plant.gltf", "--leaf", "green=elm", "-o", "out.glb"], dir.path());
    assert_eq!(code, 0, "{stderr}");
    assert!(stderr.contains("4 triangles dressed in 1 primitive, 4 of them"), "{stderr}");
    assert!(stderr.contains("left out: meshes[0].primitives[0]: 1 of 3 pieces are not flat"), "{stderr}");
    let (document, buffers, images) = gltf::import(dir.path().join("out.glb")).unwrap();
    let crown = document.meshes().next().unwrap();
    let list: Vec<gltf::Primitive> = crown.primitives().collect();
    let read = |k: usize| list[k].reader(|b| Some(&*buffers[b.index()]));
    let [rest, front, back] = [0, 1, 2].map(|k| read(k).read_indices().unwrap().into_u32().collect::<Vec<u32>>());
    assert_eq!(list.len(), 3);
    assert!(rest.len() == 36 && rest.iter().all(|k| *k >= 8), "{rest:?}");
    assert_eq!(front, [0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7]);
    assert_eq!(back, [0, 2, 1, 0, 3, 2, 4, 6, 5, 4, 7, 6]);
    assert_eq!([0, 1, 2].map(|k| list[k].material().name().unwrap()), ["green", "sample front", "sample back"]);
    // The blade fills its maps: base on the left, tip on the right; the left of the leaf is the top of the picture.
    let uvs: Vec<[f32; 2]> = read(1).read_tex_coords(0).unwrap().into_f32().collect();
    for (k, want) in [[0.0, 0.5], [0.5, 1.0], [1.0, 0.5], [0.5, 0.0]].iter().cycle().take(8).enumerate() {
        assert!((0..2).all(|c| (uvs[k][c] - want[c]).abs() < 1e-5), "{k}: {:?} {want:?}", uvs[k]);
    }
    // The pictures are those of the exporter.
    let (code, _, stderr) = mesophyll(&["export", "elm", "--to", "gltf-translucent", "-o", "leaf.glb"], dir.path());
    assert_eq!(code, 0, "{stderr}");
    let (_, _, own) = gltf::import(dir.path().join("leaf.glb")).unwrap();
    assert!(images.len() == own.len() && images.iter().zip(&own).all(|(a, b)| a.pixels == b.pixels));
    let (dressed, leaf) = (root(&dir.path().join("out.glb")), root(&dir.path().join("leaf.glb")));
    assert_eq!(dressed["materials"][3]["extensions"], leaf["materials"][0]["extensions"]);
    assert_eq!(dressed["scenes"][0]["extras"], json!({"kept": [1.25, "word"]}));
    assert_eq!(
        (&dressed["nodes"][1]["translation"], &dressed["meshes"][2]["primitives"][0]["mode"]),
        (&json!([0.1, 0.2, 0.3]), &json!(2))
    );
    let lost: Value = serde_json::from_slice(&std::fs::read(dir.path().join("out.glb.loss.json")).unwrap()).unwrap();
    let theirs: Value = serde_json::from_slice(&std::fs::read(dir.path().join("leaf.glb.loss.json")).unwrap()).unwrap();
    assert_eq!(lost["surfaces"], theirs["surfaces"]);
    if let Some(said) = validated(&dir.path().join("out.glb")) {
        assert_eq!(said, "0 0");
    }
}

/// A card keeps its coordinates or gets new ones, and the fit's outline is cut out of it; the back's normals are
/// turned.
#[test]
fn a_card_keeps_its_coordinates_unless_new_ones_are_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    plant(dir.path());
    for (options, want) in [
        (&[][..], [[0.25, 0.5], [0.5, 0.5], [0.5, 0.25], [0.25, 0.25]]),
        (&["--make-uv"], [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]),
    ] {
        let words = [&["dress", "plant.gltf", "--leaf", "2=elm", "-o", "out.glb"][..], options].concat();
        let (code, _, stderr) = mesophyll(&words, dir.path());
        assert_eq!(code, 0, "{stderr}");
        let (document, buffers, images) = gltf::import(dir.path().join("out.glb")).unwrap();
        let card = document.meshes().nth(1).unwrap();
        let list: Vec<gltf::Primitive> = card.primitives().collect();
        let read = |k: usize| list[k].reader(|b| Some(&*buffers[b.index()]));
        for k in 0..2 {
            let uvs: Vec<[f32; 2]> = read(k).read_tex_coords(0).unwrap().into_f32().collect();
            // A square has two axes that are equally long; either may be the long one.
            let turned = [[1.0, 1.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0]];
            let near = |want: [[f32; 2]; 4]| {
                uvs.iter().flatten().zip(want.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-6)
            };
            assert!(near(want) || !options.is_empty() && near(turned), "{uvs:?}");
            let up = if k == 0 { 1.0 } else { -1.0 };
            assert!(read(k).read_normals().unwrap().all(|n| n == [0.0, 0.0, up]));
            // The fitted leaf is 0.1612 mm thick, and the plant is in metres.
            assert!(read(k).read_positions().unwrap().all(|p| (p[2] - 0.0806e-3 * (up - 1.0)).abs() < 1e-9));
        }
        let material = list[0].material();
        assert_eq!(material.alpha_mode(), gltf::material::AlphaMode::Mask);
        let base = material.pbr_metallic_roughness().base_color_texture().unwrap().texture().source().index();
        assert_eq!(images[base].format, gltf::image::Format::R8G8B8A8);
        if let Some(said) = validated(&dir.path().join("out.glb")) {
            assert_eq!(said, "0 0");
        }
    }
}

/// A grown plant is dressed as any other: instances, branches and coordinates stay.
#[test]
fn a_grown_plant_keeps_everything_but_its_leaves() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    let spec = format!("{}/data/plants/elm-twig.toml", env!("CARGO_MANIFEST_DIR"));
    let (code, _, stderr) = mesophyll(&["grow", &spec, "-o", "twig.glb"], dir.path());
    assert_eq!(code, 0, "{stderr}");
    let words = ["dress", "twig.glb", "--leaf", "leaf=elm", "-o", "out.glb", "--json"];
    let (code, stdout, stderr) = mesophyll(&words, dir.path());
    assert_eq!(code, 0, "{stderr}");
    let said: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!((&said["triangles_with_made_uv"], &said["undressed"]), (&json!(0), &json!([])));
    let [before, after] = ["twig.glb", "out.glb"].map(|name| root(&dir.path().join(name)));
    assert_eq!(before["nodes"], after["nodes"]);
    let [a, b] = [&before, &after].map(|r| r["accessors"].as_array().unwrap());
    assert_eq!(a[..], b[..a.len()]);
    // Branches are found as before, and each leaf once: its back is no leaf of its own.
    let branches = |name: &str| {
        let (code, _, stderr) = mesophyll(&["import", name, "-o", "found"], dir.path());
        assert_eq!(code, 0, "{stderr}");
        let table = |name: &str| std::fs::read_to_string(dir.path().join("found").join(name)).unwrap();
        (table("branches.csv"), table("leaves.csv").lines().count())
    };
    assert_eq!(branches("twig.glb"), branches("out.glb"));
    if let Some(said) = validated(&dir.path().join("out.glb")) {
        assert_eq!(said, "0 0");
    }
}

#[test]
fn what_cannot_be_dressed_is_a_sentence() {
    let dir = tempfile::tempdir().unwrap();
    with_blade(dir.path());
    plant(dir.path());
    std::fs::write(dir.path().join("no.glb"), b"glTF").unwrap();
    for (plant, leaf, expected) in [
        (
            "plant.gltf",
            "gren=elm",
            &["plant.gltf: found no material \"gren\"; the file has \"2\", \"bark\", \"green\""][..],
        ),
        ("plant.gltf", "bark=elm", &["nothing could be dressed: meshes[2].primitives[0]: found no triangles"]),
        ("plant.gltf", "green=nowhere", &["nowhere: no leaf fit here"]),
        ("plant.gltf", "green", &["expected MATERIAL=FIT"]),
        ("no.glb", "green=elm", &["not a readable glTF file"]),
        ("gone.glb", "green=elm", &["no such file"]),
    ] {
        let (code, _, stderr) = mesophyll(&["dress", plant, "--leaf", leaf, "-o", "out.glb"], dir.path());
        assert!(code == 2 && expected.iter().all(|e| stderr.contains(e)), "{leaf}: {code} {stderr}");
        assert!(!dir.path().join("out.glb").exists() && !dir.path().join("out.glb.loss.json").exists());
    }
    let twice = ["dress", "plant.gltf", "--leaf", "green=elm", "--leaf", "green=elm", "-o", "out.glb"];
    let (code, _, stderr) = mesophyll(&twice, dir.path());
    assert!(code == 2 && stderr.contains("each material once"), "{stderr}");
}
