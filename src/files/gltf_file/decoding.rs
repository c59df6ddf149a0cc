//! A file as its readers take it: nothing compressed, vertices as floats, and a copy of the JSON without what geometry
//! does not need.

use super::{MOST_TRIANGLES, compression};
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::path::Path;

/// Meshes that Draco compressed.
const DRACO: &str = "KHR_draco_mesh_compression";
/// Vertices as integers.
const QUANTISED: &str = "KHR_mesh_quantization";
/// Leaves and other things as instances of a mesh.
pub const INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// Beginnings of the names of extensions, after their vendor, that change no triangle's place.
const HARMLESS: [&str; 9] = [
    "animation_",
    "lights_",
    "materials_",
    "structural_",
    "texture_",
    "xmp",
    "mesh_features",
    "primitive_outline",
    "audio",
];

const BYTE: u64 = 5120;
const SHORT: u64 = 5122;
const FLOAT: u64 = 5126;

fn list<'a>(root: &'a Value, name: &str) -> &'a [Value] {
    root[name].as_array().map_or(&[], Vec::as_slice)
}

fn list_mut<'a>(root: &'a mut Value, name: &str) -> impl Iterator<Item = &'a mut Value> {
    root.get_mut(name).and_then(Value::as_array_mut).into_iter().flatten()
}

/// Refuses a file that requires an extension without which its triangles are wrong, and that is neither `understood` by
/// the reader nor undone here.
pub(super) fn required(path: &Path, root: &Value, understood: &[&str]) -> Result<()> {
    // A file that does not require it has the same vertices without compression beside it.
    let packed = |p: &Value| {
        let places = p["attributes"]["POSITION"].as_u64().and_then(|k| list(root, "accessors").get(k as usize));
        p["extensions"][DRACO].is_object() && places.is_some_and(|a| a["bufferView"].is_null())
    };
    let packed = list(root, "meshes").iter().flat_map(|mesh| list(mesh, "primitives")).any(packed);
    for name in list(root, "extensionsRequired").iter().filter_map(Value::as_str).chain(packed.then_some(DRACO)) {
        if name == DRACO {
            let what = "its meshes are compressed by Draco (KHR_draco_mesh_compression), which is not read; write it \
                        without compression first, in Blender for example: import it and export it as glTF with \
                        \"Compression\" off";
            return Err(Error::input(path, what));
        }
        let kind = name.split_once('_').map_or(name, |(_, kind)| kind);
        let known = [QUANTISED, INSTANCING].contains(&name) || compression::NAMES.contains(&name);
        if !(known || understood.contains(&name) || HARMLESS.iter().any(|start| kind.starts_with(start))) {
            let what = format!("the extension \"{name}\", which is not read; write the file without it");
            return Err(Error::field(path, "extensionsRequired", format!("found {what}")));
        }
    }
    Ok(())
}

/// Replaces compressed buffer views by what they stand for.
pub(super) fn unpack(path: &Path, root: &mut Value, buffers: &mut Vec<Vec<u8>>) -> Result<()> {
    for (k, view) in list_mut(root, "bufferViews").enumerate() {
        let of = |name: &&&str| view["extensions"][**name].is_object();
        let Some(name) = compression::NAMES.iter().find(of) else { continue };
        let said = &view["extensions"][*name];
        let wrong = |what: String| Error::field(path, &format!("bufferViews[{k}].extensions.{name}"), what);
        let number = |key: &str| said[key].as_u64().unwrap_or(0) as usize;
        let (start, length) = (number("byteOffset"), number("byteLength"));
        let bytes = buffers
            .get(number("buffer"))
            .and_then(|all| all.get(start..start.checked_add(length)?))
            .ok_or_else(|| wrong("its data lies outside its buffer (truncated?)".into()))?;
        let bytes = compression::unpack(said, bytes).map_err(wrong)?;
        let mut plain = json!({"buffer": buffers.len(), "byteOffset": 0, "byteLength": bytes.len()});
        for key in ["byteStride", "target", "name"] {
            if !view[key].is_null() {
                plain[key] = view[key].clone();
            }
        }
        *view = plain;
        buffers.push(bytes);
    }
    Ok(())
}

/// The accessors of vertices and instances that the readers take as floats and that are none.
fn integers(root: &Value) -> BTreeSet<usize> {
    let accessors = list(root, "accessors");
    let mut out = BTreeSet::new();
    let mut look = |attributes: &Value, instances: bool| {
        for (name, index) in attributes.as_object().into_iter().flatten() {
            let Some(k) = index.as_u64().map(|k| k as usize) else { continue };
            let Some(accessor) = accessors.get(k) else { continue };
            let kind = accessor["componentType"].as_u64().unwrap_or(FLOAT);
            let of = |width: &str| kind < 5125 && accessor["type"] == width;
            let wrong = match name.as_str() {
                "POSITION" | "NORMAL" => of("VEC3"),
                "TANGENT" => of("VEC4"),
                "TRANSLATION" | "SCALE" => instances && of("VEC3"),
                "ROTATION" => instances && of("VEC4"),
                // Unsigned numbers that stand for 0 to 1 are texture coordinates in any file.
                name => {
                    let fraction = accessor["normalized"].as_bool().unwrap_or(false);
                    let plain = fraction && kind != BYTE && kind != SHORT;
                    name.starts_with("TEXCOORD_") && of("VEC2") && !plain
                }
            };
            if wrong {
                out.insert(k);
            }
        }
    };
    for primitive in list(root, "meshes").iter().flat_map(|mesh| list(mesh, "primitives")) {
        look(&primitive["attributes"], false);
        list(primitive, "targets").iter().for_each(|target| look(target, false));
    }
    for node in list(root, "nodes") {
        look(&node["extensions"][INSTANCING]["attributes"], true);
    }
    out
}

/// Turns vertices that are integers into floats.
pub(super) fn widen(path: &Path, root: &mut Value, buffers: &mut Vec<Vec<u8>>) -> Result<()> {
    for k in integers(root) {
        let accessor = root["accessors"][k].clone();
        let (width, numbers) = numbers(root, buffers, &accessor).ok_or_else(|| {
            Error::field(path, &format!("accessors[{k}]"), "missing data: it reaches beyond its buffer (truncated?)")
        })?;
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
        let bound = |pick: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
            (0..width).map(|c| numbers.iter().skip(c).step_by(width).copied().fold(start, pick)).collect()
        };
        let view = json!({"buffer": buffers.len(), "byteOffset": 0, "byteLength": bytes.len()});
        let Some(views) = root["bufferViews"].as_array_mut() else { continue };
        views.push(view);
        let mut new = json!({"bufferView": views.len() - 1, "componentType": FLOAT, "count": numbers.len() / width,
            "type": accessor["type"], "min": bound(f32::min, f32::INFINITY),
            "max": bound(f32::max, f32::NEG_INFINITY)});
        if !accessor["name"].is_null() {
            new["name"] = accessor["name"].clone();
        }
        root["accessors"][k] = new;
        buffers.push(bytes);
    }
    // The file no longer needs what was undone.
    for key in ["extensionsRequired", "extensionsUsed"] {
        let undone = |name: &Value| name == QUANTISED || compression::NAMES.iter().any(|own| name == own);
        if let Some(names) = root.get_mut(key).and_then(Value::as_array_mut) {
            names.retain(|name| !undone(name));
            if names.is_empty() {
                root.as_object_mut().map(|root| root.remove(key));
            }
        }
    }
    Ok(())
}

/// The numbers that an accessor stands for, and how many of them an entry has. `None` where its data is not there.
fn numbers(root: &Value, buffers: &[Vec<u8>], accessor: &Value) -> Option<(usize, Vec<f32>)> {
    let width = match accessor["type"].as_str()? {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        _ => return None,
    };
    let count = accessor["count"].as_u64()? as usize;
    let kind = accessor["componentType"].as_u64()?;
    let fraction = accessor["normalized"].as_bool().unwrap_or(false);
    let offset = accessor["byteOffset"].as_u64().unwrap_or(0) as usize;
    let read = |view: &Value, offset: usize, count: usize, kind: u64, width: usize| {
        let size = [1usize, 1, 2, 2, 0, 4, 4].get(kind.checked_sub(BYTE)? as usize).copied().filter(|s| *s > 0)?;
        let stride = view["byteStride"].as_u64().map_or(size * width, |s| s as usize);
        if stride < size * width {
            return None;
        }
        let start = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        let length = view["byteLength"].as_u64()? as usize;
        let bytes = buffers.get(view["buffer"].as_u64()? as usize)?.get(start..start.checked_add(length)?)?;
        let mut out = Vec::new();
        for k in 0..count {
            let at = offset.checked_add(k.checked_mul(stride)?)?;
            let entry = bytes.get(at..at.checked_add(size * width)?)?;
            out.extend(entry.chunks_exact(size).map(|b| one(b, kind, fraction)));
        }
        Some(out)
    };
    let views = list(root, "bufferViews");
    let mut out: Vec<f32> = match accessor["bufferView"].as_u64() {
        Some(view) => read(views.get(view as usize)?, offset, count, kind, width)?,
        // Without data all are 0. A small file must not ask for many of them.
        None => vec![0.0; Some(count).filter(|n| *n <= 3 * MOST_TRIANGLES)?.checked_mul(width)?],
    };
    if let Some(sparse) = accessor.get("sparse") {
        let some = sparse["count"].as_u64()? as usize;
        let part = |part: &Value, kind: u64, width: usize| {
            let offset = part["byteOffset"].as_u64().unwrap_or(0) as usize;
            read(views.get(part["bufferView"].as_u64()? as usize)?, offset, some, kind, width)
        };
        let indices = whole(&sparse["indices"], views, buffers, some)?;
        let values = part(&sparse["values"], kind, width)?;
        for (k, value) in indices.into_iter().zip(values.chunks_exact(width)) {
            out.get_mut(k.checked_mul(width)?..)?.get_mut(..width)?.copy_from_slice(value);
        }
    }
    Some((width, out))
}

/// The indices of sparse entries.
fn whole(part: &Value, views: &[Value], buffers: &[Vec<u8>], count: usize) -> Option<Vec<usize>> {
    let size = [1usize, 0, 2, 0, 4].get(part["componentType"].as_u64()?.checked_sub(5121)? as usize).copied()?;
    let view = views.get(part["bufferView"].as_u64()? as usize)?;
    let start =
        view["byteOffset"].as_u64().unwrap_or(0).checked_add(part["byteOffset"].as_u64().unwrap_or(0))? as usize;
    let bytes = buffers.get(view["buffer"].as_u64()? as usize)?;
    let bytes = bytes.get(start..start.checked_add(count.checked_mul(size)?)?)?;
    let number = |b: &[u8]| b.iter().rev().fold(0usize, |n, byte| n << 8 | usize::from(*byte));
    (size > 0).then(|| bytes.chunks_exact(size).map(number).collect())
}

/// The number that some bytes stand for; `fraction` says whether an integer stands for a share of the largest one.
fn one(bytes: &[u8], kind: u64, fraction: bool) -> f32 {
    let (value, most) = match (kind, bytes) {
        (BYTE, [a]) => (f32::from(*a as i8), 127.0),
        (5121, [a]) => (f32::from(*a), 255.0),
        (SHORT, [a, b]) => (f32::from(i16::from_le_bytes([*a, *b])), 32767.0),
        (5123, [a, b]) => (f32::from(u16::from_le_bytes([*a, *b])), 65535.0),
        (5125, [a, b, c, d]) => (u32::from_le_bytes([*a, *b, *c, *d]) as f32, u32::MAX as f32),
        (_, [a, b, c, d]) => return f32::from_le_bytes([*a, *b, *c, *d]),
        _ => return f32::NAN,
    };
    if fraction { (value / most).max(-1.0) } else { value }
}

/// The JSON without pictures, textures, animations, cameras and what extensions say of materials: none of it has to be
/// right for a reader of triangles. Of a material its name and its `extras` are left.
pub(super) fn bare(root: &Value, buffers: &[Vec<u8>]) -> Value {
    let mut bare = root.clone();
    if let Some(all) = bare.as_object_mut() {
        let needless =
            ["animations", "cameras", "extensions", "extensionsRequired", "extensionsUsed", "images", "samplers"];
        needless.into_iter().chain(["textures"]).for_each(|key| drop(all.remove(key)));
        if all.contains_key("buffers") {
            // The library wants no empty buffer.
            let lengths = buffers.iter().map(|b| json!({"byteLength": b.len().max(1)}));
            all.insert("buffers".into(), lengths.collect());
        }
    }
    for material in list_mut(&mut bare, "materials") {
        let kept = ["name", "extras"].into_iter().filter_map(|key| Some((key.to_string(), material.get(key)?.clone())));
        *material = Value::Object(kept.collect::<Map<_, _>>());
    }
    for node in list_mut(&mut bare, "nodes").filter_map(Value::as_object_mut) {
        ["camera", "weights"].into_iter().for_each(|key| drop(node.remove(key)));
        if let Some(extensions) = node.get_mut("extensions").and_then(Value::as_object_mut) {
            extensions.retain(|name, _| name == INSTANCING);
        }
    }
    let mut places = BTreeSet::new();
    for mesh in list_mut(&mut bare, "meshes") {
        mesh.as_object_mut().map(|mesh| mesh.remove("weights"));
        for primitive in list_mut(mesh, "primitives") {
            places.extend(primitive["attributes"]["POSITION"].as_u64());
            if let Some(primitive) = primitive.as_object_mut() {
                ["targets", "extensions"].into_iter().for_each(|key| drop(primitive.remove(key)));
            }
        }
    }
    // The library wants the bounds of places, which no reader here uses.
    for (k, accessor) in list_mut(&mut bare, "accessors").enumerate() {
        for key in ["min", "max"] {
            if places.contains(&(k as u64)) && accessor["type"] == "VEC3" {
                accessor[key] = json!([0, 0, 0]);
            } else {
                accessor.as_object_mut().map(|accessor| accessor.remove(key));
            }
        }
    }
    bare
}
