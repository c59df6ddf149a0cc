//! Turns normals of the scan into the mesh's tangent frame, texel by texel. Both renderers interpolate mapped normals
//! in that frame, because it bends with the blade.

use crate::leaf_folder::{Result, filling};
use glam::{DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_optics::side::Side;
use std::path::Path;

/// Tangent, image up and normal of the mesh at the centre of every texel of the front's maps; texels off the mesh take
/// their neighbours'.
///
/// # Errors
/// [`crate::leaf_folder::Error::Input`] naming `path` when the mesh covers no texel at all.
pub fn frames(path: &Path, mesh: &LeafMesh, width: usize, height: usize) -> Result<Vec<[DVec3; 3]>> {
    let size = DVec2::new(width as f64, height as f64);
    let mut planes: Vec<Vec<f32>> = vec![vec![f32::NAN; width * height]; 6];
    for t in 0..mesh.triangles() {
        let corner = mesh.triangle(t);
        each_texel(corner.map(|k| mesh.uvs[k] * size - 0.5), width, height, |at, w| {
            let mix = |of: &dyn Fn(usize) -> DVec3| of(corner[0]) * w[0] + of(corner[1]) * w[1] + of(corner[2]) * w[2];
            let normal = mix(&|k| mesh.normals[k]).normalize_or(DVec3::Z);
            let tangent = mix(&|k| mesh.tangents[k].0);
            let tangent = (tangent - normal * normal.dot(tangent)).normalize_or(normal.any_orthonormal_vector());
            for (k, v) in normal.to_array().into_iter().chain(tangent.to_array()).enumerate() {
                planes[k][at] = v as f32;
            }
        });
    }
    let covered: Vec<bool> = planes[0].iter().map(|v| v.is_finite()).collect();
    filling::require(path, &mut planes, &covered, width, height)?;
    // The texture chart of a leaf is nowhere mirrored, so one handedness holds for all of it.
    let hand = mesh.tangents.first().map_or(1.0, |t| t.1);
    Ok((0..width * height)
        .map(|k| {
            let v = |first: usize| {
                DVec3::new(
                    f64::from(planes[first][k]),
                    f64::from(planes[first + 1][k]),
                    f64::from(planes[first + 2][k]),
                )
            };
            let normal = v(0).normalize_or(DVec3::Z);
            let tangent = (v(3) - normal * normal.dot(v(3))).normalize_or(normal.any_orthonormal_vector());
            [tangent, normal.cross(tangent) * hand, normal]
        })
        .collect())
}

/// Texels of the front's maps whose centres lie on the mesh.
pub fn covered(mesh: &LeafMesh, width: usize, height: usize) -> Vec<bool> {
    let size = DVec2::new(width as f64, height as f64);
    let mut out = vec![false; width * height];
    for t in 0..mesh.triangles() {
        each_texel(mesh.triangle(t).map(|k| mesh.uvs[k] * size - 0.5), width, height, |k, _| out[k] = true);
    }
    out
}

/// Calls `found` with every texel whose centre lies in the triangle, and its barycentric weights; corners in texels.
fn each_texel([a, b, c]: [DVec2; 3], width: usize, height: usize, mut found: impl FnMut(usize, [f64; 3])) {
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 {
        return;
    }
    let low = a.min(b).min(c).ceil().max(DVec2::ZERO);
    let high = a.max(b).max(c).floor().min(DVec2::new(width as f64, height as f64) - 1.0);
    for j in low.y as usize..(high.y + 1.0).max(0.0) as usize {
        for i in low.x as usize..(high.x + 1.0).max(0.0) as usize {
            let p = DVec2::new(i as f64, j as f64);
            let weights = [(b - p).perp_dot(c - p), (c - p).perp_dot(a - p), (a - p).perp_dot(b - p)].map(|v| v / area);
            if weights.iter().all(|v| *v >= -1e-9) {
                found(j * width + i, weights);
            }
        }
    }
}

/// One side's normals (x right, y up, z out, as its camera saw the blade) in the mesh's tangent frame as that side sees
/// it.
pub fn tangent_space(normals: &[[f32; 3]], frames: &[[DVec3; 3]], width: usize, side: Side) -> Vec<[f32; 3]> {
    let sign = if side == Side::Back { -1.0 } else { 1.0 };
    normals
        .iter()
        .enumerate()
        .map(|(k, n)| {
            // The blade was turned about y: x and z change sign, and column i of the back is column width − 1 − i of
            // the front.
            let [tangent, up, out] = frames[side.in_front(k, width)];
            let blade = DVec3::new(sign * f64::from(n[0]), f64::from(n[1]), sign * f64::from(n[2]));
            [sign * blade.dot(tangent), blade.dot(up), sign * blade.dot(out)].map(|v| v as f32)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_meshs_own_normal_is_straight_out_on_both_sides() {
        // A tilted plane: its normal as the front's camera sees it, and as the back's does.
        let mut mesh = LeafMesh::rectangle(8.0, 6.0);
        let n = DVec3::new(-0.3, 0.2, 1.0).normalize();
        mesh.normals = vec![n; 4];
        let frames = frames(Path::new("m"), &mesh, 8, 6).unwrap();
        let front = tangent_space(&vec![n.as_vec3().to_array(); 48], &frames, 8, Side::Front);
        let back = tangent_space(&vec![[n.x as f32, -n.y as f32, n.z as f32]; 48], &frames, 8, Side::Back);
        for v in front.iter().chain(&back) {
            assert!(v[0].abs() < 1e-6 && v[1].abs() < 1e-6 && (v[2] - 1.0).abs() < 1e-6, "{v:?}");
        }
        // A bump towards the right of the image is towards the right on both sides.
        let tangent = frames[0][0];
        let bumped = (n + 0.2 * tangent).normalize();
        assert!(tangent_space(&[bumped.as_vec3().to_array()], &frames, 8, Side::Front)[0][0] > 0.15);
        let out = (-n + 0.2 * -tangent).normalize();
        assert!(tangent_space(&[[-out.x as f32, out.y as f32, -out.z as f32]; 8], &frames, 8, Side::Back)[0][0] > 0.15);
    }
}
