//! Reads a leaf's mesh from glTF: node transforms and primitives of a file that [`gltf_file`] opened.

use super::{DuplicateTriangles, LeafMesh, vertex_normals, vertex_tangents};
use crate::gltf_file::{self, DEEPEST, GltfDocument, GltfPrimitive, MOST_TRIANGLES, wide};
use crate::unit::LengthUnit;
use crate::{Error, Result};
use glam::{DMat4, DVec2, DVec3};
use std::path::Path;

/// Reads a glTF file whose lengths are in `unit`. Where none is given, the file's own unit is used: the metre, unless
/// its `asset.extras.unit` says "mm", "cm" or "m".
///
/// # Errors
/// [`Error::Input`] naming the file: missing, damaged, a path outside its folder, no triangles, no texture coordinates.
pub fn read(path: &Path, unit: Option<LengthUnit>) -> Result<LeafMesh> {
    read_as(path, unit, true)
}

/// As [`read`], of a leaf without maps: texture coordinates may be missing, and a primitive without normals is flat
/// (glTF 2.0, §3.7.2.1).
///
/// # Errors
/// As [`read`].
pub fn read_plain(path: &Path, unit: Option<LengthUnit>) -> Result<LeafMesh> {
    read_as(path, unit, false)
}

fn read_as(path: &Path, unit: Option<LengthUnit>, maps: bool) -> Result<LeafMesh> {
    gltf_file::read(path, &[], |opened| joined(path, &opened, unit, maps))
}

fn joined(path: &Path, opened: &GltfDocument, unit: Option<LengthUnit>, maps: bool) -> Result<LeafMesh> {
    let GltfDocument { document, buffers, unit: own, .. } = opened;
    let to_mm = DMat4::from_scale(DVec3::splat(unit.unwrap_or(*own).mm()));
    let mut mesh = LeafMesh::default();
    let mut given = Given { maps, normals: true, tangents: true, doubled: DuplicateTriangles::default() };
    match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => {
            for node in scene.nodes() {
                add_node(path, &node, to_mm, opened, &mut mesh, &mut given, 0)?;
            }
        }
        None => {
            for part in document.meshes() {
                add_mesh(path, &part, to_mm, buffers, &mut mesh, &mut given)?;
            }
        }
    }
    if mesh.indices.is_empty() {
        return Err(Error::input(path, "found no triangles, expected a leaf's mesh"));
    }
    if !maps {
        return Ok(mesh);
    }
    if !given.normals {
        mesh.normals = vertex_normals(&mesh);
    }
    if !given.tangents || !given.normals {
        mesh.tangents = vertex_tangents(&mesh);
    }
    Ok(mesh)
}

/// What the primitives so far contained.
struct Given {
    /// Whether the leaf has maps, which need texture coordinates.
    maps: bool,
    /// Whether all of them had normals.
    normals: bool,
    tangents: bool,
    /// Their triangles.
    doubled: DuplicateTriangles,
}

fn add_node(
    path: &Path,
    node: &gltf::Node,
    parent: DMat4,
    opened: &GltfDocument,
    out: &mut LeafMesh,
    given: &mut Given,
    depth: usize,
) -> Result<()> {
    if depth > DEEPEST {
        return Err(Error::field(path, "nodes", format!("nested more than {DEEPEST} deep")));
    }
    let world = parent * gltf_file::local(node);
    if !world.is_finite() {
        return Err(Error::field(path, &format!("nodes[{}]", node.index()), "its transform is not finite"));
    }
    if let Some(mesh) = node.mesh() {
        for (_, place) in gltf_file::places(path, opened, node)? {
            add_mesh(path, &mesh, world * place, &opened.buffers, out, given)?;
        }
    }
    for child in node.children() {
        add_node(path, &child, world, opened, out, given, depth + 1)?;
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
        let GltfPrimitive { positions, indices } = gltf_file::surface(path, &field, &primitive, buffers)?;
        if indices.is_empty() {
            continue;
        }
        let total = (out.indices.len() + indices.len()) / 3;
        if total > MOST_TRIANGLES {
            let found = format!("{total} triangles so far");
            return Err(Error::unexpected(path, &field, found, format!("at most {MOST_TRIANGLES}")));
        }
        let reader = primitive.reader(|b| buffers.get(b.index()).map(|d| d.0.as_slice()));
        let missing =
            |what: &str| Error::field(path, &format!("{field}.{what}"), "missing or out of the buffer's range");
        let uvs: Vec<DVec2> = match reader.read_tex_coords(0) {
            Some(list) => list.into_f32().map(|[u, v]| DVec2::new(f64::from(u), f64::from(v))).collect(),
            None if given.maps => return Err(missing("TEXCOORD_0")),
            None => vec![DVec2::ZERO; positions.len()],
        };
        let n = positions.len();
        // Normals are transformed by the inverse transpose; a mirrored node also reverses the winding.
        let normal_matrix = world.inverse().transpose();
        let mirrored = world.determinant() < 0.0;
        let normals: Vec<DVec3> = match reader.read_normals() {
            Some(list) => list.map(|v| normal_matrix.transform_vector3(wide(v)).normalize_or_zero()).collect(),
            None => {
                given.normals = false;
                vec![DVec3::Z; n]
            }
        };
        let tangents: Vec<(DVec3, f64)> = match reader.read_tangents() {
            Some(list) => list
                .map(|[x, y, z, w]| {
                    let flip = if mirrored { -1.0 } else { 1.0 };
                    (world.transform_vector3(wide([x, y, z])).normalize_or_zero(), f64::from(w).signum() * flip)
                })
                .collect(),
            None => {
                given.tangents = false;
                vec![(DVec3::X, 1.0); n]
            }
        };
        for (what, len) in [("TEXCOORD_0", uvs.len()), ("NORMAL", normals.len()), ("TANGENT", tangents.len())] {
            if len != n {
                return Err(Error::unexpected(
                    path,
                    &format!("{field}.{what}"),
                    format!("{len} entries"),
                    format!("{n} as of POSITION"),
                ));
            }
        }
        if uvs.iter().any(|t| !t.is_finite()) || normals.iter().any(|v| !v.is_finite()) {
            return Err(Error::field(path, &field, "found a vertex that is not finite"));
        }
        let placed: Vec<DVec3> = positions.iter().map(|p| world.transform_point3(*p)).collect();
        let order = |t: &[u32]| if mirrored { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] };
        let triangles: Vec<[u32; 3]> = indices.chunks_exact(3).map(order).collect();
        let before = triangles.len();
        let triangles: Vec<[u32; 3]> =
            triangles.into_iter().filter(|t| !given.doubled.again(t.map(|k| placed[k as usize]))).collect();
        if before > 0 && triangles.is_empty() {
            continue;
        }
        let base = out.positions.len() as u32;
        if !given.maps && reader.read_normals().is_none() {
            for corners in triangles.iter().map(|t| t.map(|k| k as usize)) {
                let [a, b, c] = corners.map(|k| placed[k]);
                let flat = (b - a).cross(c - a).normalize_or(DVec3::Z);
                out.indices.extend([0, 1, 2].map(|k| k + out.positions.len() as u32));
                out.positions.extend([a, b, c]);
                out.normals.extend([flat; 3]);
                out.tangents.extend([(DVec3::X, 1.0); 3]);
                out.uvs.extend(corners.map(|k| uvs[k]));
            }
            continue;
        }
        out.positions.extend(placed);
        out.normals.extend(normals);
        out.tangents.extend(tangents);
        out.uvs.extend(uvs);
        out.indices.extend(triangles.iter().flatten().map(|i| i + base));
    }
    Ok(())
}
