//! `blade.glb`: the blade as binary glTF 2.0, one double-sided mesh with normals, tangents and texture coordinates. The
//! buffer is in mm, under a node that scales it to glTF's metres.

use super::BladeMesh;
use crate::{Error, Result};
use mesophyll_files::atomic;
use serde_json::json;
use std::path::Path;

const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Writes the blade, whole or not at all.
pub fn write(path: &Path, name: &str, blade: &BladeMesh) -> Result<()> {
    let mut bin: Vec<u8> = Vec::new();
    let mut views = Vec::new();
    let mut add = |floats: &mut dyn Iterator<Item = f32>, target: u32| {
        let start = bin.len();
        floats.for_each(|f| bin.extend(f.to_le_bytes()));
        views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": bin.len() - start, "target": target}));
    };
    add(&mut blade.positions.iter().flatten().copied(), ARRAY_BUFFER);
    add(&mut blade.normals.iter().flatten().copied(), ARRAY_BUFFER);
    add(&mut blade.tangents.iter().flatten().copied(), ARRAY_BUFFER);
    add(&mut blade.uvs.iter().flatten().copied(), ARRAY_BUFFER);
    let start = bin.len();
    blade.indices.iter().for_each(|i| bin.extend(i.to_le_bytes()));
    views.push(
        json!({"buffer": 0, "byteOffset": start, "byteLength": bin.len() - start, "target": ELEMENT_ARRAY_BUFFER}),
    );
    let bound = |least: bool| {
        [0, 1, 2].map(|k: usize| {
            let values = blade.positions.iter().map(|p| p[k]);
            if least { values.fold(f32::INFINITY, f32::min) } else { values.fold(f32::NEG_INFINITY, f32::max) }
        })
    };
    let count = blade.positions.len();
    let vectors =
        |view: usize, kind: &str| json!({"bufferView": view, "componentType": FLOAT, "count": count, "type": kind});
    let mut positions = vectors(0, "VEC3");
    positions["min"] = json!(bound(true));
    positions["max"] = json!(bound(false));
    let root = json!({
        "asset": {"version": "2.0", "generator": concat!("mesophyll ", env!("CARGO_PKG_VERSION"))},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name, "scale": [0.001, 0.001, 0.001]}],
        "meshes": [{"name": name, "primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3}, "indices": 4, "material": 0,
                "mode": 4}]}],
        "materials": [{"name": name, "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.35, 0.1, 1.0], "metallicFactor": 0.0,
                "roughnessFactor": 0.5}}],
        "accessors": [positions, vectors(1, "VEC3"), vectors(2, "VEC4"), vectors(3, "VEC2"),
            {"bufferView": 4, "componentType": UNSIGNED_INT, "count": blade.indices.len(), "type": "SCALAR"}],
        "bufferViews": views,
        "buffers": [{"byteLength": bin.len()}],
    });
    let json = serde_json::to_vec(&root).map_err(|e| Error::write(path, e))?;
    let glb = gltf::binary::Glb {
        header: gltf::binary::Header { magic: *b"glTF", version: 2, length: 0 },
        json: json.into(),
        bin: Some(bin.into()),
    };
    let bytes = glb.to_vec().map_err(|e| Error::write(path, e))?;
    atomic::write_bytes(path, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_gets_back_what_was_written() {
        let blade = BladeMesh {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, 2.0, 0.0]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            tangents: vec![[1.0, 0.0, 0.0, 1.0]; 3],
            uvs: vec![[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]],
            indices: vec![0, 1, 2],
            ..BladeMesh::default()
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("blade.glb");
        write(&path, "elm", &blade).unwrap();
        let (document, buffers, _) = gltf::import(&path).unwrap();
        let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|b| Some(&buffers[b.index()]));
        assert_eq!(reader.read_positions().unwrap().collect::<Vec<_>>(), blade.positions);
        assert_eq!(reader.read_tangents().unwrap().collect::<Vec<_>>(), blade.tangents);
        assert_eq!(reader.read_indices().unwrap().into_u32().collect::<Vec<_>>(), blade.indices);
        assert!(primitive.material().double_sided());
        // In metres to whoever applies the node.
        assert_eq!(document.nodes().next().unwrap().transform().decomposed().2, [0.001; 3]);
    }
}
