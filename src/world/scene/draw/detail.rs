//! Coarser triangulations of a blade for views from afar. They have a thinned outline and, inside it, vertices by
//! greedy insertion (Garland & Heckbert 1995, "Fast polygonal approximation of terrains and height fields"), until the
//! vertices that are left out are within a distance and an angle. Levels share the mesh's vertices. So each costs only
//! a list of indices, and its normals are the mesh's own. The coarsest are flat pieces with vertices of their own
//! (`flat`). Lengths are in mm.

use super::flat_blade;
use glam::{DMat4, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_fits::leaf::blade::outline::simplify;
use spade::{ConstrainedDelaunayTriangulation, HasPosition, Point2, Triangulation};
use std::collections::{BTreeMap, BTreeSet};

/// One level, as triangles over the mesh's vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshDetailLevel {
    /// Indices of the mesh's vertices, three for each triangle.
    pub indices: Vec<u32>,
    /// Largest distance of a vertex that is left out from the level's surface.
    pub error_mm: f64,
    /// Whether normals may turn by more than light allows, so that it is for shadow maps alone.
    pub outline_only: bool,
}

/// For each level, the finest first, the largest distance over the blade's diameter and the largest angle between
/// normals that are left out. Angles stay small, because mapped normals turn with the mesh's normals. The last level is
/// for shadow maps, where only the outline and the distance count.
const LEVELS: [(f64, f64); 5] = [(0.001, 2.0), (0.003, 4.0), (0.01, 8.0), (0.03, 12.0), (0.03, ANY_ANGLE)];
const ANY_ANGLE: f64 = 180.0;
/// Numbers of corners of the flat pieces, the finest first.
const CORNERS: [usize; 2] = [6, 4];
/// A level is dropped if it has more than this share of the triangles of the one before.
const WORTH: f64 = 0.7;

#[derive(Debug, Clone, Copy)]
struct Vertex {
    at: Point2<f64>,
    index: u32,
}

impl HasPosition for Vertex {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.at
    }
}

type Mesh2 = ConstrainedDelaunayTriangulation<Vertex>;

/// The levels of a blade, the finest first, without the mesh itself. There are none where the blade is not a height
/// field over its plane, such as a blade that is bent over, or a twig.
pub fn levels(mesh: &LeafMesh) -> Vec<MeshDetailLevel> {
    let mut out: Vec<MeshDetailLevel> = Vec::new();
    let Some(rings) = rings(mesh).filter(|r| !r.is_empty() && upright(mesh)) else { return out };
    let (_, radius) = mesh.bounds();
    let mut before = mesh.triangles();
    for (distance, degrees) in LEVELS {
        let Some(level) = level(mesh, &rings, 2.0 * radius * distance, degrees.to_radians()) else { continue };
        let level = MeshDetailLevel { outline_only: degrees == ANY_ANGLE, ..level };
        if level.indices.len() / 3 < (WORTH * before as f64) as usize {
            before = level.indices.len() / 3;
            out.push(level);
        }
    }
    out
}

/// As [`levels`], with flat pieces as the coarsest lit levels and for shadow maps, where they can stand for the blade.
/// Their vertices are to be appended to the mesh's. `shown` as in [`flat_blade::flat`].
pub fn levels_with_pieces(mesh: &LeafMesh, shown: Option<&dyn Fn(DVec2) -> bool>) -> (Vec<MeshDetailLevel>, LeafMesh) {
    let (mut out, mut more) = (levels(mesh), LeafMesh::default());
    let Some(rings) = rings(mesh).filter(|r| !r.is_empty() && upright(mesh)) else { return (out, more) };
    let outlines = out.split_off(out.iter().filter(|d| !d.outline_only).count());
    let mut before = out.last().map_or(mesh.triangles(), |d| d.indices.len() / 3);
    let fewest = outlines.last().map_or(before, |d| d.indices.len() / 3);
    let mut pieces = Vec::new();
    for corners in CORNERS {
        let found = flat_blade::flat(mesh, &rings, corners, shown);
        let Some(flat) = found.filter(|c| (c.piece.triangles() as f64) < WORTH * before as f64) else { continue };
        before = flat.piece.triangles();
        let first = (mesh.positions.len() + more.positions.len()) as u32;
        let indices: Vec<u32> = flat.piece.indices.iter().map(|k| first + k).collect();
        pieces.push(MeshDetailLevel { indices, error_mm: flat.error_mm, outline_only: false });
        more.append(&flat.piece, DMat4::IDENTITY);
    }
    out.extend_from_slice(&pieces);
    // Shadow maps take the last level that is near enough to the mesh.
    let again = pieces.into_iter().filter(|d| !outlines.is_empty() && d.indices.len() / 3 < fewest);
    out.extend(outlines.iter().cloned().chain(again.map(|d| MeshDetailLevel { outline_only: true, ..d })));
    (out, more)
}

/// Whether every facet faces the front, so that x and y determine a place on the blade.
fn upright(mesh: &LeafMesh) -> bool {
    let flat = |k: usize| mesh.positions[k].truncate();
    (0..mesh.triangles()).all(|t| {
        let [a, b, c] = mesh.triangle(t);
        (flat(b) - flat(a)).perp_dot(flat(c) - flat(a)) > 0.0
    })
}

/// The boundary as closed rings of vertices; `None` where three edges meet at a boundary vertex, or where a ring stays
/// open.
pub(super) fn rings(mesh: &LeafMesh) -> Option<Vec<Vec<u32>>> {
    let mut edges = BTreeSet::new();
    for t in mesh.indices.chunks_exact(3) {
        edges.extend([(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]);
    }
    let mut next = BTreeMap::new();
    for (a, b) in &edges {
        if !edges.contains(&(*b, *a)) && next.insert(*a, *b).is_some() {
            return None;
        }
    }
    let mut rings = Vec::new();
    while let Some((first, mut at)) = next.pop_first() {
        let mut ring = vec![first];
        while at != first {
            ring.push(at);
            at = next.remove(&at)?;
        }
        rings.push(ring);
    }
    Some(rings)
}

/// One level; `None` where the thinned outline crosses itself.
fn level(mesh: &LeafMesh, rings: &[Vec<u32>], distance: f64, angle: f64) -> Option<MeshDetailLevel> {
    let flat = |k: u32| mesh.positions[k as usize].truncate();
    let vertex = |k: u32| Vertex { at: Point2::new(flat(k).x, flat(k).y), index: k };
    let mut cdt = Mesh2::new();
    let mut outline: Vec<Vec<DVec2>> = Vec::new();
    let mut error_mm = 0.0f64;
    for ring in rings {
        let places: Vec<[f64; 2]> = ring.iter().map(|k| flat(*k).to_array()).collect();
        // The points that are kept are the ring's own, bit for bit, and in its order.
        let mut rest = places.iter().enumerate();
        let corners: Vec<usize> =
            simplify(&places, distance).iter().filter_map(|p| rest.find(|(_, q)| *q == p).map(|(i, _)| i)).collect();
        if corners.len() < 3 {
            continue;
        }
        let mut kept = Vec::new();
        for (i, from) in corners.iter().enumerate() {
            let to = corners.get(i + 1).copied().unwrap_or(ring.len() + corners[0]);
            error_mm = error_mm.max(along_rim(mesh, ring, *from, to, distance, &mut kept));
        }
        let handles: Vec<_> = kept.iter().map(|k| cdt.insert(vertex(*k))).collect::<Result<_, _>>().ok()?;
        for i in 0..handles.len() {
            let (a, b) = (handles[i], handles[(i + 1) % handles.len()]);
            if a == b || !cdt.can_add_constraint(a, b) {
                return None;
            }
            cdt.add_constraint(a, b);
        }
        outline.push(kept.iter().map(|k| flat(*k)).collect());
    }
    let on_rings: BTreeSet<u32> = rings.iter().flatten().copied().collect();
    let mut left: Vec<u32> = (0..mesh.positions.len() as u32).filter(|k| !on_rings.contains(k)).collect();
    loop {
        // The worst vertices of all triangles are inserted together. This needs one round for each level of refinement
        // instead of one for each vertex.
        let mut worst: BTreeMap<[u32; 3], (f64, u32)> = BTreeMap::new();
        for k in &left {
            let Some((corners, off, turn)) = gap(mesh, &cdt, *k) else { continue };
            let excess = (off / distance).max(turn / angle);
            let entry = worst.entry(corners).or_insert((1.0, *k));
            if excess > entry.0 {
                *entry = (excess, *k);
            }
        }
        let chosen: BTreeSet<u32> = worst.values().filter(|w| w.0 > 1.0).map(|w| w.1).collect();
        if chosen.is_empty() {
            break;
        }
        for k in &chosen {
            cdt.insert(vertex(*k)).ok()?;
        }
        left.retain(|k| !chosen.contains(k));
    }
    for k in &left {
        error_mm = error_mm.max(gap(mesh, &cdt, *k).map_or(distance, |g| g.1));
    }
    let mut indices = Vec::new();
    for face in cdt.inner_faces() {
        let [a, b, c] = face.vertices().map(|v| v.data().index);
        let centre = (flat(a) + flat(b) + flat(c)) / 3.0;
        if (flat(b) - flat(a)).perp_dot(flat(c) - flat(a)) > 1e-12 && inside(&outline, centre) {
            indices.extend([a, b, c]);
        }
    }
    (!indices.is_empty()).then_some(MeshDetailLevel { indices, error_mm, outline_only: false })
}

/// Keeps `from`, and the vertices between it and `to` on the ring where the chord is more than `distance` away from the
/// rim's height. Positions may run past the end of the ring. Returns the largest remaining gap, and at least the
/// distance by which the outline was thinned.
fn along_rim(mesh: &LeafMesh, ring: &[u32], from: usize, to: usize, distance: f64, kept: &mut Vec<u32>) -> f64 {
    let at = |i: usize| mesh.positions[ring[i % ring.len()] as usize];
    let (a, b) = (at(from), at(to));
    let along = (b - a).truncate();
    let gap = |i: usize| {
        let t = (along.dot((at(i) - a).truncate()) / along.length_squared()).clamp(0.0, 1.0);
        (a.z + t * (b.z - a.z) - at(i).z).abs()
    };
    let worst = (from + 1..to).map(|i| (i, gap(i))).max_by(|p, q| p.1.total_cmp(&q.1));
    match worst {
        Some((i, off)) if off > distance => {
            let before = along_rim(mesh, ring, from, i, distance, kept);
            before.max(along_rim(mesh, ring, i, to, distance, kept))
        }
        _ => {
            kept.push(ring[from % ring.len()]);
            worst.map_or(0.0, |w| w.1.max(distance))
        }
    }
}

/// The triangle above or below which vertex `k` lies, their distance, and the angle between the normals there (rad);
/// `None` outside.
fn gap(mesh: &LeafMesh, cdt: &Mesh2, k: u32) -> Option<([u32; 3], f64, f64)> {
    use spade::PositionInTriangulation as At;
    let p = mesh.positions[k as usize];
    let face = match cdt.locate(Point2::new(p.x, p.y)) {
        At::OnVertex(_) => return Some(([k; 3], 0.0, 0.0)),
        At::OnFace(f) => cdt.face(f),
        At::OnEdge(e) => {
            let edge = cdt.directed_edge(e);
            edge.face().as_inner().or_else(|| edge.rev().face().as_inner())?
        }
        At::OutsideOfConvexHull(_) | At::NoTriangulation => return None,
    };
    let corners = face.vertices().map(|v| v.data().index);
    let weights = face.barycentric_interpolation(Point2::new(p.x, p.y));
    let mix =
        |get: &dyn Fn(usize) -> DVec3| corners.iter().zip(weights).map(|(c, w)| w * get(*c as usize)).sum::<DVec3>();
    let off = (mix(&|c| mesh.positions[c]).z - p.z).abs();
    let turn = mix(&|c| mesh.normals[c]).angle_between(mesh.normals[k as usize]);
    Some((corners, off, turn))
}

/// The even–odd rule over all rings.
pub(super) fn inside(rings: &[Vec<DVec2>], p: DVec2) -> bool {
    let crossed = |ring: &Vec<DVec2>| {
        (0..ring.len())
            .filter(|&k| {
                let (a, b) = (ring[k], ring[(k + 1) % ring.len()]);
                (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
            })
            .count()
    };
    rings.iter().map(crossed).sum::<usize>() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_files::mesh::{vertex_normals, vertex_tangents};

    /// A disk of 60 mm on a staggered grid, with a hole, bent by a smooth relief.
    fn blade() -> LeafMesh {
        let (mut mesh, n) = (LeafMesh::default(), 60);
        let at = |i: usize, j: usize| DVec2::new(i as f64 - 30.0 + 0.25 * (j % 2) as f64, j as f64 - 30.0);
        for j in 0..=n {
            for i in 0..=n {
                let p = at(i, j);
                mesh.positions.push(p.extend(2.0 * (p.x / 9.0).sin() + 0.01 * p.y * p.y));
                mesh.uvs.push(DVec2::new(p.x / 60.0 + 0.5, 0.5 - p.y / 60.0));
            }
        }
        let id = |i: usize, j: usize| (j * (n + 1) + i) as u32;
        for j in 0..n {
            for i in 0..n {
                let c = at(i, j) + DVec2::splat(0.5);
                if c.length() < 28.0 && c.distance(DVec2::new(8.0, 0.0)) > 5.0 {
                    mesh.indices.extend([
                        id(i, j),
                        id(i + 1, j),
                        id(i + 1, j + 1),
                        id(i, j),
                        id(i + 1, j + 1),
                        id(i, j + 1),
                    ]);
                }
            }
        }
        // Only vertices that a triangle uses are kept, as in a real mesh.
        let used: BTreeSet<u32> = mesh.indices.iter().copied().collect();
        let new: BTreeMap<u32, u32> = used.iter().enumerate().map(|(new, old)| (*old, new as u32)).collect();
        mesh.positions = used.iter().map(|k| mesh.positions[*k as usize]).collect();
        mesh.uvs = used.iter().map(|k| mesh.uvs[*k as usize]).collect();
        mesh.indices.iter_mut().for_each(|k| *k = new[k]);
        mesh.normals = vertex_normals(&mesh);
        mesh.tangents = vertex_tangents(&mesh);
        mesh
    }

    fn area(mesh: &LeafMesh, indices: &[u32]) -> f64 {
        let p = |k: u32| mesh.positions[k as usize].truncate();
        indices.chunks_exact(3).map(|t| 0.5 * (p(t[1]) - p(t[0])).perp_dot(p(t[2]) - p(t[0]))).sum()
    }

    #[test]
    fn levels_get_coarser_and_stay_within_what_they_say() {
        let mesh = blade();
        let levels = levels(&mesh);
        assert!(levels.len() >= 2, "{}", levels.len());
        let (full, diameter) = (area(&mesh, &mesh.indices), 2.0 * mesh.bounds().1);
        let mut before = mesh.indices.len();
        for (level, next) in levels.iter().zip(LEVELS.iter().skip(LEVELS.len() - levels.len())) {
            assert!(level.indices.len() < before);
            before = level.indices.len();
            // A rim that was thinned by at most this distance loses less area than the distance times its length.
            let rim = std::f64::consts::TAU * (28.0 + 5.0) * 1.3;
            assert!(
                (area(&mesh, &level.indices) - full).abs() < rim * diameter * next.0 + 1e-9,
                "{}",
                area(&mesh, &level.indices) - full
            );
            assert!(level.error_mm <= 3.0 * diameter * next.0, "{} {}", level.error_mm, diameter * next.0);
            // Every facet faces the front, and no edge is used twice in the same direction.
            let mut edges = BTreeSet::new();
            for t in level.indices.chunks_exact(3) {
                assert!([(t[0], t[1]), (t[1], t[2]), (t[2], t[0])].into_iter().all(|e| edges.insert(e)));
            }
        }
        assert!(levels.last().unwrap().indices.len() * 4 < mesh.indices.len());
    }

    /// Rays downwards hit the level and the mesh, by brute force over all triangles.
    #[test]
    fn the_stated_error_holds_between_vertices() {
        let mesh = blade();
        let height = |indices: &[u32], p: DVec2| {
            indices.chunks_exact(3).find_map(|t| {
                let [a, b, c] = [0, 1, 2].map(|k: usize| mesh.positions[t[k] as usize]);
                let (u, v, w) = (b.truncate() - a.truncate(), c.truncate() - a.truncate(), p - a.truncate());
                let (s, r) = (w.perp_dot(v) / u.perp_dot(v), u.perp_dot(w) / u.perp_dot(v));
                (s >= 0.0 && r >= 0.0 && s + r <= 1.0).then_some(a.z + s * (b.z - a.z) + r * (c.z - a.z))
            })
        };
        for level in levels(&mesh) {
            for k in 0..400 {
                let p = DVec2::from_angle(2.4 * f64::from(k)) * 27.0 * (f64::from(k) / 400.0).sqrt();
                if let (Some(a), Some(b)) = (height(&mesh.indices, p), height(&level.indices, p)) {
                    // Between two vertices of a facet of the level, the mesh lies between their heights.
                    assert!((a - b).abs() <= level.error_mm * 1.05 + 1e-9, "{} {}", a - b, level.error_mm);
                }
            }
        }
    }

    #[test]
    fn a_mesh_that_turns_over_has_no_levels() {
        let mut mesh = blade();
        mesh.indices.swap(0, 1);
        assert!(levels(&mesh).is_empty());
    }
}
