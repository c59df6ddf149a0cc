//! Files as other programs write them: integers for vertices, compressed buffers, strips and fans, extensions.

use super::*;
use crate::mesh::{self, LeafMesh};
use serde_json::json;
use std::path::PathBuf;

/// A corner of a folded strip of three squares, in metres: places with one digit after the point, so that integers hold
/// them exactly.
const PLACES: [[f32; 3]; 8] = [
    [0.0, 0.0, 0.0],
    [0.0, 0.5, 0.0],
    [0.5, 0.0, 0.25],
    [0.5, 0.5, 0.25],
    [1.0, 0.0, 0.0],
    [1.0, 0.5, 0.0],
    [1.5, 0.0, 0.25],
    [1.5, 0.5, 0.25],
];
const TRIANGLES: [u32; 18] = [0, 2, 1, 1, 2, 3, 2, 4, 3, 3, 4, 5, 4, 6, 5, 5, 6, 7];

/// A file that is put together by hand.
#[derive(Default)]
struct Made {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Made {
    fn add(&mut self, bytes: &[u8], mut view: Value, mut accessor: Value) -> usize {
        view["buffer"] = json!(0);
        view["byteOffset"] = json!(self.bin.len());
        view["byteLength"] = json!(bytes.len());
        accessor["bufferView"] = json!(self.views.len());
        self.views.push(view);
        self.accessors.push(accessor);
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.accessors.len() - 1
    }

    fn floats(&mut self, list: &[[f32; 3]]) -> usize {
        let bytes: Vec<u8> = list.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        self.add(&bytes, json!({}), json!({"componentType": 5126, "count": list.len(), "type": "VEC3"}))
    }

    fn indices(&mut self, list: &[u32]) -> usize {
        let bytes: Vec<u8> = list.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.add(&bytes, json!({}), json!({"componentType": 5125, "count": list.len(), "type": "SCALAR"}))
    }

    /// Writes a file with one node, which holds one mesh of one primitive; `change` changes its JSON.
    fn write(self, folder: &Path, primitive: Value, change: impl Fn(&mut Value)) -> PathBuf {
        let mut root = json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}], "meshes": [{"primitives": [primitive]}], "bufferViews": self.views,
            "accessors": self.accessors, "buffers": [{"byteLength": self.bin.len()}]});
        change(&mut root);
        let header = gltf::binary::Header { magic: *b"glTF", version: 2, length: 0 };
        let json = serde_json::to_vec(&root).unwrap().into();
        let bytes = gltf::binary::Glb { header, json, bin: Some(self.bin.into()) }.to_vec().unwrap();
        let path = folder.join("made.glb");
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

fn plain(folder: &Path, change: impl Fn(&mut Value)) -> PathBuf {
    let mut made = Made::default();
    let (places, indices) = (made.floats(&PLACES), made.indices(&TRIANGLES));
    made.write(folder, json!({"attributes": {"POSITION": places}, "indices": indices}), change)
}

fn leaf(path: &Path) -> LeafMesh {
    mesh::read_plain(path, None).unwrap()
}

fn told(path: &Path) -> String {
    mesh::read_plain(path, None).unwrap_err().to_string()
}

/// The corners of all triangles (mm).
fn corners(mesh: &LeafMesh) -> Vec<DVec3> {
    mesh.indices.iter().map(|k| mesh.positions[*k as usize]).collect()
}

fn truth() -> Vec<DVec3> {
    TRIANGLES.iter().map(|k| wide(PLACES[*k as usize]) * 1000.0).collect()
}

#[test]
fn vertices_that_are_integers_stand_where_floats_do() {
    let dir = tempfile::tempdir().unwrap();
    // 16 bits, two of which are padding, and a node that undoes the factor; then fractions of a byte.
    for (kind, fraction, factor) in [(5122, false, 100.0f32), (5123, false, 100.0), (5122, true, 32767.0 / 2.0)] {
        let mut made = Made::default();
        let bytes: Vec<u8> = PLACES
            .iter()
            .flat_map(|p| [p[0], p[1], p[2], 0.0].map(|v| (v * factor).round() as i16))
            .flat_map(i16::to_le_bytes)
            .collect();
        let accessor = json!({"componentType": kind, "count": 8, "type": "VEC3", "normalized": fraction});
        let places = made.add(&bytes, json!({"byteStride": 8}), accessor);
        let indices = made.indices(&TRIANGLES);
        let back = if fraction { 2.0 } else { 1.0 / factor };
        let path = made.write(dir.path(), json!({"attributes": {"POSITION": places}, "indices": indices}), |root| {
            root["nodes"][0]["scale"] = json!([back, back, back]);
            root["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
            root["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        });
        let found = corners(&leaf(&path));
        assert_eq!(found.len(), 18);
        // A fraction of 2 m in 15 bits is good to .03 mm.
        let limit = if fraction { 0.04 } else { 1e-3 };
        assert!(found.iter().zip(truth()).all(|(a, b)| a.distance(b) < limit), "{kind}: {found:?}");
        // What is handed on needs no extension.
        let (root, _) = read(&path, &[], |opened| whole(&path, &opened)).unwrap();
        assert!(root.get("extensionsRequired").is_none() && root["accessors"][0]["componentType"] == 5126, "{root}");
    }
}

#[test]
fn what_meshoptimizer_compressed_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let rows: Vec<[f32; 3]> = PLACES.to_vec();
    let vertices = meshopt::encode_vertex_buffer(&rows).unwrap();
    let indices = meshopt::encode_index_buffer(&TRIANGLES, 8).unwrap();
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let mut made = Made::default();
        let of = |count: usize, stride: usize, mode: &str, bytes: &[u8]| {
            let said = json!({"buffer": 0, "byteOffset": 0, "byteLength": bytes.len(), "byteStride": stride,
                "count": count, "mode": mode});
            json!({"extensions": {name: said}})
        };
        let kind = |kind: u32, of: &str, count: usize| json!({"componentType": kind, "count": count, "type": of});
        let places = made.add(&vertices, of(8, 12, "ATTRIBUTES", &vertices), kind(5126, "VEC3", 8));
        let listed = made.add(&indices, of(18, 4, "TRIANGLES", &indices), kind(5125, "SCALAR", 18));
        let path = made.write(dir.path(), json!({"attributes": {"POSITION": places}, "indices": listed}), |root| {
            // As gltfpack writes it: views lie in a second buffer, which has no data.
            for view in root["bufferViews"].as_array_mut().unwrap() {
                view["extensions"][name]["byteOffset"] = view["byteOffset"].clone();
                view["buffer"] = json!(1);
                view["byteOffset"] = json!(0);
            }
            let empty = json!({"byteLength": 500, "extensions": {name: {"fallback": true}}});
            root["buffers"].as_array_mut().unwrap().push(empty);
            root["extensionsUsed"] = json!([name]);
            root["extensionsRequired"] = json!([name]);
        });
        let mut found = corners(&leaf(&path));
        // The codec may begin a triangle at another of its corners.
        let sorted = |list: &mut Vec<DVec3>| {
            let mut all: Vec<Vec<String>> = list
                .chunks_exact(3)
                .map(|t| {
                    let mut t: Vec<String> = t.iter().map(|p| format!("{p:.3}")).collect();
                    let first = (0..3).min_by_key(|k| t[*k].clone()).unwrap();
                    t.rotate_left(first);
                    t
                })
                .collect();
            all.sort();
            all
        };
        assert_eq!(sorted(&mut found), sorted(&mut truth()), "{name}");
        // Damage is a sentence, and a promise of too much is refused before memory is taken.
        let bytes = std::fs::read(&path).unwrap();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        assert!(text.contains(r#""count":8,"mode""#));
        for (count, expected) in [("9", "damaged"), ("4000000000", "entries of 12 bytes")] {
            let (_, mut json) = (0, read_json(&bytes));
            json["bufferViews"][0]["extensions"][name]["count"] = serde_json::from_str(count).unwrap();
            std::fs::write(&path, with_json(&bytes, &json)).unwrap();
            let error = told(&path);
            assert!(error.contains("bufferViews[0]") && error.contains(expected), "{error}");
        }
    }
}

fn read_json(bytes: &[u8]) -> Value {
    serde_json::from_slice(&gltf::binary::Glb::from_slice(bytes).unwrap().json).unwrap()
}

fn with_json(bytes: &[u8], json: &Value) -> Vec<u8> {
    let mut glb = gltf::binary::Glb::from_slice(bytes).unwrap();
    glb.json = serde_json::to_vec(json).unwrap().into();
    glb.to_vec().unwrap()
}

/// The filters of the codec: unit vectors in two numbers, and floats with few bits.
#[test]
fn filtered_views_are_unpacked() {
    let normals: Vec<[f32; 4]> = PLACES.iter().map(|p| wide(*p) + DVec3::new(0.1, -0.2, 1.0)).map(unit).collect();
    let filtered: Vec<[i16; 4]> = meshopt::encode_filter_oct(&normals, 12);
    let packed = meshopt::encode_vertex_buffer(&filtered).unwrap();
    let said = json!({"count": 8, "byteStride": 8, "mode": "ATTRIBUTES", "filter": "OCTAHEDRAL"});
    let bytes = compression::unpack(&said, &packed).unwrap();
    for (found, true_one) in bytes.chunks_exact(8).zip(&normals) {
        for c in 0..3 {
            let value = f32::from(i16::from_le_bytes([found[2 * c], found[2 * c + 1]])) / 32767.0;
            assert!((value - true_one[c]).abs() < 1e-3, "{value} {}", true_one[c]);
        }
    }
    let filtered = meshopt::encode_filter_exp(&PLACES, 20, meshopt::EncodeExpMode::Separate);
    let packed = meshopt::encode_vertex_buffer(&filtered).unwrap();
    let said = json!({"count": 8, "byteStride": 12, "mode": "ATTRIBUTES", "filter": "EXPONENTIAL"});
    let bytes = compression::unpack(&said, &packed).unwrap();
    let floats: Vec<f32> = bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    assert!(floats.iter().zip(PLACES.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-5), "{floats:?}");
    let odd = compression::unpack(&json!({"count": 8, "byteStride": 10, "mode": "ATTRIBUTES"}), &packed);
    assert!(odd.unwrap_err().contains("damaged"));
}

fn unit(v: DVec3) -> [f32; 4] {
    v.normalize().extend(0.0).as_vec4().to_array()
}

#[test]
fn strips_and_fans_are_triangles_and_lines_are_none() {
    let dir = tempfile::tempdir().unwrap();
    let of = |mode: u32, list: Option<&[u32]>| {
        let mut made = Made::default();
        let places = made.floats(&PLACES);
        let mut primitive = json!({"attributes": {"POSITION": places}, "mode": mode});
        if let Some(list) = list {
            primitive["indices"] = json!(made.indices(list));
        }
        made.write(dir.path(), primitive, |_| ())
    };
    let listed = |list: &[u32]| -> Vec<DVec3> { list.iter().map(|k| wide(PLACES[*k as usize]) * 1000.0).collect() };
    // The specification's own order of corners: p(i), p(i + 1 + i % 2), p(i + 2 − i % 2), and p(i + 1), p(i + 2), p(0).
    let strip = listed(&[0, 1, 2, 1, 3, 2, 2, 3, 4, 3, 5, 4, 4, 5, 6, 5, 7, 6]);
    assert_eq!(corners(&leaf(&of(5, None))), strip);
    assert_eq!(corners(&leaf(&of(6, Some(&[1, 0, 2, 3])))), listed(&[0, 2, 1, 2, 3, 1]));
    for mode in [0, 1, 2, 3] {
        assert!(told(&of(mode, None)).contains("found no triangles"), "{mode}");
    }
}

#[test]
fn only_what_changes_triangles_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    // A picture that nobody here reads, a material of an old kind, an animation by pointers, and bounds that are wrong.
    let path = plain(dir.path(), |root| {
        root["images"] = json!([{"uri": "gone.webp"}, {"mimeType": "image/ktx2", "bufferView": 0}]);
        root["textures"] = json!([{"extensions": {"EXT_texture_webp": {"source": 0}}}]);
        root["materials"] = json!([{"name": "Leaf", "alphaMode": "ODD", "extensions":
            {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {"index": 7}}}}]);
        root["meshes"][0]["primitives"][0]["material"] = json!(0);
        root["animations"] = json!([{"channels": [{"sampler": 0, "target": {"path": "pointer"}}], "samplers": []}]);
        root["cameras"] = json!([{"type": "odd"}]);
        let names =
            ["KHR_materials_pbrSpecularGlossiness", "EXT_texture_webp", "KHR_texture_basisu", "KHR_materials_sheen"];
        root["extensionsRequired"] = json!(names);
        root["accessors"][0]["min"] = json!([3]);
    });
    assert_eq!(corners(&leaf(&path)), truth());
    let name = |opened: GltfDocument| Ok(opened.document.materials().next().and_then(|m| m.name().map(String::from)));
    assert_eq!(read(&path, &[], name).unwrap().as_deref(), Some("Leaf"));
    for (required, expected) in [
        ("KHR_draco_mesh_compression", ["compressed by Draco", "\"Compression\" off"]),
        ("ACME_folded_space", ["the extension \"ACME_folded_space\"", "write the file without it"]),
    ] {
        let error = told(&plain(dir.path(), |root| root["extensionsRequired"] = json!([required])));
        assert!(expected.iter().all(|part| error.contains(part)) && error.lines().count() == 1, "{error}");
    }
    // A file that only uses Draco, but has its vertices nowhere else.
    let error = told(&plain(dir.path(), |root| {
        root["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_draco_mesh_compression": {"bufferView": 0}});
        root["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    }));
    assert!(error.contains("compressed by Draco"), "{error}");
}

#[test]
fn instances_are_read_and_doubled_faces_are_one() {
    let dir = tempfile::tempdir().unwrap();
    let mut made = Made::default();
    let places = made.floats(&PLACES);
    let back: Vec<u32> = TRIANGLES.chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect();
    let both = made.indices(&[TRIANGLES.as_slice(), &back].concat());
    let moved = made.floats(&[[0.0; 3], [0.0, 0.0, 3.0]]);
    let turned: Vec<u8> =
        [[0i16, 0, 0, 32767], [0, 0, 32767, 0]].iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let turned =
        made.add(&turned, json!({}), json!({"componentType": 5122, "count": 2, "type": "VEC4", "normalized": true}));
    let path = made.write(dir.path(), json!({"attributes": {"POSITION": places}, "indices": both}), |root| {
        let attributes = json!({"TRANSLATION": moved, "ROTATION": turned});
        root["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
        root["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing", "KHR_mesh_quantization"]);
    });
    let found = corners(&leaf(&path));
    // The second instance is turned by half about z and stands 3 m in front.
    let second = truth().into_iter().map(|p| DVec3::new(-p.x, -p.y, p.z + 3000.0));
    let all: Vec<DVec3> = truth().into_iter().chain(second).collect();
    assert_eq!(found.len(), all.len());
    assert!(found.iter().zip(&all).all(|(a, b)| a.distance(*b) < 1e-3), "{found:?}");
}

/// A picture whose left half is opaque, as the colour of a material that cuts out what is not.
#[test]
fn a_material_cuts_out_what_its_picture_shows() {
    let dir = tempfile::tempdir().unwrap();
    let picture = ::image::RgbaImage::from_fn(8, 4, |x, _| ::image::Rgba([9, 99, 9, if x < 4 { 255 } else { 0 }]));
    picture.save(dir.path().join("leaf one.png")).unwrap();
    let of = |change: &dyn Fn(&mut Value)| {
        let path = plain(dir.path(), |root| {
            root["images"] = json!([{"uri": "leaf%20one.png"}]);
            root["textures"] = json!([{"source": 0}]);
            root["materials"] =
                json!([{"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
            change(root);
        });
        read(&path, &[], |opened| Ok(AlphaMask::of(&path, &opened, 0))).unwrap()
    };
    let mask = of(&|_| ()).unwrap();
    // In the middle of texels their own opacity, on the border between them the half of both; the picture repeats.
    for (uv, value) in [([0.3, 0.3], 0.5), ([0.8, 0.3], -0.5), ([0.5, 0.5], 0.0), ([1.3, -2.2], 0.5), ([0.0, 0.9], 0.0)]
    {
        assert!((mask.at(uv) - value).abs() < 1e-6, "{uv:?}: {}", mask.at(uv));
    }
    assert!((of(&|root| root["materials"][0]["alphaCutoff"] = json!(0.1)).unwrap().at([0.5, 0.5]) - 0.4).abs() < 1e-6);
    assert!(of(&|root| root["materials"][0]["alphaMode"] = json!("OPAQUE")).is_none());
    assert!(of(&|root| root["images"][0]["uri"] = json!("gone.png")).is_none());
}
