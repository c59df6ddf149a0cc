//! What stands in the light of one direction, computed on the plane across it.
//!
//! All light of a map comes from nearly one direction. So the scene is projected along it once: the triangles of every
//! instance are sorted into a grid on the plane across the direction. A receiver then tests only the triangles in its
//! own cells. A triangle hides a set of the light's points, with one bit for each point. Three numbers tell whether it
//! hides all points or none. So a receiver costs about as much as one ray, whatever the number of points.
//!
//! Signed volumes (as in Plücker coordinates) decide whether a point is hidden. Both triangles of an edge use the same
//! number, so no light passes between them.

use super::grid::Grid;
use super::light::{AreaLight, frame};
use super::refinement::{Outline, outline};
use crate::stage::Stage;
use crate::world::ReferenceLeaf;
use glam::{DMat3, DMat4, DVec2, DVec3, Vec4};
use rayon::prelude::*;

/// The scene, projected along one direction of the light.
pub(super) struct Casters<'a> {
    stage: &'a Stage<'a>,
    /// Points of the light as tangents, 64 to a word of bits. Those beyond the last point are never read.
    points: Vec<[[f64; 64]; 2]>,
    /// The bits of the last word that belong to points.
    last: u64,
    /// Largest tangent of a point.
    spread: f64,
    /// More than the error of a length in single precision (mm).
    slack: f64,
    /// Triangles of each leaf that may hide something, and whether the outline must be tested.
    triangles: Vec<Vec<([u32; 3], u32, bool)>>,
    casts: Vec<Cast>,
    /// The grid over all instances.
    top: Grid,
    instances: Vec<u32>,
    from: DMat3,
}

/// An instance in the light's frame: x across, y up, z towards the light (mm).
#[derive(Debug, Default)]
struct Cast {
    vertices: Vec<DVec3>,
    low: DVec3,
    high: DVec3,
    grid: Grid,
    /// Its triangles, cell by cell.
    entries: Vec<Entry>,
}

/// A triangle in a cell, with its box rounded outwards.
#[derive(Debug, Clone, Copy, Default)]
struct Entry {
    /// The least x and y, and the largest x and y with the opposite sign.
    sides: Vec4,
    /// Largest z, nearest to the light.
    top: f32,
    /// Index of the triangle in its leaf.
    triangle: u32,
}

impl<'a> Casters<'a> {
    pub fn new(stage: &'a Stage<'a>, light: &AreaLight) -> Casters<'a> {
        let tangents = light.tangents();
        let mut points = vec![[[0.0; 64]; 2]; tangents.len().div_ceil(64)];
        for (k, p) in tangents.iter().enumerate() {
            (0..2).for_each(|q| points[k / 64][q][k % 64] = p[q]);
        }
        Casters {
            stage,
            points,
            last: u64::MAX >> ((64 - tangents.len() % 64) % 64),
            spread: light.tangent(),
            slack: 4.0 * stage.step(),
            triangles: stage.world.leaves.iter().map(hiding).collect(),
            casts: stage.world.instances.iter().map(|_| Cast::default()).collect(),
            top: Grid::default(),
            instances: Vec::new(),
            from: DMat3::IDENTITY,
        }
    }

    /// Number of words of bits for the light's points.
    pub fn words(&self) -> usize {
        self.points.len()
    }

    /// Projects the scene along `direction`.
    pub fn look_from(&mut self, direction: DVec3) {
        self.from = frame(direction);
        let (world, triangles, turn) = (self.stage.world, &self.triangles, DMat4::from_mat3(self.from.transpose()));
        self.casts.par_iter_mut().zip(&world.instances).for_each(|(cast, placed)| {
            cast.draw(&world.leaves[placed.leaf].mesh.positions, turn * placed.transform, &triangles[placed.leaf]);
        });
        let lowest = self.casts.iter().map(|c| c.low.z).fold(f64::INFINITY, f64::min);
        let farthest = self.casts.iter().flat_map(|c| [c.low, c.high]).filter(|p| p.is_finite());
        let farthest = farthest.map(|p| p.abs().max_element()).fold(0.0, f64::max);
        self.slack = 4.0 * self.stage.step() + 8.0 * f64::from(f32::EPSILON) * farthest;
        let (casts, spread, slack) = (&self.casts, self.spread, self.slack);
        let rectangle = |k: usize| {
            let Cast { low, high, .. } = &casts[k];
            let reach = DVec2::splat((high.z - lowest) * spread + slack);
            (low.x <= high.x).then(|| [low.truncate() - reach, high.truncate() + reach])
        };
        self.top.sort(casts.len(), casts.len(), rectangle, &mut self.instances, |k| k as u32);
    }

    /// Sets the bits of the light's points that are hidden from `point` (in the world). Bits beyond the last point have
    /// no meaning.
    pub fn hide(&self, point: DVec3, hidden: &mut [u64]) {
        let p = self.from.transpose() * point;
        let flat = p.truncate();
        let Some(near) = self.top.cell(flat) else { return };
        let slack = self.slack;
        for &k in &self.instances[near] {
            let cast = &self.casts[k as usize];
            let reach = (cast.high.z - p.z) * self.spread + slack;
            let (low, high) = (flat - reach, flat + reach);
            let beside = low.cmpgt(cast.high.truncate()) | high.cmplt(cast.low.truncate());
            if cast.high.z < p.z - slack || beside.any() {
                continue;
            }
            let middle = Vec4::new(p.x as f32, p.y as f32, -p.x as f32, -p.y as f32);
            let (height, spread, slack) = (p.z as f32, self.spread as f32, slack as f32);
            let [columns, rows] = cast.grid.cells(low, high);
            for (i, j) in rows.clone().flat_map(|j| columns.clone().map(move |i| (i, j))) {
                for entry in &cast.entries[cast.grid.things([i, j])] {
                    let above = entry.top - height;
                    if above < -slack || !entry.sides.cmple(middle + (above * spread + slack)).all() {
                        continue;
                    }
                    // It is tested in the first cell that it shares with the receiver, and not again.
                    let first = cast.grid.place(DVec2::new(f64::from(entry.sides.x), f64::from(entry.sides.y)));
                    if [first[0].max(*columns.start()), first[1].max(*rows.start())] == [i, j]
                        && self.hide_by(k as usize, entry.triangle as usize, p, hidden)
                    {
                        return;
                    }
                }
            }
        }
    }

    /// Sets the bits that a triangle hides from `p` (in the light's frame). Returns true where no point is left.
    fn hide_by(&self, instance: usize, triangle: usize, p: DVec3, hidden: &mut [u64]) -> bool {
        let leaf = self.stage.world.instances[instance].leaf;
        let (corners, number, by_outline) = self.triangles[leaf][triangle];
        let [a, b, c] = corners.map(|k| self.casts[instance].vertices[k as usize] - p);
        // Let a, b and c be the corners and s a direction. The triangles between s and two corners have the signed
        // volumes s·(a × b) and so on. All three have the sign of a·(b × c) where s goes forwards through the triangle.
        let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
        let volume = a.dot(bc);
        if volume == 0.0 {
            return false;
        }
        let sides = [bc, ca, ab].map(|side| side * volume.signum());
        let around = sides.map(|side| side.truncate().length() * self.spread * (1.0 + 1e-9));
        if (0..3).any(|q| sides[q].z + around[q] < 0.0) {
            return false;
        }
        let cuts = [0, 1, 2].map(|q| sides[q].z - around[q] <= 0.0);
        if cuts == [false; 3] && !by_outline {
            hidden.fill(u64::MAX);
            return true;
        }
        for (word, [x, y]) in hidden.iter_mut().zip(&self.points) {
            let at = |side: DVec3, k: usize| side.x * x[k] + side.y * y[k] + side.z;
            let mut bits = u64::MAX;
            for side in (0..3).filter(|q| cuts[*q]).map(|q| sides[q]) {
                bits &= (0..64).fold(0, |bits, k| bits | u64::from(at(side, k) >= 0.0) << k);
            }
            if by_outline {
                let off = |k: &usize| {
                    let [a, b, c] = sides.map(|side| at(side, *k));
                    let sum = a + b + c;
                    !self.stage.on_leaf(instance, number as usize, [b / sum, c / sum])
                };
                bits &= !*word;
                bits = (0..64).filter(|k| bits >> k & 1 == 1).filter(off).fold(bits, |bits, k| bits & !(1 << k));
            }
            *word |= bits;
        }
        hidden
            .split_last()
            .is_none_or(|(last, others)| last & self.last == self.last && others.iter().all(|word| *word == u64::MAX))
    }
}

/// The triangles of a leaf that are on it, their numbers, and whether only a part of each is.
fn hiding(leaf: &ReferenceLeaf) -> Vec<([u32; 3], u32, bool)> {
    let corners = leaf.mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]);
    corners
        .enumerate()
        .filter_map(|(k, t)| match outline(leaf, t.map(|k| leaf.mesh.uvs[k as usize])) {
            Outline::Off => None,
            on => Some((t, k as u32, on == Outline::Part || leaf.mesh.discs)),
        })
        .collect()
}

impl Cast {
    fn draw(&mut self, positions: &[DVec3], turn: DMat4, triangles: &[([u32; 3], u32, bool)]) {
        self.vertices.clear();
        self.vertices.extend(positions.iter().map(|p| turn.transform_point3(*p)));
        let vertices = &self.vertices;
        let corners = |k: usize| triangles[k].0.map(|c| vertices[c as usize]);
        let bounds = |k: usize| {
            let [a, b, c] = corners(k);
            [a.min(b).min(c), a.max(b).max(c)]
        };
        let entry = |k: usize| {
            let [low, high] = bounds(k);
            let down = |x: f64| (x as f32).next_down();
            Entry {
                sides: Vec4::new(down(low.x), down(low.y), down(-high.x), down(-high.y)),
                top: (high.z as f32).next_up(),
                triangle: k as u32,
            }
        };
        (self.low, self.high) = (0..triangles.len())
            .map(bounds)
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), [a, b]| (low.min(a), high.max(b)));
        // The rectangles are those of the entries' own boxes, so that a triangle's first cell follows from its entry.
        let rectangle = |k: usize| {
            let [x, y, right, up] = entry(k).sides.as_dvec4().to_array();
            Some([DVec2::new(x, y), DVec2::new(-right, -up)])
        };
        self.grid.sort(triangles.len(), triangles.len(), rectangle, &mut self.entries, entry);
    }
}
