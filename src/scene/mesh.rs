//! Leaf meshes from glTF (`.glb`, or `.gltf` with buffers beside it): triangles with normals, tangents and texture coordinates.
//!
//! Numbers are taken as mm: x to the right, y up, z out of the front; texture (0, 0) is the top left of the front's maps. The node
//! transforms are applied and all primitives joined. Normals and tangents are computed where the file has none. Pictures, materials
//! and animation in the file are not read.

use crate::files::atomic::explain;
use crate::{Error, Result};
use glam::{DMat4, DVec2, DVec3};
use gltf::mesh::Mode;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Component, Path};

/// A triangle mesh. All lists but `indices` have one entry a vertex.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LeafMesh {
    /// mm.
    pub positions: Vec<DVec3>,
    /// Unit, out of the front.
    pub normals: Vec<DVec3>,
    /// Unit, along +u, and the handedness ±1: image up = w · normal × tangent.
    pub tangents: Vec<(DVec3, f64)>,
    pub uvs: Vec<DVec2>,
    pub indices: Vec<u32>,
}

impl LeafMesh {
    /// Corners of triangle `t`.
    pub fn triangle(&self, t: usize) -> [usize; 3] {
        [0, 1, 2].map(|k| self.indices[3 * t + k] as usize)
    }

    pub fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    /// Centre and radius of a sphere around every vertex.
    pub fn bounds(&self) -> (DVec3, f64) {
        let (low, high) =
            self.positions.iter().fold((DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)), |(a, b), p| (a.min(*p), b.max(*p)));
        let centre = (low + high) / 2.0;
        (centre, self.positions.iter().map(|p| p.distance(centre)).fold(0.0, f64::max))
    }

    /// A flat rectangle in the xy plane, front up, with texture coordinates that cover the maps.
    pub fn rectangle(width_mm: f64, height_mm: f64) -> LeafMesh {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        LeafMesh {
            positions: corners.iter().map(|&(u, v)| DVec3::new((u - 0.5) * width_mm, (0.5 - v) * height_mm, 0.0)).collect(),
            normals: vec![DVec3::Z; 4],
            tangents: vec![(DVec3::X, 1.0); 4],
            uvs: corners.iter().map(|&(u, v)| DVec2::new(u, v)).collect(),
            indices: vec![0, 3, 2, 0, 2, 1],
        }
    }
}

/// Reads a glTF file.
///
/// # Errors
/// [`Error::Input`] naming the file: missing, damaged, a path outside its folder, no triangles, no texture coordinates.
pub fn read(path: &Path) -> Result<LeafMesh> {
    let bytes = std::fs::read(path).map_err(|e| Error::input(path, explain(&e)))?;
    // A damaged file must end in a sentence, whatever the reader does with it.
    catch_unwind(AssertUnwindSafe(|| parse(path, &bytes))).unwrap_or_else(|_| Err(Error::input(path, "not a readable glTF file (damaged)")))
}

fn parse(path: &Path, bytes: &[u8]) -> Result<LeafMesh> {
    let gltf::Gltf { document, mut blob } = gltf::Gltf::from_slice(bytes).map_err(|e| Error::input(path, sentence(&e)))?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for image in document.images() {
        if let gltf::image::Source::Uri { uri, .. } = image.source() {
            inside(path, folder, uri, &format!("images[{}].uri", image.index()))?;
        }
    }
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let field = format!("buffers[{}]", buffer.index());
        if let gltf::buffer::Source::Uri(uri) = buffer.source() {
            inside(path, folder, uri, &format!("{field}.uri"))?;
        }
        let data = gltf::buffer::Data::from_source_and_blob(buffer.source(), Some(folder), &mut blob)
            .map_err(|e| Error::field(path, &field, sentence(&e)))?;
        if data.len() < buffer.length() {
            return Err(Error::field(path, &field, format!("found {} bytes, expected {} (truncated?)", data.len(), buffer.length())));
        }
        buffers.push(data);
    }
    let mut mesh = LeafMesh::default();
    let mut given = Given { normals: true, tangents: true };
    match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => {
            for node in scene.nodes() {
                add_node(path, &node, DMat4::IDENTITY, &buffers, &mut mesh, &mut given, 0)?;
            }
        }
        None => {
            for part in document.meshes() {
                add_mesh(path, &part, DMat4::IDENTITY, &buffers, &mut mesh, &mut given)?;
            }
        }
    }
    if mesh.indices.is_empty() {
        return Err(Error::input(path, "found no triangles, expected a leaf's mesh"));
    }
    if !given.normals {
        mesh.normals = vertex_normals(&mesh);
    }
    if !given.tangents || !given.normals {
        mesh.tangents = vertex_tangents(&mesh);
    }
    Ok(mesh)
}

/// The reader's message on one line, without quoting the file's bytes.
fn sentence(e: &gltf::Error) -> String {
    match e {
        gltf::Error::Io(io) => explain(io),
        other => format!("not a readable glTF file ({})", other.to_string().lines().collect::<Vec<_>>().join(" ")),
    }
}

/// Refuses a URI that leads out of the file's folder, by text, by scheme or by a link.
fn inside(path: &Path, folder: &Path, uri: &str, field: &str) -> Result<()> {
    if uri.starts_with("data:") {
        return Ok(());
    }
    let outside = || Err(Error::field(path, field, format!("\"{uri}\" leads outside the file's folder; expected a file beside it")));
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
        let hex = bytes.get(i + 1..i + 3).and_then(|h| std::str::from_utf8(h).ok()).and_then(|h| u8::from_str_radix(h, 16).ok());
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

/// Whether every primitive so far brought its own.
struct Given {
    normals: bool,
    tangents: bool,
}

/// Deeper nests of nodes than this are taken for a cycle.
const DEEPEST: usize = 64;

fn add_node(
    path: &Path,
    node: &gltf::Node,
    parent: DMat4,
    buffers: &[gltf::buffer::Data],
    out: &mut LeafMesh,
    given: &mut Given,
    depth: usize,
) -> Result<()> {
    if depth > DEEPEST {
        return Err(Error::field(path, "nodes", format!("nested more than {DEEPEST} deep")));
    }
    let local = DMat4::from_cols_array(
        &node.transform().matrix().as_flattened().iter().map(|v| f64::from(*v)).collect::<Vec<_>>().try_into().unwrap_or([0.0; 16]),
    );
    let world = parent * local;
    if let Some(mesh) = node.mesh() {
        add_mesh(path, &mesh, world, buffers, out, given)?;
    }
    for child in node.children() {
        add_node(path, &child, world, buffers, out, given, depth + 1)?;
    }
    Ok(())
}

fn add_mesh(
    path: &Path,
    mesh: &gltf::Mesh,
    world: DMat4,
    buffers: &[gltf::buffer::Data],
    out: &mut LeafMesh,
    given: &mut Given,
) -> Result<()> {
    for primitive in mesh.primitives() {
        let field = format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
        if primitive.mode() != Mode::Triangles {
            return Err(Error::field(path, &field, format!("found {:?}, expected triangles", primitive.mode())));
        }
        let reader = primitive.reader(|b| buffers.get(b.index()).map(|d| d.0.as_slice()));
        let missing = |what: &str| Error::field(path, &format!("{field}.{what}"), "missing or out of the buffer's range");
        let positions: Vec<DVec3> = reader.read_positions().ok_or_else(|| missing("POSITION"))?.map(to_f64).collect();
        let uvs: Vec<DVec2> = match reader.read_tex_coords(0) {
            Some(list) => list.into_f32().map(|[u, v]| DVec2::new(f64::from(u), f64::from(v))).collect(),
            None => return Err(missing("TEXCOORD_0")),
        };
        let n = positions.len();
        let indices: Vec<u32> = match (primitive.indices(), reader.read_indices()) {
            (Some(_), Some(list)) => list.into_u32().collect(),
            (Some(_), None) => return Err(missing("indices")),
            (None, _) => (0..n as u32).collect(),
        };
        // Normals turn with the inverse transpose; a mirrored node also flips the winding.
        let normal_matrix = world.inverse().transpose();
        let mirrored = world.determinant() < 0.0;
        let normals: Vec<DVec3> = match reader.read_normals() {
            Some(list) => list.map(|v| normal_matrix.transform_vector3(to_f64(v)).normalize_or_zero()).collect(),
            None => {
                given.normals = false;
                vec![DVec3::Z; n]
            }
        };
        let tangents: Vec<(DVec3, f64)> = match reader.read_tangents() {
            Some(list) => list
                .map(|[x, y, z, w]| {
                    let flip = if mirrored { -1.0 } else { 1.0 };
                    (world.transform_vector3(to_f64([x, y, z])).normalize_or_zero(), f64::from(w).signum() * flip)
                })
                .collect(),
            None => {
                given.tangents = false;
                vec![(DVec3::X, 1.0); n]
            }
        };
        for (what, len) in [("TEXCOORD_0", uvs.len()), ("NORMAL", normals.len()), ("TANGENT", tangents.len())] {
            if len != n {
                return Err(Error::field(path, &format!("{field}.{what}"), format!("found {len} entries, expected {n} as of POSITION")));
            }
        }
        if let Some(bad) = indices.iter().find(|&&i| i as usize >= n) {
            return Err(Error::field(path, &format!("{field}.indices"), format!("found {bad}, expected less than the {n} vertices")));
        }
        if !indices.len().is_multiple_of(3) {
            return Err(Error::field(
                path,
                &format!("{field}.indices"),
                format!("found {} entries, expected whole triangles", indices.len()),
            ));
        }
        if positions.iter().any(|p| !p.is_finite()) || uvs.iter().any(|t| !t.is_finite()) || normals.iter().any(|v| !v.is_finite()) {
            return Err(Error::field(path, &field, "found a vertex that is not finite"));
        }
        let base = out.positions.len() as u32;
        out.positions.extend(positions.iter().map(|p| world.transform_point3(*p)));
        out.normals.extend(normals);
        out.tangents.extend(tangents);
        out.uvs.extend(uvs);
        for t in indices.chunks_exact(3) {
            let order = if mirrored { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] };
            out.indices.extend(order.map(|i| i + base));
        }
    }
    Ok(())
}

fn to_f64(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

/// Area-weighted mean of the facets around each vertex.
pub fn vertex_normals(mesh: &LeafMesh) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for t in 0..mesh.triangles() {
        let [a, b, c] = mesh.triangle(t);
        let n = (mesh.positions[b] - mesh.positions[a]).cross(mesh.positions[c] - mesh.positions[a]);
        for k in [a, b, c] {
            sums[k] += n;
        }
    }
    sums.into_iter().map(|n| n.try_normalize().unwrap_or(DVec3::Z)).collect()
}

/// Direction of growing u on the surface, made orthogonal to the normal; the sign turns normal × tangent towards the image's top
/// (falling v).
pub fn vertex_tangents(mesh: &LeafMesh) -> Vec<(DVec3, f64)> {
    let mut along_u = vec![DVec3::ZERO; mesh.positions.len()];
    let mut up = vec![DVec3::ZERO; mesh.positions.len()];
    for t in 0..mesh.triangles() {
        let [a, b, c] = mesh.triangle(t);
        let (e1, e2) = (mesh.positions[b] - mesh.positions[a], mesh.positions[c] - mesh.positions[a]);
        let (d1, d2) = (mesh.uvs[b] - mesh.uvs[a], mesh.uvs[c] - mesh.uvs[a]);
        let det = d1.x * d2.y - d2.x * d1.y;
        if det == 0.0 {
            continue;
        }
        // Weighted by area in the texture's sign only: sign(det) keeps mirrored charts right.
        let (du, dv) = ((e1 * d2.y - e2 * d1.y) * det.signum(), (e2 * d1.x - e1 * d2.x) * det.signum());
        for k in [a, b, c] {
            along_u[k] += du;
            up[k] -= dv;
        }
    }
    mesh.normals
        .iter()
        .zip(along_u.iter().zip(&up))
        .map(|(n, (t, b))| {
            let tangent = (*t - *n * n.dot(*t)).try_normalize().unwrap_or_else(|| n.any_orthonormal_vector());
            (tangent, if n.cross(tangent).dot(*b) < 0.0 { -1.0 } else { 1.0 })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
                    r#"{{"bufferView":{},"componentType":5126,"count":{},"type":"{kind}","min":[-100,-100,-100],"max":[100,100,100]}}"#,
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
        let mesh = read(&write(dir.path(), &json, &bytes)).unwrap();
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
        for uri in ["../secret.bin", "/etc/passwd", "file:///etc/passwd", "%2e%2e/secret.bin", "a/../../secret.bin", "..\\\\secret.bin"] {
            let (json, bytes, _) = dome_json(&["POSITION", "NORMAL", "TEXCOORD_0"], Some(uri));
            std::fs::write(dir.path().join("secret.bin"), &bytes).unwrap();
            let e = read(&write(&home, &json, &bytes)).unwrap_err();
            assert_eq!(e.exit_code(), 2);
            assert!(e.to_string().contains("buffers[0].uri") && e.to_string().contains("outside the file's folder"), "{e}");
        }
        #[cfg(unix)]
        {
            let (json, bytes, _) = dome_json(&["POSITION", "NORMAL", "TEXCOORD_0"], Some("link.bin"));
            std::os::unix::fs::symlink(dir.path().join("secret.bin"), home.join("link.bin")).unwrap();
            assert!(read(&write(&home, &json, &bytes)).unwrap_err().to_string().contains("outside"));
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
            let e = read(&write(dir.path(), &j, &b)).unwrap_err();
            assert!(e.exit_code() == 2 && e.to_string().contains("leaf.gltf"), "{e}");
        }
        // An index past the last vertex.
        let (json, mut bytes, _) = dome_json(&["POSITION", "NORMAL", "TEXCOORD_0"], Some("leaf.bin"));
        let end = bytes.len();
        bytes[end - 4..].copy_from_slice(&4000u32.to_le_bytes());
        assert!(read(&write(dir.path(), &json, &bytes)).unwrap_err().to_string().contains("found 4000"));
    }
}
