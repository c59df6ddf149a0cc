//! The places on a leaf at which the light of its surroundings is known: its anchors. They stand on a grid over each
//! connected piece of the mesh.
//!
//! Light from the sky and from other leaves changes slowly along a leaf, so a few anchors are enough for many vertices
//! (Wang et al. 2005, §4, Table 1: about one for fifteen). A piece is connected by edges. Two leaves that merely touch
//! are two pieces, and no light is interpolated from one to the other.

use crate::lookup::TexelTaps;
use crate::world::ReferenceLeaf;
use glam::{DVec2, DVec3};
use std::collections::HashMap;

/// A point of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshPoint {
    /// The triangle on which it lies.
    pub triangle: usize,
    /// Weights of the triangle's second and third corner.
    pub barycentric: [f64; 2],
}

/// The neighbourhood that an anchor represents: points of its piece, with a Gaussian density around the anchor (Wang et
/// al. 2005, §4, "Level of Detail"). So something that hides the sky from a single point does not darken a third of a
/// leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct Anchor {
    /// The points. On a grid, the first one is the anchor itself. Without points, no light arrives.
    pub points: Vec<MeshPoint>,
}

/// Number of points in a neighbourhood, and its standard deviation over the distance between two anchors.
const POINTS: usize = 32;
const SPREAD: f64 = 0.35;

/// The anchors of a mesh, and the places of its vertices among them.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshAnchors {
    /// Number of anchors along a piece and across it.
    pub grid: [usize; 2],
    /// The anchors, one piece's grid after the other, row by row. The place along the piece varies fastest.
    pub points: Vec<Anchor>,
    /// For each vertex, the first anchor of its piece, and its place in the grid, 0 to `grid − 1` along and across.
    pub places: Vec<[f32; 3]>,
}

impl MeshAnchors {
    /// A grid over every piece of a leaf. An anchor that would be beside the leaf, or where its mask cuts the leaf
    /// away, is moved to the nearest place on it.
    pub fn on_leaf(leaf: &ReferenceLeaf, grid: [usize; 2]) -> MeshAnchors {
        let grid = grid.map(|n| n.max(1));
        let pieces = pieces(leaf);
        let mut out = MeshAnchors { grid, points: Vec::new(), places: vec![[0.0; 3]; leaf.mesh.positions.len()] };
        for triangles in &pieces {
            out.add(leaf, triangles);
        }
        out
    }

    /// An anchor at every vertex, for surfaces over which no plane can be laid, such as wood. It represents the mean
    /// over the middles of the triangles around the vertex. The vertex itself may lie inside other wood, as at the foot
    /// of a branch.
    pub fn at_vertices(leaf: &ReferenceLeaf) -> MeshAnchors {
        let mesh = &leaf.mesh;
        let mut around = vec![Vec::new(); mesh.positions.len()];
        for (k, vertex) in mesh.indices.iter().enumerate() {
            around[*vertex as usize].push(MeshPoint { triangle: k / 3, barycentric: [1.0 / 3.0; 2] });
        }
        MeshAnchors {
            grid: [1, 1],
            places: (0..around.len()).map(|k| [k as f32, 0.0, 0.0]).collect(),
            // A vertex without triangles is never drawn.
            points: around.into_iter().map(|points| Anchor { points }).collect(),
        }
    }

    /// The values at the anchors, interpolated at a vertex: the bilinear mean of the four around it, as in a renderer.
    pub fn between<const N: usize>(&self, vertex: usize, at: &[[DVec3; N]]) -> [DVec3; N] {
        let [first, x, y] = self.places[vertex].map(f64::from);
        let last = self.grid.map(|n| n - 1);
        let low = [(x as usize).min(last[0]), (y as usize).min(last[1])];
        let t = [x - low[0] as f64, y - low[1] as f64];
        let mut sum = [DVec3::ZERO; N];
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let weight = |k: usize, t: f64| if k == 0 { 1.0 - t } else { t };
            let node = (low[0] + i).min(last[0]) + self.grid[0] * (low[1] + j).min(last[1]);
            let value = at[first as usize + node];
            (0..N).for_each(|q| sum[q] += value[q] * (weight(i, t[0]) * weight(j, t[1])));
        }
        sum
    }

    /// The places of the vertices among the anchors of a level ([`level`]). These anchors have no neighbourhoods of
    /// their own.
    pub fn at_level(&self, to: usize) -> MeshAnchors {
        let (fine, grid) = (self.grid, level(self.grid, to));
        let place = |p: &[f32; 3]| {
            let piece = p[0] as usize / (fine[0] * fine[1]);
            let [x, y] = [0, 1].map(|k| p[k + 1] * (grid[k] - 1) as f32 / (fine[k].max(2) - 1) as f32);
            [(piece * grid[0] * grid[1]) as f32, x, y]
        };
        MeshAnchors { grid, points: Vec::new(), places: self.places.iter().map(place).collect() }
    }

    /// Adds the grid over one piece.
    fn add(&mut self, leaf: &ReferenceLeaf, triangles: &[usize]) {
        let plane = Plane::along(leaf, triangles);
        let [along, across] = self.grid;
        let first = self.points.len();
        let node = |k: usize, n: usize, [low, high]: [f64; 2]| match n {
            1 => 0.5 * (low + high),
            _ => low + (high - low) * k as f64 / (n - 1) as f64,
        };
        let flat: Vec<[DVec2; 3]> = triangles.iter().map(|t| corners(leaf, *t).map(|p| plane.of(p))).collect();
        let spare = spare(leaf, triangles);
        let hit = |at: DVec2| {
            triangles.iter().zip(&flat).find_map(|(t, corner)| {
                let found = MeshPoint { triangle: *t, barycentric: inside(corner, at)? };
                on_leaf(leaf, &found).then_some(found)
            })
        };
        let apart = |n: usize, [low, high]: [f64; 2]| (high - low) / (n.max(2) - 1) as f64;
        let apart = DVec2::new(apart(along, plane.reach[0]), apart(across, plane.reach[1]));
        for j in 0..across {
            for i in 0..along {
                let at = DVec2::new(node(i, along, plane.reach[0]), node(j, across, plane.reach[1]));
                let near = || {
                    let distance = |a: &MeshPoint| plane.of(position(leaf, a)).distance_squared(at);
                    spare.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).copied()
                };
                let fallback = MeshPoint { triangle: triangles[0], barycentric: [1.0 / 3.0; 2] };
                let own = hit(at).or_else(near).unwrap_or(fallback);
                let around = (1..POINTS).filter_map(|k| hit(at + apart * gaussian(k)));
                self.points.push(Anchor { points: std::iter::once(own).chain(around).collect() });
            }
        }
        let place = |v: f64, n: usize, [low, high]: [f64; 2]| match n {
            1 => 0.0,
            _ => ((v - low) / (high - low).max(1e-300) * (n - 1) as f64).clamp(0.0, (n - 1) as f64) as f32,
        };
        for vertex in triangles.iter().flat_map(|t| vertices(leaf, *t)) {
            let p = plane.of(leaf.mesh.positions[vertex]);
            self.places[vertex] = [first as f32, place(p.x, along, plane.reach[0]), place(p.y, across, plane.reach[1])];
        }
    }
}

/// The number of grids in the chain that begins with this one. Each has half the anchors of the one before along both
/// axes, but at least one. The last one has a single anchor.
pub fn levels(grid: [usize; 2]) -> usize {
    (1 + grid[0].max(grid[1]).max(1).ilog2()) as usize
}

/// Number of anchors along a piece and across it on a level of the chain.
pub fn level(grid: [usize; 2], level: usize) -> [usize; 2] {
    grid.map(|n| (n >> level).max(1))
}

/// The anchors of a piece's grid that each anchor of a level represents, with weights that sum to one. The weights are
/// a Gaussian over the surface with the same standard deviation as neighbourhoods: [`SPREAD`] times the distance
/// between two of the level's anchors (Wang et al. 2005, §4, "Level of Detail"). A single anchor along an axis is the
/// mean.
pub fn coarser(grid: [usize; 2], to: usize) -> Vec<Vec<(usize, f64)>> {
    let [across_long, across_wide] = [0, 1].map(|axis| {
        let (fine, coarse) = (grid[axis], level(grid, to)[axis]);
        let weights = |k: usize| {
            // An anchor at the rim represents half the width.
            let area = |i: usize| if fine > 1 && (i == 0 || i == fine - 1) { 0.5 } else { 1.0 };
            let apart = (fine.max(2) - 1) as f64 / (coarse.max(2) - 1) as f64;
            let near = |i: usize| match coarse {
                1 => 1.0,
                _ => (-0.5 * ((i as f64 - k as f64 * apart) / (SPREAD * apart)).powi(2)).exp(),
            };
            let sum: f64 = (0..fine).map(|i| area(i) * near(i)).sum();
            (0..fine).map(|i| area(i) * near(i) / sum).collect::<Vec<f64>>()
        };
        (0..coarse).map(weights).collect::<Vec<_>>()
    });
    let of = |v: &Vec<f64>, u: &Vec<f64>| {
        let row =
            |(j, y): (usize, &f64)| u.iter().enumerate().map(|(i, x)| (i + grid[0] * j, x * y)).collect::<Vec<_>>();
        v.iter().enumerate().flat_map(row).collect()
    };
    across_wide.iter().flat_map(|v| across_long.iter().map(|u| of(v, u)).collect::<Vec<_>>()).collect()
}

/// A plane along a piece: its long axis and the axis across it.
struct Plane {
    origin: DVec3,
    axes: [DVec3; 2],
    /// The extent of the piece along each axis, from the least to the largest coordinate.
    reach: [[f64; 2]; 2],
}

impl Plane {
    fn along(leaf: &ReferenceLeaf, triangles: &[usize]) -> Plane {
        let (mut normal, mut origin, mut area) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for t in triangles {
            let [a, b, c] = corners(leaf, *t);
            let n = (b - a).cross(c - a);
            normal += n;
            origin += (a + b + c) / 3.0 * n.length();
            area += n.length();
        }
        let origin = if area > 0.0 { origin / area } else { corners(leaf, triangles[0])[0] };
        let (u, v) = normal.normalize_or(DVec3::Z).any_orthonormal_pair();
        // The long axis has the largest second moment of the area.
        let (mut uu, mut uv, mut vv) = (0.0, 0.0, 0.0);
        for [a, b, c] in triangles.iter().map(|t| corners(leaf, *t)) {
            let area = (b - a).cross(c - a).length();
            for p in [a, b, c, a + b + c - 2.0 * origin] {
                let (x, y) = ((p - origin).dot(u), (p - origin).dot(v));
                (uu, uv, vv) = (uu + area * x * x, uv + area * x * y, vv + area * y * y);
            }
        }
        let even = (uu - vv).hypot(2.0 * uv) < 1e-6 * (uu + vv);
        let (sin, cos) = if even { (0.0, 1.0) } else { (0.5 * (2.0 * uv).atan2(uu - vv)).sin_cos() };
        let mut out = Plane { origin, axes: [u * cos + v * sin, v * cos - u * sin], reach: [[0.0; 2]; 2] };
        for p in triangles.iter().flat_map(|t| corners(leaf, *t)) {
            let at = out.of(p).to_array();
            for (reach, x) in out.reach.iter_mut().zip(at) {
                *reach = [reach[0].min(x), reach[1].max(x)];
            }
        }
        out
    }

    fn of(&self, p: DVec3) -> DVec2 {
        DVec2::new((p - self.origin).dot(self.axes[0]), (p - self.origin).dot(self.axes[1]))
    }
}

/// The triangles of each piece, in the order of the mesh. Triangles are connected if they share a vertex, or an edge
/// whose ends are at the same places. So vertices that are stored twice separate nothing.
fn pieces(leaf: &ReferenceLeaf) -> Vec<Vec<usize>> {
    let mesh = &leaf.mesh;
    let mut same: HashMap<[u64; 3], usize> = HashMap::new();
    let place: Vec<usize> = mesh
        .positions
        .iter()
        .map(|p| {
            let next = same.len();
            // Adding 0 turns −0 into 0.
            *same.entry(p.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next)
        })
        .collect();
    let count = mesh.indices.len() / 3;
    let mut parent: Vec<usize> = (0..count).collect();
    fn root(parent: &mut [usize], mut t: usize) -> usize {
        while parent[t] != t {
            parent[t] = parent[parent[t]];
            t = parent[t];
        }
        t
    }
    let mut edges: HashMap<[usize; 2], usize> = HashMap::new();
    let mut shared: Vec<Option<usize>> = vec![None; mesh.positions.len()];
    for t in 0..count {
        let v = vertices(leaf, t).map(|k| place[k]);
        let by_edge = [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])];
        let by_edge = by_edge.map(|(a, b)| *edges.entry([a.min(b), a.max(b)]).or_insert(t));
        // A vertex that two triangles share has one place among the anchors, so both belong to one piece.
        let by_vertex = vertices(leaf, t).map(|k| *shared[k].get_or_insert(t));
        for other in by_edge.into_iter().chain(by_vertex) {
            let (x, y) = (root(&mut parent, t), root(&mut parent, other));
            parent[x.max(y)] = x.min(y);
        }
    }
    let mut index: HashMap<usize, usize> = HashMap::new();
    let mut out: Vec<Vec<usize>> = Vec::new();
    for t in 0..count {
        let k = *index.entry(root(&mut parent, t)).or_insert(out.len());
        if k == out.len() {
            out.push(Vec::new());
        }
        out[k].push(t);
    }
    out
}

/// Places on the leaf that replace a node of the grid that is not on it: for each triangle, near its corners and in its
/// middle.
fn spare(leaf: &ReferenceLeaf, triangles: &[usize]) -> Vec<MeshPoint> {
    const PLACES: [[f64; 2]; 4] = [[1.0 / 3.0; 2], [0.02, 0.02], [0.96, 0.02], [0.02, 0.96]];
    triangles
        .iter()
        .flat_map(|t| PLACES.map(|barycentric| MeshPoint { triangle: *t, barycentric }))
        .filter(|a| on_leaf(leaf, a))
        .collect()
}

/// Point `k` of a Gaussian neighbourhood with the standard deviation [`SPREAD`], in units of the distance between two
/// anchors.
fn gaussian(k: usize) -> DVec2 {
    // Kronecker's sequence by the plastic number, which is even for every number of points.
    let even = |step: f64| (0.5 + k as f64 * step).fract();
    let (u, v) = (even(0.754_877_666_246_692_7), even(0.569_840_290_998_053_2));
    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
    DVec2::new(cos, sin) * (SPREAD * (-2.0 * (1.0 - u).ln()).sqrt())
}

fn on_leaf(leaf: &ReferenceLeaf, anchor: &MeshPoint) -> bool {
    let Some(mask) = &leaf.mask else { return true };
    let [b, c] = anchor.barycentric;
    let uv = vertices(leaf, anchor.triangle).map(|k| leaf.mesh.uvs[k]);
    let at = uv[0] * (1.0 - b - c) + uv[1] * b + uv[2] * c;
    TexelTaps::new(at.x, at.y, leaf.width, leaf.height, false).coverage(mask) >= 0.5
}

/// Barycentric coordinates of a point in a triangle, including its rim. `None` outside it, and for a triangle without
/// area.
fn inside([a, b, c]: &[DVec2; 3], p: DVec2) -> Option<[f64; 2]> {
    let (u, v, w) = (*b - *a, *c - *a, p - *a);
    let area = u.perp_dot(v);
    let (x, y) = (w.perp_dot(v) / area, u.perp_dot(w) / area);
    // By rounding, a node at the rim may lie slightly outside.
    let (x, y) = (x + 1e-9, y + 1e-9);
    (x >= 0.0 && y >= 0.0 && x + y <= 1.0 + 4e-9).then(|| [x.min(1.0), y.min(1.0 - x.min(1.0))])
}

fn vertices(leaf: &ReferenceLeaf, triangle: usize) -> [usize; 3] {
    [0, 1, 2].map(|k| leaf.mesh.indices[3 * triangle + k] as usize)
}

fn corners(leaf: &ReferenceLeaf, triangle: usize) -> [DVec3; 3] {
    vertices(leaf, triangle).map(|k| leaf.mesh.positions[k])
}

/// The place of an anchor in the mesh's own frame.
pub(super) fn position(leaf: &ReferenceLeaf, anchor: &MeshPoint) -> DVec3 {
    let [a, b, c] = corners(leaf, anchor.triangle);
    a + (b - a) * anchor.barycentric[0] + (c - a) * anchor.barycentric[1]
}

/// The normal of an anchor's triangle, out of its front, in the mesh's own frame; zero for a triangle without area.
pub(super) fn normal(leaf: &ReferenceLeaf, anchor: &MeshPoint) -> DVec3 {
    let [a, b, c] = corners(leaf, anchor.triangle);
    (b - a).cross(c - a).normalize_or_zero()
}

#[cfg(test)]
#[path = "anchors_tests.rs"]
mod tests;
