//! The mesh at whose vertices visibility is stored. It is the drawn mesh with its long edges halved, without the parts
//! that the outline cuts away, and with its vertices in an order that follows the surface.
//!
//! An edge is halved for both of its triangles together. They get the same new vertex, and no gap opens between them.
//! New vertices lie on the flat triangles of the drawn mesh, so the surface stays the same.

use super::VertexPlace;
use crate::world::ReferenceLeaf;
use crate::{Error, Result};
use glam::{DVec2, DVec3, DVec4};
use mesophyll_files::mesh::LeafMesh;
use std::collections::HashMap;
use std::path::Path;

/// A leaf's mesh for visibility.
#[derive(Debug, Clone)]
pub struct VisibilityMesh {
    /// The vertices in the order that follows the surface. Normals, tangents and texture coordinates are interpolated.
    pub mesh: LeafMesh,
    /// The place of each vertex on the drawn mesh.
    pub places: Vec<VertexPlace>,
}

/// The largest number of vertices of one blade.
const MOST_VERTICES: usize = 20_000_000;

/// A vertex of the drawn mesh itself.
fn corner(k: u32) -> VertexPlace {
    VertexPlace { corners: [k; 3], weights: [1.0, 0.0, 0.0] }
}

impl VertexPlace {
    /// The middle between two places on one triangle of the drawn mesh.
    fn middle(&self, other: &VertexPlace) -> VertexPlace {
        let mut sum: Vec<(u32, f64)> = Vec::with_capacity(6);
        for (k, w) in self.corners.iter().zip(self.weights).chain(other.corners.iter().zip(other.weights)) {
            match sum.iter_mut().find(|(seen, _)| seen == k) {
                Some((_, weight)) => *weight += 0.5 * w,
                None => sum.push((*k, 0.5 * w)),
            }
        }
        sum.sort_by_key(|(k, _)| *k);
        sum.retain(|(_, w)| *w > 0.0);
        let mut out = corner(sum[0].0);
        for (q, (k, w)) in sum.into_iter().take(3).enumerate() {
            (out.corners[q], out.weights[q]) = (k, w);
        }
        out
    }

    /// The weighted mean of the corners' values.
    fn mix<T: Copy + std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>>(&self, of: &[T]) -> T {
        let [a, b, c] = [0, 1, 2].map(|q| of[self.corners[q] as usize] * self.weights[q]);
        a + b + c
    }
}

/// Refines the drawn mesh of a leaf until its edges are at most `edge_mm` long in the leaf's own lengths. If this is
/// infinite, they stay as drawn.
///
/// # Errors
/// [`Error::Input`] that names leaf `number`, where it is made of discs or would have more than 20 million vertices.
pub(super) fn refine(leaf: &ReferenceLeaf, edge_mm: f64, number: usize) -> Result<VisibilityMesh> {
    let mesh = &leaf.mesh;
    let bad = |what: String| Error::input(Path::new("visibility"), format!("leaf {number}: {what}"));
    if mesh.discs {
        return Err(bad("it is made of discs, which have no vertices that light could be kept at".into()));
    }
    if !(edge_mm > 0.0) {
        return Err(bad(format!("edge of {edge_mm} mm, expected a length above 0")));
    }
    let corners = |t: &[u32]| [0, 1, 2].map(|k| mesh.positions[t[k] as usize]);
    let area: f64 =
        mesh.indices.chunks_exact(3).map(corners).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum();
    // A triangle with such edges has at most √3/4 of their square as its area, and there are hardly two triangles for
    // each vertex.
    if area / (0.866 * edge_mm * edge_mm) > MOST_VERTICES as f64 {
        return Err(bad(format!("edges of {edge_mm} mm need more than {MOST_VERTICES} vertices")));
    }
    let mut places: Vec<VertexPlace> = (0..mesh.positions.len() as u32).map(corner).collect();
    let mut triangles: Vec<[u32; 3]> =
        (0..mesh.indices.len() / 3).map(|t| [0, 1, 2].map(|k| mesh.indices[3 * t + k])).collect();
    let mut positions = mesh.positions.clone();
    let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
    loop {
        middles.clear();
        for t in &triangles {
            for [a, b] in edges(*t) {
                if positions[a as usize].distance(positions[b as usize]) > edge_mm
                    && !middles.contains_key(&[a.min(b), a.max(b)])
                {
                    middles.insert([a.min(b), a.max(b)], places.len() as u32);
                    places.push(places[a as usize].middle(&places[b as usize]));
                    positions.push(places[places.len() - 1].mix(&mesh.positions));
                }
            }
        }
        if places.len() > MOST_VERTICES {
            return Err(bad(format!("edges of {edge_mm} mm need more than {MOST_VERTICES} vertices")));
        }
        if middles.is_empty() {
            break;
        }
        triangles = triangles.iter().flat_map(|t| split(*t, &middles, &positions)).collect();
    }
    triangles.retain(|t| outline(leaf, t.map(|k| places[k as usize].mix(&mesh.uvs))) != Outline::Off);
    Ok(ordered(mesh, &places, &triangles))
}

fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Divides a triangle with new vertices in the middle of some edges into one to four triangles with the same winding.
fn split(t: [u32; 3], middles: &HashMap<[u32; 2], u32>, positions: &[DVec3]) -> Vec<[u32; 3]> {
    let of = edges(t).map(|[a, b]| middles.get(&[a.min(b), a.max(b)]).copied());
    // The triangle is rotated so that its first edge is halved and, if two edges are, its last one is not.
    let turned = |by: usize| ([0, 1, 2].map(|k| t[(k + by) % 3]), [0, 1, 2].map(|k| of[(k + by) % 3]));
    let count = of.iter().flatten().count();
    let first = (0..3).find(|k| of[*k].is_some() && (count != 2 || of[(k + 2) % 3].is_none())).unwrap_or(0);
    match turned(first) {
        ([a, b, c], [Some(ab), Some(bc), Some(ca)]) => vec![[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]],
        ([a, b, c], [Some(ab), Some(bc), None]) => {
            let length = |i: u32, j: u32| positions[i as usize].distance_squared(positions[j as usize]);
            // The shorter diagonal of the quadrangle is used.
            if length(a, bc) < length(ab, c) {
                vec![[ab, b, bc], [a, ab, bc], [a, bc, c]]
            } else {
                vec![[ab, b, bc], [a, ab, c], [ab, bc, c]]
            }
        }
        ([a, b, c], [Some(ab), ..]) => vec![[a, ab, c], [ab, b, c]],
        _ => vec![t],
    }
}

/// How much of a triangle is on the leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outline {
    /// No part.
    Off,
    /// Perhaps a part of it.
    Part,
    /// All of it.
    On,
}

/// Classifies a triangle, given by its corners' texture coordinates, by the texels around it. The outline is bilinear,
/// so a place is on (or off) where all four texels around it are.
pub(super) fn outline(leaf: &ReferenceLeaf, [a, b, c]: [DVec2; 3]) -> Outline {
    let Some(mask) = &leaf.mask else { return Outline::On };
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let range = |low: f64, high: f64, size: usize| {
        let at = |u: f64| (u * size as f64 - 0.5).clamp(0.0, (size - 1) as f64);
        at(low) as usize..=(at(high) as usize + 1).min(size - 1)
    };
    let columns = range(low.x, high.x, leaf.width);
    let mut texels = range(low.y, high.y, leaf.height)
        .flat_map(|row| columns.clone().map(move |i| row * leaf.width + i))
        .map(|k| mask[k] != 0);
    let first = texels.next() == Some(true);
    match (texels.all(|on| on == first), first) {
        (true, true) => Outline::On,
        (true, false) => Outline::Off,
        (false, _) => Outline::Part,
    }
}

/// The vertices that triangles use, along a space-filling curve, with all values of the drawn mesh.
fn ordered(mesh: &LeafMesh, places: &[VertexPlace], triangles: &[[u32; 3]]) -> VisibilityMesh {
    let uvs: Vec<DVec2> = places.iter().map(|p| p.mix(&mesh.uvs)).collect();
    let positions: Vec<DVec3> = places.iter().map(|p| p.mix(&mesh.positions)).collect();
    let scale = stretch(&positions, &uvs, triangles);
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let low = used.iter().fold(DVec2::INFINITY, |low, k| low.min(uvs[*k as usize]));
    let size = used.iter().fold(0.0, |size: f64, k| size.max(((uvs[*k as usize] - low) * scale).max_element()));
    used.sort_by_cached_key(|k| {
        let at = (uvs[*k as usize] - low) * scale / if size > 0.0 { size } else { 1.0 };
        hilbert((at * 65_535.0).to_array().map(|x| x as u32))
    });
    let mut number = vec![0; places.len()];
    used.iter().enumerate().for_each(|(n, k)| number[*k as usize] = n as u32);
    let mut triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|k| number[k as usize])).collect();
    triangles.sort_by_key(|t| t.iter().min().copied());
    let kept: Vec<VertexPlace> = used.iter().map(|k| places[*k as usize]).collect();
    let tangents: Vec<DVec4> = mesh.tangents.iter().map(|t| DVec4::from(*t)).collect();
    let tangent = |p: &VertexPlace| {
        let nearest = p.corners[(0..3).fold(0, |a, b| if p.weights[b] > p.weights[a] { b } else { a })];
        (p.mix(&tangents).truncate().normalize_or_zero(), mesh.tangents[nearest as usize].1)
    };
    VisibilityMesh {
        mesh: LeafMesh {
            positions: used.iter().map(|k| positions[*k as usize]).collect(),
            normals: kept.iter().map(|p| p.mix(&mesh.normals).normalize_or(DVec3::Z)).collect(),
            tangents: if mesh.tangents.is_empty() { Vec::new() } else { kept.iter().map(tangent).collect() },
            uvs: used.iter().map(|k| uvs[*k as usize]).collect(),
            indices: triangles.into_iter().flatten().collect(),
            discs: false,
        },
        places: kept,
    }
}

/// Mean length in mm of a unit of u and of v. With it, the curve follows the leaf and not its maps.
fn stretch(positions: &[DVec3], uvs: &[DVec2], triangles: &[[u32; 3]]) -> DVec2 {
    let (mut along, mut square) = (DVec2::ZERO, DVec2::ZERO);
    for [a, b] in triangles.iter().flat_map(|t| edges(*t)) {
        let step = (uvs[b as usize] - uvs[a as usize]).abs();
        let direction = step.normalize_or_zero();
        along += step * direction * direction * positions[b as usize].distance(positions[a as usize]);
        square += step * step * direction * direction;
    }
    DVec2::new(along.x / square.x.max(1e-300), along.y / square.y.max(1e-300))
}

/// The place of a cell of a 65,536² grid along Hilbert's curve (the well-known loop over its bits; Warren 2013, §16).
fn hilbert([mut x, mut y]: [u32; 2]) -> u32 {
    let mut along = 0;
    for bit in (0..16).rev() {
        let (right, up) = (x >> bit & 1, y >> bit & 1);
        along = along << 2 | ((3 * right) ^ up);
        if up == 0 {
            if right == 1 {
                (x, y) = (!x, !y);
            }
            (x, y) = (y, x);
        }
    }
    along
}

#[cfg(test)]
mod tests {
    use super::super::tests::{grid, leaf};
    use super::*;
    use std::collections::HashSet;

    fn area(mesh: &LeafMesh) -> f64 {
        let corner = |t: &[u32]| [0, 1, 2].map(|k| mesh.positions[t[k] as usize]);
        let twice = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).z;
        mesh.indices.chunks_exact(3).map(|t| 0.5 * twice(corner(t))).sum()
    }

    /// Every edge inside the sheet has two triangles with opposite directions, and no vertex lies on another's edge.
    #[test]
    fn halved_edges_stay_shared_and_the_area_stays() {
        let mut drawn = grid(40.0, 30.0, 3, 2);
        // One vertex is moved to make edges unequal.
        drawn.positions[5] += DVec3::new(3.0, -2.0, 0.0);
        let whole = area(&drawn);
        for edge in [100.0, 9.0, 4.0, 1.3] {
            let blade = refine(&leaf(drawn.clone()), edge, 0).unwrap();
            let mesh = &blade.mesh;
            assert!((area(mesh) - whole).abs() < 1e-9 * whole, "{edge}");
            let all: HashSet<[u32; 2]> = mesh.indices.chunks_exact(3).flat_map(|t| edges([t[0], t[1], t[2]])).collect();
            assert_eq!(all.len(), mesh.indices.len(), "an edge is there twice the same way round");
            let rim: f64 = all
                .iter()
                .filter(|[a, b]| !all.contains(&[*b, *a]))
                .map(|[a, b]| mesh.positions[*a as usize].distance(mesh.positions[*b as usize]))
                .sum();
            // A gap would add both of its sides to the rim.
            assert!((rim - 140.0).abs() < 1e-9, "{edge}: rim of {rim}");
            let longest = all.iter().map(|[a, b]| mesh.positions[*a as usize].distance(mesh.positions[*b as usize]));
            assert!(longest.fold(0.0, f64::max) <= edge);
            for (p, place) in mesh.positions.iter().zip(&blade.places) {
                assert!(place.mix(&drawn.positions).distance(*p) == 0.0);
                assert!((place.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            }
        }
    }

    /// The curve goes through all cells once, and from cell to cell through their sides.
    #[test]
    fn the_curve_goes_through_all_cells_side_by_side() {
        let cell = 65_536 / 16;
        let mut cells: Vec<(u32, [u32; 2])> = (0..256)
            .map(|k| [k % 16, k / 16])
            .map(|[i, j]| (hilbert([i * cell, j * cell]) / (cell * cell), [i, j]))
            .collect();
        cells.sort();
        for (k, pair) in cells.windows(2).enumerate() {
            let ((n, a), (_, b)) = (pair[0], pair[1]);
            assert_eq!(n as usize, k);
            assert_eq!(a[0].abs_diff(b[0]) + a[1].abs_diff(b[1]), 1, "{a:?} to {b:?}");
        }
    }

    /// Neighbours in the list are near each other: on average within two edges.
    #[test]
    fn neighbours_in_the_list_are_neighbours_on_the_leaf() {
        let blade = refine(&leaf(grid(60.0, 30.0, 30, 15)), 2.0, 0).unwrap();
        let p = &blade.mesh.positions;
        let mean = p.windows(2).map(|w| w[0].distance(w[1])).sum::<f64>() / (p.len() - 1) as f64;
        assert!(mean < 4.0, "{mean} mm between neighbours of {} vertices", p.len());
    }

    #[test]
    fn what_the_outline_cuts_away_has_no_vertices() {
        let mut half = leaf(grid(40.0, 40.0, 8, 8));
        (half.width, half.height) = (4, 4);
        half.mask = Some((0..16).map(|k| u8::from(k % 4 < 2)).collect());
        let blade = refine(&half, 2.5, 0).unwrap();
        let right = blade.mesh.positions.iter().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
        // The outline goes through the middle. No triangle begins beyond the texel after it.
        assert!((0.0..=10.0).contains(&right), "{right}");
        let whole = refine(&leaf(grid(40.0, 40.0, 8, 8)), 2.5, 0).unwrap();
        assert!(blade.mesh.positions.len() * 3 < whole.mesh.positions.len() * 2);
    }

    #[test]
    fn discs_and_edges_without_length_are_refused() {
        let mut discs = leaf(grid(1.0, 1.0, 1, 1));
        assert!(refine(&discs, 0.0, 3).unwrap_err().to_string().contains("leaf 3: edge of 0 mm"));
        discs.mesh.discs = true;
        assert!(refine(&discs, 1.0, 3).unwrap_err().to_string().contains("leaf 3: it is made of discs"));
    }
}
