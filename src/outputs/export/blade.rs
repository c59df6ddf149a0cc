//! The blade's mesh as other programs take it: positions in mm, normals out of the front, (0, 0) the top left corner of
//! the front's maps.

use glam::{DMat3, DMat4, DVec3};
use mesophyll_files::mesh::{self, LeafMesh};
use mesophyll_transport::world::ReferenceInterior;

/// The thickness (mm) of a leaf of which none is known. Most blades are thicker, and it is more than ten times the
/// rounding of a place in single precision 100 m from the origin.
pub const THICKNESS_MM: f64 = 0.1;

/// The mean thickness (mm) of the inside of a leaf.
pub fn thickness_mm(interior: &ReferenceInterior) -> f64 {
    let ReferenceInterior::Scalars { thickness, .. } = interior else { return THICKNESS_MM };
    let mean = thickness.iter().map(|h| f64::from(*h)).sum::<f64>() / thickness.len().max(1) as f64;
    if mean > 0.0 { mean } else { THICKNESS_MM }
}

/// Places `distance` out of a surface, on the side from which its triangles wind counterclockwise. The normals that a
/// file states do not count: those of a crown may be bent for the light, and point out of the wrong side.
pub fn raised(positions: &[DVec3], indices: &[u32], distance: f64) -> Vec<[f32; 3]> {
    let surface = LeafMesh { positions: positions.to_vec(), indices: indices.to_vec(), ..LeafMesh::default() };
    let out = mesh::vertex_normals(&surface);
    positions.iter().zip(out).map(|(place, out)| (*place + out * distance).as_vec3().to_array()).collect()
}

/// Triangles with one entry a vertex in every list but `indices`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ExportMesh {
    /// Places (mm).
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, out of the front.
    pub normals: Vec<[f32; 3]>,
    /// xyz along +u, w the handedness.
    pub tangents: Vec<[f32; 4]>,
    /// Texture coordinates; (0, 0) is the top left corner of the front's maps.
    pub uvs: Vec<[f32; 2]>,
    /// Three vertices a triangle.
    pub indices: Vec<u32>,
}

impl ExportMesh {
    /// The mesh in single precision.
    pub fn of(read: &LeafMesh) -> ExportMesh {
        ExportMesh {
            positions: read.positions.iter().map(|p| p.as_vec3().to_array()).collect(),
            normals: read.normals.iter().map(|n| n.as_vec3().to_array()).collect(),
            tangents: read.tangents.iter().map(|(t, w)| t.as_vec3().extend(*w as f32).to_array()).collect(),
            uvs: read.uvs.iter().map(|t| t.as_vec2().to_array()).collect(),
            indices: read.indices.clone(),
        }
    }

    /// The mesh at several places, as one mesh.
    pub fn gathered(&self, places: &[DMat4]) -> ExportMesh {
        let mut out = ExportMesh::default();
        for place in places {
            let (first, turn) = (out.positions.len() as u32, DMat3::from_mat4(*place));
            let mirrored = turn.determinant() < 0.0;
            let point = |p: &[f32; 3]| place.transform_point3(DVec3::from(p.map(f64::from))).as_vec3().to_array();
            let turned = |v: [f32; 3]| (turn * DVec3::from(v.map(f64::from))).normalize_or_zero().as_vec3();
            let hand = if mirrored { -1.0 } else { 1.0 };
            out.positions.extend(self.positions.iter().map(point));
            out.normals.extend(self.normals.iter().map(|n| turned(*n).to_array()));
            out.tangents
                .extend(self.tangents.iter().map(|[x, y, z, w]| turned([*x, *y, *z]).extend(hand * w).to_array()));
            out.uvs.extend_from_slice(&self.uvs);
            // A mirror reverses the order in which a triangle's corners run.
            let corners = |t: &[u32]| if mirrored { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] };
            out.indices.extend(self.indices.chunks_exact(3).flat_map(corners).map(|k| first + k));
        }
        out
    }

    /// The surface, `distance` out of the side from which its triangles wind counterclockwise.
    pub fn raised(self, distance: f64) -> ExportMesh {
        let places: Vec<DVec3> = self.positions.iter().map(|p| DVec3::from(p.map(f64::from))).collect();
        ExportMesh { positions: raised(&places, &self.indices, distance), ..self }
    }

    /// The same surface seen from behind: the winding of triangles is reversed, normals are turned, and tangents still
    /// point along +u.
    pub fn turned(&self) -> ExportMesh {
        ExportMesh {
            positions: self.positions.clone(),
            normals: self.normals.iter().map(|n| n.map(|v| -v)).collect(),
            // bitangent = w · normal × tangent stays where it was
            tangents: self.tangents.iter().map(|t| [t[0], t[1], t[2], -t[3]]).collect(),
            uvs: self.uvs.clone(),
            indices: self.indices.chunks_exact(3).flat_map(|t| [t[0], t[2], t[1]]).collect(),
        }
    }
}
