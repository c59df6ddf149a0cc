//! What stands in the light of one direction, on the plane across it.
//!
//! All light of a map comes nearly from one direction, so that the scene is looked at from there once: every instance's
//! triangles are entered into a grid on the plane across the direction, and a receiver looks only at the triangles of
//! its own cells. What a triangle hides of the light is a set of the light's points, one bit each; a triangle that
//! hides all of them or none is told by three numbers. So a receiver costs about as much as one ray, however many
//! points the light has.
//!
//! Whether a point is hidden is decided by signed volumes (as in Plücker coordinates), the same number for both triangles
//! of an edge: no light falls through between them.

use super::grid::Grid;
use super::light::{AreaLight, frame};
use super::refine::{Outline, outline};
use crate::stage::Stage;
use crate::world::ReferenceLeaf;
use glam::{DMat3, DMat4, DVec2, DVec3, Vec2};
use rayon::prelude::*;

/// The scene as one light's direction sees it.
pub(super) struct Casters<'a> {
    stage: &'a Stage<'a>,
    /// Points of the light as tangents, 64 a word of bits; those beyond the last are never looked at.
    points: Vec<[[f64; 64]; 2]>,
    /// The bits of the last word that stand for points.
    last: u64,
    /// Largest tangent of a point.
    spread: f64,
    /// Triangles of each leaf that may hide something, and whether the outline has to be asked.
    triangles: Vec<Vec<([u32; 3], u32, bool)>>,
    casts: Vec<Cast>,
    /// Over all instances.
    top: Grid,
    instances: Vec<u32>,
    from: DMat3,
}

/// An instance as the light sees it: x across, y up, z towards the light (mm).
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
    low: Vec2,
    high: Vec2,
    /// Nearest to the light.
    top: f32,
    /// Which of the leaf's.
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
            triangles: stage.world.leaves.iter().map(hiding).collect(),
            casts: stage.world.instances.iter().map(|_| Cast::default()).collect(),
            top: Grid::default(),
            instances: Vec::new(),
            from: DMat3::IDENTITY,
        }
    }

    /// Words of bits that the light has.
    pub fn words(&self) -> usize {
        self.points.len()
    }

    /// Looks at the scene from `direction`.
    pub fn look_from(&mut self, direction: DVec3) {
        self.from = frame(direction);
        let (world, triangles, turn) = (self.stage.world, &self.triangles, DMat4::from_mat3(self.from.transpose()));
        self.casts.par_iter_mut().zip(&world.instances).for_each(|(cast, placed)| {
            cast.draw(&world.leaves[placed.leaf].mesh.positions, turn * placed.transform, &triangles[placed.leaf]);
        });
        let lowest = self.casts.iter().map(|c| c.low.z).fold(f64::INFINITY, f64::min);
        let (casts, spread, step) = (&self.casts, self.spread, self.stage.step());
        let rectangle = |k: usize| {
            let Cast { low, high, .. } = &casts[k];
            let reach = DVec2::splat((high.z - lowest) * spread + 4.0 * step);
            (low.x <= high.x).then(|| [low.truncate() - reach, high.truncate() + reach])
        };
        self.top.sort(casts.len(), casts.len(), rectangle, &mut self.instances, |k| k as u32);
    }

    /// Sets the bits of the light's points that are hidden from `point` (in the world); those beyond the last point mean
    /// nothing.
    pub fn hide(&self, point: DVec3, hidden: &mut [u64]) {
        let p = self.from.transpose() * point;
        let flat = p.truncate();
        let slack = 4.0 * self.stage.step();
        for &k in self.top.cell(flat).map_or(&[][..], |cell| &self.instances[cell]) {
            let cast = &self.casts[k as usize];
            let reach = (cast.high.z - p.z) * self.spread + slack;
            let (low, high) = (flat - reach, flat + reach);
            let beside =
                |low: DVec2, high: DVec2| (low.cmpgt(cast.high.truncate()) | high.cmplt(cast.low.truncate())).any();
            if cast.high.z < p.z - slack || beside(low, high) {
                continue;
            }
            for cell in cast.grid.cells(low, high) {
                for entry in &cast.entries[cell] {
                    let height = f64::from(entry.top) - p.z;
                    let reach = height * self.spread + slack;
                    if height > -slack
                        && !(flat - reach).cmpgt(entry.high.as_dvec2()).any()
                        && !(flat + reach).cmplt(entry.low.as_dvec2()).any()
                        && self.hide_by(k as usize, entry.triangle as usize, p, hidden)
                    {
                        return;
                    }
                }
            }
        }
    }

    /// Sets the bits that a triangle hides from `p` (in the light's frame); true where none is left.
    fn hide_by(&self, instance: usize, triangle: usize, p: DVec3, hidden: &mut [u64]) -> bool {
        let leaf = self.stage.world.instances[instance].leaf;
        let (corners, number, by_outline) = self.triangles[leaf][triangle];
        let [a, b, c] = corners.map(|k| self.casts[instance].vertices[k as usize] - p);
        // Twice the areas of the triangles that a direction s makes with two corners are s·(a × b) …; all have the sign
        // of the volume where s goes through the triangle, and forwards.
        let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
        let volume = a.dot(bc);
        if volume == 0.0 {
            return false;
        }
        let sides = [bc, ca, ab].map(|side| side * volume.signum());
        let (mut least, mut most) = (f64::INFINITY, f64::INFINITY);
        for side in sides {
            let around = side.truncate().length() * self.spread * (1.0 + 1e-9);
            least = least.min(side.z - around);
            most = most.min(side.z + around);
        }
        if most < 0.0 {
            return false;
        }
        if least > 0.0 && !by_outline {
            hidden.fill(u64::MAX);
            return true;
        }
        for (word, [x, y]) in hidden.iter_mut().zip(&self.points) {
            let at = |side: DVec3, k: usize| side.x * x[k] + side.y * y[k] + side.z;
            let mut bits = 0;
            for k in 0..64 {
                let inside = (at(sides[0], k) >= 0.0) & (at(sides[1], k) >= 0.0) & (at(sides[2], k) >= 0.0);
                bits |= u64::from(inside) << k;
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
        let (last, others) = hidden.split_last().expect("a light has a point");
        last & self.last == self.last && others.iter().all(|word| *word == u64::MAX)
    }
}

/// The triangles of a leaf that are on it, their numbers, and whether only a part is.
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
        let entry = |k: usize| {
            let [a, b, c] = corners(k);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let (low, high) =
                (low.as_vec3().to_array().map(f32::next_down), high.as_vec3().to_array().map(f32::next_up));
            Entry {
                low: Vec2::new(low[0], low[1]),
                high: Vec2::new(high[0], high[1]),
                top: high[2],
                triangle: k as u32,
            }
        };
        let bounds = |k: usize| {
            let [a, b, c] = corners(k);
            [a.min(b).min(c), a.max(b).max(c)]
        };
        (self.low, self.high) = (0..triangles.len())
            .map(bounds)
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), [a, b]| (low.min(a), high.max(b)));
        let rectangle = |k: usize| Some(bounds(k).map(DVec3::truncate));
        self.grid.sort(triangles.len(), triangles.len(), rectangle, &mut self.entries, entry);
    }
}
