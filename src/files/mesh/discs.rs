//! Discs from a plain list of numbers, the form of canopies in remote sensing.

use super::LeafMesh;
use crate::unit::LengthUnit;
use crate::{Error, Result, numbers};
use glam::{DVec2, DVec3};
use std::path::Path;

/// Reads a list of discs, one a line: radius, centre x y z, normal x y z. In the mesh, each disc becomes the
/// equilateral triangle whose inscribed circle is the disc.
///
/// # Errors
/// [`Error::Input`] naming the file and the line or the disc: not seven numbers, a radius that is not positive, no
/// direction.
pub fn read_discs(path: &Path, unit: LengthUnit) -> Result<LeafMesh> {
    let mut out = LeafMesh { discs: true, ..LeafMesh::default() };
    for (k, [radius, x, y, z, u, v, w]) in
        numbers::read(path, "radius, centre x y z, normal x y z")?.into_iter().enumerate()
    {
        let normal = DVec3::new(u, v, w).normalize_or_zero();
        if !(radius > 0.0) || normal == DVec3::ZERO {
            let what = format!(
                "disc {}: radius {radius}, normal {u} {v} {w}; expected a radius above 0 and a direction",
                k + 1
            );
            return Err(Error::input(path, what));
        }
        let (a, b) = normal.any_orthonormal_pair();
        let centre = DVec3::new(x, y, z) * unit.mm();
        for corner in 0..3 {
            // Corners are two radii away, so that the circle that touches the sides has the disc's radius.
            let (sin, cos) = (std::f64::consts::TAU * f64::from(corner) / 3.0).sin_cos();
            out.indices.push(out.positions.len() as u32);
            out.positions.push(centre + (a * cos + b * sin) * (2.0 * radius * unit.mm()));
            out.normals.push(normal);
            out.tangents.push((a, 1.0));
            out.uvs.push(DVec2::ZERO);
        }
    }
    Ok(out)
}
