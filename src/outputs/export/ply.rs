//! Meshes as binary PLY, which Mitsuba and pbrt read: x y z nx ny nz u v as floats, triangles as lists of ints.

use crate::Result;
use crate::blade::ExportMesh;
use mesophyll_files::atomic;
use std::path::Path;

/// Writes a mesh. v is 0 at the top of the pictures, or with `upward` at their bottom.
///
/// # Errors
/// [`crate::Error::Write`].
pub fn write(mesh: &ExportMesh, path: &Path, upward: bool) -> Result<()> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment mesophyll, lengths in mm\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\n\
         property float nz\nproperty float u\nproperty float v\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.indices.len() / 3
    )
    .into_bytes();
    for ((p, n), t) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.uvs) {
        let t = [t[0], if upward { 1.0 - t[1] } else { t[1] }];
        bytes.extend(p.iter().chain(n).chain(&t).flat_map(|v| v.to_le_bytes()));
    }
    for t in mesh.indices.chunks_exact(3) {
        bytes.push(3);
        bytes.extend(t.iter().flat_map(|i| i.to_le_bytes()));
    }
    atomic::write_bytes(path, &bytes)
}
