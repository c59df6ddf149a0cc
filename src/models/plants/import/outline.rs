//! Blades that are cards with a picture, cut along the outline of what the picture shows.

use glam::{DVec2, DVec3};
use mesophyll_files::gltf_file::AlphaMask;
use mesophyll_files::mesh::{LeafMesh, vertex_tangents};
use std::collections::HashMap;

/// The most parts into which a triangle's sides are divided.
const FINEST: usize = 16;
/// The most triangles of all shapes together, and of all blades of a plant.
const MOST: [usize; 2] = [300_000, 3_000_000];

/// Into how many parts the sides of triangles may be divided, for shapes of so many triangles that so many leaves have.
/// 1 where there are too many for any outline.
pub(super) fn fineness(shapes: impl Iterator<Item = (usize, usize)>) -> usize {
    let [own, drawn] =
        shapes.fold([0, 0], |[own, drawn], (triangles, leaves)| [own + triangles, drawn + triangles * leaves]);
    let share = (MOST[0] as f64 / own.max(1) as f64).min(MOST[1] as f64 / drawn.max(1) as f64);
    (share.sqrt() as usize).clamp(1, FINEST)
}

/// A corner, and how much more opaque than the limit the picture is there.
type Corner = (DVec3, DVec3, DVec2, f64);

fn between(a: Corner, b: Corner, t: f64) -> (DVec3, DVec3, DVec2) {
    (a.0.lerp(b.0, t), a.1.lerp(b.1, t), a.2.lerp(b.2, t))
}

/// Where between two corners, one of which is opaque, the mask's limit lies. Opacity changes within a few texels, which
/// are smaller than the parts of a triangle, so that it is looked for by halves.
fn crossing(a: Corner, b: Corner, mask: &AlphaMask) -> f64 {
    let [mut low, mut high] = [0.0, 1.0];
    for _ in 0..8 {
        let middle = 0.5 * (low + high);
        let there = mask.at(a.2.lerp(b.2, middle).to_array()) >= 0.0;
        if there == (a.3 >= 0.0) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The part of a mesh where a mask is opaque, or `None` where that is nothing. Each triangle is divided into `fine`²
/// parts, which the outline crosses along straight lines.
pub(super) fn cut(mesh: &LeafMesh, mask: &AlphaMask, fine: usize) -> Option<LeafMesh> {
    let mut out = LeafMesh::default();
    for t in 0..mesh.triangles() {
        let [a, b, c] = mesh.triangle(t);
        let corner = |i: usize, j: usize| -> Corner {
            let (v, w) = (i as f64 / fine as f64, j as f64 / fine as f64);
            let mix = |x: DVec3, y: DVec3, z: DVec3| x * (1.0 - v - w) + y * v + z * w;
            let uv = mesh.uvs[a] * (1.0 - v - w) + mesh.uvs[b] * v + mesh.uvs[c] * w;
            let place = mix(mesh.positions[a], mesh.positions[b], mesh.positions[c]);
            (place, mix(mesh.normals[a], mesh.normals[b], mesh.normals[c]), uv, mask.at(uv.to_array()))
        };
        // Corners and crossings of sides by their numbers in the grid, so that neighbours share them.
        let mut known: HashMap<[(usize, usize); 2], u32> = HashMap::new();
        let mut part = |three: [(usize, usize); 3]| {
            let corners = three.map(|(i, j)| corner(i, j));
            let mut outline = Vec::with_capacity(4);
            for k in 0..3 {
                let (from, to) = (k, (k + 1) % 3);
                let (p, q) = (corners[from], corners[to]);
                let mut add = |key: [(usize, usize); 2], (place, normal, uv): (DVec3, DVec3, DVec2)| {
                    outline.push(*known.entry(key).or_insert_with(|| {
                        out.positions.push(place);
                        out.normals.push(normal.normalize_or(DVec3::Z));
                        out.uvs.push(uv);
                        out.positions.len() as u32 - 1
                    }));
                };
                if p.3 >= 0.0 {
                    add([three[from]; 2], (p.0, p.1, p.2));
                }
                if (p.3 >= 0.0) != (q.3 >= 0.0) {
                    let key = [three[from].min(three[to]), three[from].max(three[to])];
                    add(key, between(p, q, crossing(p, q, mask)));
                }
            }
            for k in 2..outline.len() {
                out.indices.extend([outline[0], outline[k - 1], outline[k]]);
            }
        };
        for (i, j) in (0..fine).flat_map(|i| (0..fine - i).map(move |j| (i, j))) {
            part([(i, j), (i + 1, j), (i, j + 1)]);
            if i + j + 2 <= fine {
                part([(i + 1, j), (i + 1, j + 1), (i, j + 1)]);
            }
        }
    }
    if out.indices.is_empty() {
        return None;
    }
    out.tangents = vertex_tangents(&out);
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc of .4 of the picture's width, on a card of 80 × 60 mm: an ellipse of known area.
    #[test]
    fn a_card_becomes_what_its_picture_shows() {
        let n = 64;
        let alpha = |k: usize| {
            let [x, y] = [k % n, k / n].map(|v| (v as f64 + 0.5) / n as f64 - 0.5);
            // The opacity falls over two texels, as in pictures of leaves.
            (255.0 * (0.5 + (0.4 - x.hypot(y)) * n as f64 / 2.0).clamp(0.0, 1.0)) as u8
        };
        let mask = AlphaMask::new([n, n], (0..n * n).map(alpha).collect(), 0.5);
        let card = LeafMesh::rectangle(80.0, 60.0);
        let leaf = cut(&card, &mask, FINEST).unwrap();
        let area: f64 = (0..leaf.triangles())
            .map(|t| {
                let [a, b, c] = leaf.triangle(t).map(|k| leaf.positions[k]);
                let facing = (b - a).cross(c - a).z;
                assert!(facing > -1e-9, "triangle {t} faces the back");
                0.5 * facing
            })
            .sum();
        let ellipse = std::f64::consts::PI * 32.0 * 24.0;
        assert!((area / ellipse - 1.0).abs() < 0.02, "{area} {ellipse}");
        let rim = leaf.positions.iter().map(|p| (p.x / 32.0).hypot(p.y / 24.0)).fold(0.0, f64::max);
        assert!((rim - 1.0).abs() < 0.05, "{rim}");
        for (p, uv) in leaf.positions.iter().zip(&leaf.uvs) {
            assert!((uv.x - 0.5 - p.x / 80.0).abs() < 1e-9 && (0.5 - uv.y - p.y / 60.0).abs() < 1e-9);
        }
        assert!(cut(&card, &AlphaMask::new([1, 1], vec![0], 0.5), 4).is_none());
        // Many shapes and leaves leave no triangles for outlines.
        assert_eq!(fineness([(2, 10_000)].into_iter()), 12);
        assert_eq!(fineness((0..200_000).map(|_| (2, 1))), 1);
    }
}
