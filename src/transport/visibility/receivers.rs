//! The points at which visibility is wanted: the vertices of every instance.

use super::refine::{Blade, refine};
use crate::world::World;
use crate::{Error, Result};
use glam::DVec3;
use std::ops::Range;
use std::path::Path;

/// Where a vertex of a blade lies on the drawn mesh: up to three of its vertices, whose weights sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Vertices of the drawn mesh; one triangle's. Those of no weight repeat the first.
    pub corners: [u32; 3],
    /// Their weights.
    pub weights: [f64; 3],
}

/// A point at which visibility is wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Receiver {
    /// Which instance of the world.
    pub instance: usize,
    /// Which vertex of the instance's blade ([`Receivers::blades`]).
    pub vertex: usize,
    /// In the world (mm).
    pub position: DVec3,
    /// Mean normal of the triangles around it, weighted by area, out of their fronts; zero where they have no area.
    pub normal: DVec3,
}

/// All points at which visibility is wanted, instance by instance, each in the order of its blade's vertices.
#[derive(Debug, Clone)]
pub struct Receivers {
    /// The mesh of each leaf of the world: what is drawn where visibility is to be interpolated.
    pub blades: Vec<Blade>,
    /// The first of each instance, and at the end how many there are.
    first: Vec<usize>,
    /// Which leaf each instance shows.
    leaf: Vec<usize>,
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
}

/// Most receivers of a world.
pub const MOST_RECEIVERS: usize = 100_000_000;

impl Receivers {
    /// The vertices of all instances, the edges of leaf k at most `edge_mm[k]` long in its own lengths (infinite, or no
    /// entry: as drawn). What a leaf's outline cuts away has none.
    ///
    /// # Errors
    /// [`Error::Input`] for a world that is not sound, a leaf of discs, or more than [`MOST_RECEIVERS`].
    pub fn new(world: &World, edge_mm: &[f64]) -> Result<Receivers> {
        world.validate()?;
        let edge = |k: usize| edge_mm.get(k).copied().unwrap_or(f64::INFINITY);
        let blades: Vec<Blade> =
            world.leaves.iter().enumerate().map(|(k, leaf)| refine(leaf, edge(k), k)).collect::<Result<_>>()?;
        let count: usize = world.instances.iter().map(|p| blades[p.leaf].mesh.positions.len()).sum();
        if count > MOST_RECEIVERS {
            let what = format!("{count} vertices that want visibility, expected at most {MOST_RECEIVERS}");
            return Err(Error::input(Path::new("visibility"), what));
        }
        let flat: Vec<Vec<DVec3>> = blades.iter().map(normals).collect();
        let mut out = Receivers {
            blades,
            first: vec![0],
            leaf: world.instances.iter().map(|p| p.leaf).collect(),
            positions: Vec::with_capacity(count),
            normals: Vec::with_capacity(count),
        };
        for placed in &world.instances {
            let turn = placed.transform;
            out.positions.extend(out.blades[placed.leaf].mesh.positions.iter().map(|p| turn.transform_point3(*p)));
            // A uniform scale, which may mirror, turns normals as it turns lengths.
            out.normals.extend(flat[placed.leaf].iter().map(|n| turn.transform_vector3(*n).normalize_or_zero()));
            out.first.push(out.positions.len());
        }
        Ok(out)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Those of one instance: vertex v of its blade is the (start + v)-th of all.
    pub fn of(&self, instance: usize) -> Range<usize> {
        self.first[instance]..self.first[instance + 1]
    }

    /// The blade that an instance shows.
    pub fn blade(&self, instance: usize) -> &Blade {
        &self.blades[self.leaf[instance]]
    }

    /// The `k`-th of all.
    pub fn get(&self, k: usize) -> Receiver {
        let instance = self.first.partition_point(|first| *first <= k) - 1;
        Receiver { instance, vertex: k - self.first[instance], position: self.positions[k], normal: self.normals[k] }
    }

    /// Where each is (mm), in order.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// The normal of each ([`Receiver::normal`]).
    pub fn normals(&self) -> &[DVec3] {
        &self.normals
    }
}

/// Mean normals of the triangles around each vertex.
fn normals(blade: &Blade) -> Vec<DVec3> {
    let mesh = &blade.mesh;
    let mut sum = vec![DVec3::ZERO; mesh.positions.len()];
    for t in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|k| mesh.positions[t[k] as usize]);
        t.iter().for_each(|k| sum[*k as usize] += (b - a).cross(c - a));
    }
    sum.into_iter().map(DVec3::normalize_or_zero).collect()
}
