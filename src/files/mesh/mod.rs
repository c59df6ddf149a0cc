//! Meshes of leaves from glTF (`.glb`, or `.gltf` with buffers beside it): triangles with normals, tangents and texture
//! coordinates.
//!
//! Lengths are in mm here. A file is in metres, as glTF states, unless its `asset.extras.unit` or the caller says
//! otherwise. The transforms of all nodes of its scene are applied, and all primitives are joined. The frame is the
//! file's own: x to the right, y up, z out of the front; texture (0, 0) is the top left of the front's maps. A
//! triangle that repeats another (the back of a leaf that `export --to gltf` wrote) is dropped, because a leaf is one
//! surface with two sides ([`DuplicateTriangles`]). Normals and tangents are computed where the file has none.
//! Pictures, materials and animation in the file are not read.

mod discs;
mod duplicates;
mod reader;
#[cfg(test)]
mod tests;

pub use discs::read_discs;
pub use duplicates::DuplicateTriangles;
pub use reader::{read, read_plain};

use glam::{DMat4, DVec2, DVec3};

/// A triangle mesh. All lists but `indices` have one entry a vertex; a mesh whose maps hold no normals may have no
/// tangents.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LeafMesh {
    /// mm.
    pub positions: Vec<DVec3>,
    /// Unit, out of the front.
    pub normals: Vec<DVec3>,
    /// Unit tangent along +u, and the handedness ±1: image up = w · normal × tangent.
    pub tangents: Vec<(DVec3, f64)>,
    /// Texture coordinates; (0, 0) is the top left corner of the maps.
    pub uvs: Vec<DVec2>,
    /// Three vertices a triangle, counter-clockwise as seen from the front.
    pub indices: Vec<u32>,
    /// Whether every triangle stands for a disc: an equilateral triangle around the circle of the disc.
    pub discs: bool,
}

impl LeafMesh {
    /// Corners of triangle `t`.
    pub fn triangle(&self, t: usize) -> [usize; 3] {
        [0, 1, 2].map(|k| self.indices[3 * t + k] as usize)
    }

    /// How many triangles it has.
    pub fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    /// Adds another mesh after turning, moving and evenly scaling it by `frame`.
    pub fn append(&mut self, other: &LeafMesh, frame: DMat4) {
        let first = self.positions.len() as u32;
        let turned = |v: DVec3| frame.transform_vector3(v).normalize_or_zero();
        self.positions.extend(other.positions.iter().map(|p| frame.transform_point3(*p)));
        self.normals.extend(other.normals.iter().map(|n| turned(*n)));
        self.tangents.extend(other.tangents.iter().map(|(t, w)| (turned(*t), *w)));
        self.uvs.extend(other.uvs.iter().copied());
        self.indices.extend(other.indices.iter().map(|i| i + first));
    }

    /// Lowest and highest corner of the box around every vertex; `None` without vertices.
    pub fn extent(&self) -> Option<[DVec3; 2]> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold([first; 2], |[low, high], p| [low.min(*p), high.max(*p)]))
    }

    /// Centre and radius of a sphere around every vertex.
    pub fn bounds(&self) -> (DVec3, f64) {
        let [low, high] = self.extent().unwrap_or([DVec3::INFINITY, DVec3::NEG_INFINITY]);
        let centre = (low + high) / 2.0;
        (centre, self.positions.iter().map(|p| p.distance(centre)).fold(0.0, f64::max))
    }

    /// A flat rectangle in the xy plane, front up, with texture coordinates that cover the maps.
    pub fn rectangle(width_mm: f64, height_mm: f64) -> LeafMesh {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        LeafMesh {
            positions: corners
                .iter()
                .map(|&(u, v)| DVec3::new((u - 0.5) * width_mm, (0.5 - v) * height_mm, 0.0))
                .collect(),
            normals: vec![DVec3::Z; 4],
            tangents: vec![(DVec3::X, 1.0); 4],
            uvs: corners.iter().map(|&(u, v)| DVec2::new(u, v)).collect(),
            indices: vec![0, 3, 2, 0, 2, 1],
            discs: false,
        }
    }
}

/// Area-weighted mean of the normals of the facets around each vertex.
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

/// Direction of growing u on the surface, made orthogonal to the normal; the sign turns normal × tangent towards the
/// image's top (falling v).
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
        // The area's weight has the texture's sign only: sign(det) keeps mirrored charts right.
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
