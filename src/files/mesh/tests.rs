//! Meshes as files: what is computed, what is refused, and how damaged files end.

use super::*;
use crate::unit::LengthUnit;
use std::path::Path;

/// A dome over the unit square of texture coordinates, and the file it makes; `keep` says which attributes go in.
fn dome_json(keep: &[&str], uri: Option<&str>) -> (String, Vec<u8>, LeafMesh) {
    let n = 9;
    let mut mesh = LeafMesh::default();
    for j in 0..n {
        for i in 0..n {
            let (u, v) = (i as f64 / (n - 1) as f64, j as f64 / (n - 1) as f64);
            let (x, y) = ((u - 0.5) * 40.0, (0.5 - v) * 30.0);
            mesh.positions.push(DVec3::new(x, y, 5.0 - 0.01 * (x * x + y * y)));
            mesh.normals.push(DVec3::new(0.02 * x, 0.02 * y, 1.0).normalize());
            mesh.uvs.push(DVec2::new(u, v));
        }
    }
    for j in 0..n - 1 {
        for i in 0..n - 1 {
            let a = (j * n + i) as u32;
            let (b, c, d) = (a + 1, a + n as u32, a + n as u32 + 1);
            mesh.indices.extend([a, c, b, b, c, d]);
        }
    }
    let mut bytes: Vec<u8> = Vec::new();
    let (mut views, mut accessors, mut attributes) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |name: &str, data: Vec<f32>, kind: &str, size: usize| {
        if keep.contains(&name) {
            views.push(format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, bytes.len(), data.len() * 4));
            accessors.push(format!(
                r#"{{"bufferView":{},"componentType":5126,"count":{},"type":"{kind}",
                    "min":[-100,-100,-100],"max":[100,100,100]}}"#,
                views.len() - 1,
                data.len() / size
            ));
            attributes.push(format!(r#""{name}":{}"#, views.len() - 1));
            bytes.extend(data.iter().flat_map(|v| v.to_le_bytes()));
        }
    };
    let flat3 = |list: &[DVec3]| list.iter().flat_map(|p| p.to_array()).map(|v| v as f32).collect::<Vec<_>>();
    add("POSITION", flat3(&mesh.positions), "VEC3", 3);
    add("NORMAL", flat3(&mesh.normals), "VEC3", 3);
    add("TEXCOORD_0", mesh.uvs.iter().flat_map(|t| [t.x as f32, t.y as f32]).collect(), "VEC2", 2);
    views.push(format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, bytes.len(), mesh.indices.len() * 4));
    accessors.push(format!(
        r#"{{"bufferView":{},"componentType":5125,"count":{},"type":"SCALAR"}}"#,
        views.len() - 1,
        mesh.indices.len()
    ));
    bytes.extend(mesh.indices.iter().flat_map(|v| v.to_le_bytes()));
    let uri = uri.map_or(String::new(), |u| format!(r#""uri":"{u}","#));
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{{}}},"indices":{}}}]}}],
        "buffers":[{{{uri}"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}]}}"#,
        attributes.join(","),
        accessors.len() - 1,
        bytes.len(),
        views.join(","),
        accessors.join(",")
    );
    (json, bytes, mesh)
}

fn write(dir: &Path, json: &str, bytes: &[u8]) -> std::path::PathBuf {
    std::fs::write(dir.join("leaf.bin"), bytes).unwrap();
    std::fs::write(dir.join("leaf.gltf"), json).unwrap();
    dir.join("leaf.gltf")
}

#[test]
fn normals_and_tangents_are_computed_where_absent() {
    let dir = tempfile::tempdir().unwrap();
    let (json, bytes, truth) = dome_json(&["POSITION", "TEXCOORD_0"], Some("leaf.bin"));
    let mesh = read(&write(dir.path(), &json, &bytes), Some(LengthUnit::Millimetre)).unwrap();
    assert_eq!(mesh.triangles(), truth.triangles());
    for k in 0..mesh.positions.len() {
        assert!(mesh.normals[k].dot(truth.normals[k]) > 0.995, "{:?} {:?}", mesh.normals[k], truth.normals[k]);
        let (t, w) = mesh.tangents[k];
        assert!(t.dot(mesh.normals[k]).abs() < 1e-9 && t.x > 0.9 && w == 1.0);
        // Image up is +y.
        assert!((mesh.normals[k].cross(t) * w).y > 0.9);
    }
}

#[test]
fn a_path_outside_the_folder_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let home = dir.path().join("home");
    std::fs::create_dir(&home).unwrap();
    for uri in [
        "../secret.bin",
        "/etc/passwd",
        "file:///etc/passwd",
        "%2e%2e/secret.bin",
        "a/../../secret.bin",
        "..\\\\secret.bin",
    ] {
        let (json, bytes, _) = dome_json(&["POSITION", "NORMAL", "TEXCOORD_0"], Some(uri));
        std::fs::write(dir.path().join("secret.bin"), &bytes).unwrap();
        let e = read(&write(&home, &json, &bytes), Some(LengthUnit::Millimetre)).unwrap_err();
        assert!(e.is_usage());
        assert!(e.to_string().contains("buffers[0].uri") && e.to_string().contains("outside the file's folder"), "{e}");
    }
    #[cfg(unix)]
    {
        let (json, bytes, _) = dome_json(&["POSITION", "NORMAL", "TEXCOORD_0"], Some("link.bin"));
        std::os::unix::fs::symlink(dir.path().join("secret.bin"), home.join("link.bin")).unwrap();
        assert!(
            read(&write(&home, &json, &bytes), Some(LengthUnit::Millimetre))
                .unwrap_err()
                .to_string()
                .contains("outside")
        );
    }
}

#[test]
fn damage_is_a_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let (json, bytes, _) = dome_json(&["POSITION", "NORMAL", "TEXCOORD_0"], Some("leaf.bin"));
    for (j, b) in [
        (json.clone(), bytes[..bytes.len() / 2].to_vec()),
        (json[..json.len() / 2].to_string(), bytes.clone()),
        (json.replace("\"byteOffset\":0", "\"byteOffset\":99999999"), bytes.clone()),
        (json.replace("TEXCOORD_0", "TEXCOORD_1"), bytes.clone()),
        (json.replace("\"nodes\":[0]", "\"nodes\":[]"), bytes.clone()),
        (String::new(), Vec::new()),
    ] {
        let e = read(&write(dir.path(), &j, &b), Some(LengthUnit::Millimetre)).unwrap_err();
        assert!(e.is_usage() && e.to_string().contains("leaf.gltf"), "{e}");
    }
    // An index past the last vertex.
    let (json, mut bytes, _) = dome_json(&["POSITION", "NORMAL", "TEXCOORD_0"], Some("leaf.bin"));
    let end = bytes.len();
    bytes[end - 4..].copy_from_slice(&4000u32.to_le_bytes());
    assert!(
        read(&write(dir.path(), &json, &bytes), Some(LengthUnit::Millimetre))
            .unwrap_err()
            .to_string()
            .contains("found 4000")
    );
}

/// The dome again as another program may write it: in metres, under nodes that move, turn and scale it, with its back
/// beside it.
#[test]
fn lengths_are_metres_and_all_nodes_are_applied() {
    let dir = tempfile::tempdir().unwrap();
    let (json, bytes, truth) = dome_json(&["POSITION", "NORMAL", "TEXCOORD_0"], Some("leaf.bin"));
    let with = |nodes: &str, asset: &str| {
        let json = json
            .replace(r#""nodes":[{"mesh":0}],"#, &format!("{nodes},"))
            .replace(r#""asset":{"version":"2.0"}"#, asset);
        read(&write(dir.path(), &json, &bytes), None).unwrap()
    };
    let near = |a: DVec3, b: DVec3| assert!(a.distance(b) < 1e-5, "{a} {b}");
    let plain = r#""asset":{"version":"2.0"}"#;
    // Millimetres in the buffer under a node that makes metres of them, as `export --to gltf` writes.
    let exported = with(r#""nodes":[{"mesh":0,"scale":[0.001,0.001,0.001]}]"#, plain);
    for (a, b) in exported.positions.iter().zip(&truth.positions) {
        near(*a, *b);
    }
    // A quarter turn about z, then 20 mm along x, then everything half as large: by hand, (x, y, z) → ((20 − y)/2, x/2,
    // z/2).
    let nest = concat!(
        r#""nodes":[{"children":[1],"scale":[0.5,0.5,0.5]},"#,
        r#"{"children":[2],"translation":[0.02,0,0]},"#,
        r#"{"mesh":0,"rotation":[0,0,0.70710678,0.70710678],"scale":[0.001,0.001,0.001]}]"#
    );
    for ((a, n), (b, m)) in (with(nest, plain))
        .positions
        .iter()
        .zip(&with(nest, plain).normals)
        .zip(truth.positions.iter().zip(&truth.normals))
    {
        near(*a, DVec3::new((20.0 - b.y) / 2.0, b.x / 2.0, b.z / 2.0));
        near(*n, DVec3::new(-m.y, m.x, m.z));
    }
    // First the file's own statement, then the caller's.
    near(
        with(r#""nodes":[{"mesh":0}]"#, r#""asset":{"version":"2.0","extras":{"unit":"cm"}}"#).positions[0],
        10.0 * truth.positions[0],
    );
    near(
        read(&write(dir.path(), &json, &bytes), Some(LengthUnit::Millimetre)).unwrap().positions[0],
        truth.positions[0],
    );
    let odd = json.replace(plain, r#""asset":{"version":"2.0","extras":{"unit":"inch"}}"#);
    let e = read(&write(dir.path(), &odd, &bytes), None).unwrap_err().to_string();
    assert!(e.contains("asset.extras.unit") && e.contains("found \"inch\""), "{e}");
}
