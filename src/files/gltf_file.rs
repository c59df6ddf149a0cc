//! Opens glTF files that others wrote (`.glb`, or `.gltf` with buffers beside it). A file that leads out of its folder,
//! ends too early or has values that are not finite is refused with one sentence before it is used.

mod compression;
mod decoding;
mod instances;
mod mask;
#[cfg(test)]
mod tests;

use crate::atomic::explain;
use crate::unit::LengthUnit;
use crate::{Error, Result, first_bytes, guard, whole_file};
pub use decoding::INSTANCING;
use glam::{DMat4, DQuat, DVec3};
use gltf::mesh::Mode;
pub use instances::places;
pub use mask::{AlphaMask, colour};
use serde_json::{Value, json};
use std::path::{Component, Path};

/// Nodes that are nested deeper than this are taken for a cycle.
pub const DEEPEST: usize = 64;

/// The largest number of triangles of a file. No renderer here draws more in a useful time.
pub const MOST_TRIANGLES: usize = 5_000_000;

/// The member of a primitive's `extras` that marks it as the back of a leaf: the triangles of a front that is in the
/// same mesh, seen from behind and a leaf's thickness away. Readers of shapes leave it out, for a leaf is one surface.
pub const BACK_OF_LEAF: &str = "back_of_leaf";

/// A file with all its buffers in memory.
#[derive(Debug)]
pub struct GltfDocument {
    /// Nodes, meshes, materials.
    pub document: gltf::Document,
    /// Data by the index of the buffer.
    pub buffers: Vec<gltf::buffer::Data>,
    /// Unit of the file's lengths: the metre, unless `asset.extras.unit` says otherwise.
    pub unit: LengthUnit,
    /// The file's JSON with everything that `document` lacks: pictures, textures, all of the materials. Its vertices
    /// are floats, and nothing in it is compressed.
    root: Value,
}

/// Opens `path` and hands it to `with`, which understands the extensions `understood`, so that a file may require them.
/// A damaged file gives an error in one sentence, whatever the reader does with it.
///
/// Vertices come as floats and uncompressed, also those that the file has as integers (`KHR_mesh_quantization`) or
/// compressed by meshoptimizer. Pictures and materials need not be readable: of a material the document has the name.
///
/// # Errors
/// [`Error::Input`] naming the file: missing, damaged, a buffer or a picture outside its folder; and those of `with`.
pub fn read<T>(path: &Path, understood: &[&str], with: impl FnOnce(GltfDocument) -> Result<T>) -> Result<T> {
    let bytes = whole_file::bytes(path, whole_file::MOST_DATA)?;
    guard::guarded(|| parse(path, &bytes, understood).and_then(with))
        .unwrap_or_else(|| Err(Error::input(path, "not a readable glTF file (damaged)")))
}

/// Largest number of entries of an accessor; no mesh here has more.
const MOST_ENTRIES: u64 = 100_000_000;

fn parse(path: &Path, bytes: &[u8], understood: &[&str]) -> Result<GltfDocument> {
    let bad = |e: gltf::Error| Error::input(path, sentence(&e));
    let (json, mut blob) = if bytes.starts_with(b"glTF") {
        let glb = gltf::binary::Glb::from_slice(bytes).map_err(bad)?;
        (glb.json, glb.bin.map(std::borrow::Cow::into_owned))
    } else {
        begins(path, bytes)?;
        (bytes.into(), None)
    };
    let unread = |e: serde_json::Error| bad(gltf::Error::Deserialize(e));
    let mut root: Value = serde_json::from_slice(&json).map_err(unread)?;
    decoding::required(path, &root, understood)?;
    // A sparse accessor can promise entries for which it has no bytes.
    for (k, accessor) in root["accessors"].as_array().into_iter().flatten().enumerate() {
        if let Some(long) = accessor["count"].as_u64().filter(|n| *n > MOST_ENTRIES) {
            let field = format!("accessors[{k}].count");
            return Err(Error::unexpected(path, &field, long, format!("at most {MOST_ENTRIES}")));
        }
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for (k, image) in root["images"].as_array().into_iter().flatten().enumerate() {
        if let Some(uri) = image["uri"].as_str() {
            inside(path, folder, uri, &format!("images[{k}].uri"))?;
        }
    }
    let mut buffers = Vec::new();
    for (k, buffer) in root["buffers"].as_array().into_iter().flatten().enumerate() {
        buffers.push(load(path, folder, &format!("buffers[{k}]"), buffer, &mut blob)?);
    }
    decoding::unpack(path, &mut root, &mut buffers)?;
    decoding::widen(path, &mut root, &mut buffers)?;
    let json: gltf::json::Root = serde_json::from_value(decoding::bare(&root, &buffers)).map_err(unread)?;
    corners_exist(path, &json)?;
    let document = gltf::Document::from_json(json).map_err(bad)?;
    // Each node may have at most one parent: otherwise a small file could require an endless number of visits.
    let mut parents = vec![0usize; document.nodes().count()];
    for child in document.nodes().flat_map(|node| node.children()) {
        parents[child.index()] += 1;
        if parents[child.index()] > 1 {
            let field = format!("nodes[{}]", child.index());
            return Err(Error::field(path, &field, "is the child of more than one node; expected a tree"));
        }
    }
    let unit = own_unit(path, &document)?;
    Ok(GltfDocument { document, buffers: buffers.into_iter().map(gltf::buffer::Data).collect(), unit, root })
}

/// Refuses what is not even JSON.
fn begins(path: &Path, bytes: &[u8]) -> Result<()> {
    let first = bytes.iter().find(|b| !b.is_ascii_whitespace());
    if first == Some(&b'{') {
        return Ok(());
    }
    let found = match first {
        None => "an empty file",
        Some(_) => first_bytes::form(bytes).unwrap_or("a file that begins as no glTF file does"),
    };
    let what = format!("not a readable glTF file (found {found}, which is not read; expected .glb or .gltf)");
    Err(Error::input(path, what))
}

/// The data of a buffer, which is called `field` in messages.
fn load(path: &Path, folder: &Path, field: &str, buffer: &Value, blob: &mut Option<Vec<u8>>) -> Result<Vec<u8>> {
    let length = buffer["byteLength"].as_u64().unwrap_or(0) as usize;
    let source = match buffer["uri"].as_str() {
        Some(uri) => {
            inside(path, folder, uri, &format!("{field}.uri"))?;
            gltf::buffer::Source::Uri(uri)
        }
        // The place of what compressed views stand for, which has no data of its own.
        None if compression::NAMES.iter().any(|name| buffer["extensions"][*name]["fallback"] == true) => {
            return Ok(Vec::new());
        }
        None => gltf::buffer::Source::Bin,
    };
    let data = gltf::buffer::Data::from_source_and_blob(source, Some(folder), blob)
        .map_err(|e| Error::field(path, field, sentence(&e)))?;
    if data.len() < length {
        let found = format!("{} bytes", data.len());
        return Err(Error::unexpected(path, field, found, format!("{length} (truncated?)")));
    }
    Ok(data.0)
}

/// Each primitive's attributes are accessors of the file. The library relies on that before it checks it.
fn corners_exist(path: &Path, json: &gltf::json::Root) -> Result<()> {
    for (m, mesh) in json.meshes.iter().enumerate() {
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let outside = |(_, index): &(_, &gltf::json::Index<_>)| index.value() >= json.accessors.len();
            if let Some((semantic, index)) = primitive.attributes.iter().find(outside) {
                let name = match semantic {
                    gltf::json::validation::Checked::Valid(semantic) => semantic.to_string(),
                    gltf::json::validation::Checked::Invalid => "of an unknown name".into(),
                };
                let field = format!("meshes[{m}].primitives[{k}].attributes.{name}");
                let expected = format!("the number of one of the file's {} accessors", json.accessors.len());
                return Err(Error::unexpected(path, &field, index.value(), expected));
            }
        }
    }
    Ok(())
}

/// An opened file as JSON and one buffer: what lies beside it, buffers and pictures, is taken in. Everything else stays
/// as it is, extensions and extras too, but for vertices: they are floats and uncompressed.
///
/// # Errors
/// [`Error::Input`]: a picture that is missing.
pub fn whole(path: &Path, opened: &GltfDocument) -> Result<(Value, Vec<u8>)> {
    let mut root = opened.root.clone();
    let (mut bin, mut starts) = (Vec::new(), Vec::new());
    let add = |bin: &mut Vec<u8>, bytes: &[u8]| {
        bin.resize(bin.len().next_multiple_of(4), 0);
        bin.extend_from_slice(bytes);
        bin.len() - bytes.len()
    };
    for data in &opened.buffers {
        starts.push(add(&mut bin, &data.0));
    }
    let mut views = match root.get_mut("bufferViews").map(Value::take) {
        Some(Value::Array(views)) => views,
        _ => Vec::new(),
    };
    for view in &mut views {
        let start = view["buffer"].as_u64().and_then(|b| starts.get(b as usize)).copied().unwrap_or(0);
        view["byteOffset"] = json!(view["byteOffset"].as_u64().unwrap_or(0) + start as u64);
        view["buffer"] = json!(0);
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for image in root.get_mut("images").and_then(Value::as_array_mut).into_iter().flatten() {
        let Some(uri) = image["uri"].as_str().filter(|uri| !uri.starts_with("data:")) else { continue };
        let beside = folder.join(percent_decode(uri));
        let picture = whole_file::bytes(&beside, whole_file::MOST_DATA)?;
        if picture.starts_with(b"\x89PNG") || picture.starts_with(b"\xff\xd8") {
            image["mimeType"] = json!(if picture[0] == 0xff { "image/jpeg" } else { "image/png" });
        } else if !image["mimeType"].is_string() {
            return Err(Error::input(&beside, "found a picture of an unknown kind, expected PNG or JPEG"));
        }
        let start = add(&mut bin, &picture);
        image["bufferView"] = json!(views.len());
        views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": picture.len()}));
        image.as_object_mut().map(|image| image.remove("uri"));
    }
    root["bufferViews"] = json!(views);
    Ok((root, bin))
}

/// Positions of a primitive's vertices in its mesh's frame, and three indices for each triangle.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GltfPrimitive {
    /// A vertex each.
    pub positions: Vec<DVec3>,
    /// Three a triangle.
    pub indices: Vec<u32>,
}

/// Reads the triangles of `primitive`, which is called `field` in messages. Strips and fans come as single triangles;
/// points and lines have none, and neither has the [back of a leaf](BACK_OF_LEAF).
///
/// # Errors
/// [`Error::Input`]: a missing accessor, an index out of range, a place that is not finite.
pub fn surface(
    path: &Path,
    field: &str,
    primitive: &gltf::Primitive,
    buffers: &[gltf::buffer::Data],
) -> Result<GltfPrimitive> {
    let reader = primitive.reader(|b| buffers.get(b.index()).map(|d| d.0.as_slice()));
    let missing = |what: &str| Error::field(path, &format!("{field}.{what}"), "missing or out of the buffer's range");
    let positions: Vec<DVec3> = reader.read_positions().ok_or_else(|| missing("POSITION"))?.map(wide).collect();
    let n = positions.len();
    let listed: Vec<u32> = match (primitive.indices(), reader.read_indices()) {
        (Some(_), Some(list)) => list.into_u32().collect(),
        (Some(_), None) => return Err(missing("indices")),
        (None, _) => (0..n as u32).collect(),
    };
    let of_indices = format!("{field}.indices");
    if let Some(bad) = listed.iter().find(|&&i| i as usize >= n) {
        return Err(Error::unexpected(path, &of_indices, bad, format!("less than the {n} vertices")));
    }
    let indices = if is_back(primitive) { Vec::new() } else { triangles(primitive.mode(), listed) };
    if !indices.len().is_multiple_of(3) {
        return Err(Error::unexpected(path, &of_indices, format!("{} entries", indices.len()), "whole triangles"));
    }
    if positions.iter().any(|p| !p.is_finite()) {
        return Err(Error::field(path, field, "found a vertex that is not finite"));
    }
    Ok(GltfPrimitive { positions, indices })
}

/// Whether a primitive is marked as the back of a leaf.
fn is_back(primitive: &gltf::Primitive) -> bool {
    let said = primitive.extras().as_ref().and_then(|raw| serde_json::from_str::<Value>(raw.get()).ok());
    said.is_some_and(|said| said[BACK_OF_LEAF].as_bool() == Some(true))
}

/// The corners of the triangles that a primitive's vertices are joined to (glTF 2.0, §3.7.2.1).
fn triangles(mode: Mode, listed: Vec<u32>) -> Vec<u32> {
    let each = |k: usize| match mode {
        // Every second triangle of a strip has its corners the other way round.
        Mode::TriangleStrip => [k, k + 1 + k % 2, k + 2 - k % 2],
        _ => [k + 1, k + 2, 0],
    };
    match mode {
        Mode::Triangles => listed,
        Mode::TriangleStrip | Mode::TriangleFan => {
            (0..listed.len().saturating_sub(2)).flat_map(|k| each(k).map(|corner| listed[corner])).collect()
        }
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => Vec::new(),
    }
}

/// An upper limit of the number of triangles of a primitive.
pub fn at_most(primitive: &gltf::Primitive) -> usize {
    let places = primitive.get(&gltf::Semantic::Positions);
    let corners = primitive.indices().or(places).map_or(0, |accessor| accessor.count());
    if primitive.mode() == Mode::Triangles { corners / 3 } else { corners.saturating_sub(2) }
}

/// A node's own transform, into its parent's frame.
pub fn local(node: &gltf::Node) -> DMat4 {
    match node.transform() {
        gltf::scene::Transform::Matrix { matrix } => DMat4::from_cols_array_2d(&matrix.map(|c| c.map(f64::from))),
        gltf::scene::Transform::Decomposed { translation, rotation, scale } => DMat4::from_scale_rotation_translation(
            wide(scale),
            DQuat::from_array(rotation.map(f64::from)).normalize(),
            wide(translation),
        ),
    }
}

/// Three numbers of a file, in double precision.
pub fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

/// What the file says about its lengths.
fn own_unit(path: &Path, document: &gltf::Document) -> Result<LengthUnit> {
    let extras = document.as_json().asset.extras.as_ref();
    let said = extras
        .and_then(|raw| serde_json::from_str::<serde_json::Value>(raw.get()).ok())
        .and_then(|v| v.get("unit").cloned());
    match said {
        None => Ok(LengthUnit::Metre),
        Some(unit) => serde_json::from_value(unit.clone())
            .map_err(|_| Error::unexpected(path, "asset.extras.unit", unit, "\"mm\", \"cm\" or \"m\"")),
    }
}

/// The reader's message on one line, without quoting the file's bytes.
fn sentence(e: &gltf::Error) -> String {
    match e {
        gltf::Error::Io(io) => explain(io),
        // One place is enough: a missing list is wrong at each place that names one of its entries.
        gltf::Error::Validation(all) if !all.is_empty() => {
            let (place, what) = &all[0];
            let more = if all.len() > 1 { format!(", and {} more places", all.len() - 1) } else { String::new() };
            format!("not a readable glTF file ({place}: {what}{more})")
        }
        other => format!("not a readable glTF file ({})", other.to_string().lines().collect::<Vec<_>>().join(" ")),
    }
}

/// Refuses a URI that leads out of the file's folder by its text, its scheme or a link.
fn inside(path: &Path, folder: &Path, uri: &str, field: &str) -> Result<()> {
    if uri.starts_with("data:") {
        return Ok(());
    }
    let outside = || {
        Err(Error::field(path, field, format!("\"{uri}\" leads outside the file's folder; expected a file beside it")))
    };
    if uri.contains(':') {
        return outside();
    }
    let decoded = percent_decode(uri);
    let relative = Path::new(&decoded);
    if decoded.contains('\\') || relative.components().any(|c| !matches!(c, Component::Normal(_) | Component::CurDir)) {
        return outside();
    }
    if let (Ok(real), Ok(home)) = (folder.join(relative).canonicalize(), folder.canonicalize())
        && !real.starts_with(home)
    {
        return outside();
    }
    Ok(())
}

fn percent_decode(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let hex = bytes
            .get(i + 1..i + 3)
            .and_then(|h| std::str::from_utf8(h).ok())
            .and_then(|h| u8::from_str_radix(h, 16).ok());
        match (bytes[i], hex) {
            (b'%', Some(value)) => {
                out.push(value);
                i += 3;
            }
            (byte, _) => {
                out.push(byte);
                i += 1;
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}
