//! The points at which visibility is computed: the vertices of every instance.

use super::refinement::{VisibilityMesh, refine};
use crate::world::ReferenceWorld;
use crate::{Error, Result};
use glam::DVec3;
use std::ops::Range;
use std::path::Path;

/// The place of a blade's vertex on the drawn mesh: up to three of its vertices, with weights that sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VertexPlace {
    /// Vertices of one triangle of the drawn mesh. Those with weight 0 repeat the first one.
    pub corners: [u32; 3],
    /// Their weights.
    pub weights: [f64; 3],
}

/// A point at which visibility is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadowReceiver {
    /// Index of the instance in the world.
    pub instance: usize,
    /// Index of the vertex in the instance's blade ([`ShadowReceivers::blades`]).
    pub vertex: usize,
    /// Place in the world (mm).
    pub position: DVec3,
    /// Mean normal of the triangles around it, weighted by area, out of their fronts; zero where they have no area.
    pub normal: DVec3,
}

/// All points at which visibility is computed. Instances follow each other, and each has the order of its blade's
/// vertices.
#[derive(Debug, Clone)]
pub struct ShadowReceivers {
    /// The mesh of each leaf of the world. It is drawn where visibility is interpolated.
    pub blades: Vec<VisibilityMesh>,
    /// Index of the first receiver of each instance, and at the end the number of all.
    first: Vec<usize>,
    /// Index of the leaf of each instance.
    leaf: Vec<usize>,
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
}

/// The largest number of receivers of a world.
pub const MOST_RECEIVERS: usize = 100_000_000;

impl ShadowReceivers {
    /// The vertices of all instances. Edges of leaf k are at most `edge_mm[k]` long in its own lengths; if this is
    /// infinite or missing, they stay as drawn. Parts that a leaf's outline cuts away have no receivers.
    ///
    /// # Errors
    /// [`Error::Input`] for a world that contradicts itself or has groups of instances, a leaf of discs, or more than
    /// [`MOST_RECEIVERS`].
    pub fn new(world: &ReferenceWorld, edge_mm: &[f64]) -> Result<ShadowReceivers> {
        world.validate()?;
        if !world.places.is_empty() {
            let what = "groups of instances, expected instances that are each stored";
            return Err(Error::input(Path::new("visibility"), what));
        }
        let edge = |k: usize| edge_mm.get(k).copied().unwrap_or(f64::INFINITY);
        let blades: Vec<VisibilityMesh> =
            world.leaves.iter().enumerate().map(|(k, leaf)| refine(leaf, edge(k), k)).collect::<Result<_>>()?;
        let count: usize = world.instances.iter().map(|p| blades[p.leaf].mesh.positions.len()).sum();
        if count > MOST_RECEIVERS {
            let what = format!("{count} vertices that want visibility, expected at most {MOST_RECEIVERS}");
            return Err(Error::input(Path::new("visibility"), what));
        }
        let flat: Vec<Vec<DVec3>> = blades.iter().map(normals).collect();
        let mut out = ShadowReceivers {
            blades,
            first: vec![0],
            leaf: world.instances.iter().map(|p| p.leaf).collect(),
            positions: Vec::with_capacity(count),
            normals: Vec::with_capacity(count),
        };
        for placed in &world.instances {
            let turn = placed.transform;
            out.positions.extend(out.blades[placed.leaf].mesh.positions.iter().map(|p| turn.transform_point3(*p)));
            // The scale is uniform and may mirror, so normals turn like directions.
            out.normals.extend(flat[placed.leaf].iter().map(|n| turn.transform_vector3(*n).normalize_or_zero()));
            out.first.push(out.positions.len());
        }
        Ok(out)
    }

    /// Number of receivers.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// The range of one instance's receivers: vertex v of its blade is number start + v.
    pub fn of(&self, instance: usize) -> Range<usize> {
        self.first[instance]..self.first[instance + 1]
    }

    /// The blade that an instance shows.
    pub fn blade(&self, instance: usize) -> &VisibilityMesh {
        &self.blades[self.leaf[instance]]
    }

    /// The receiver with the number `k`.
    pub fn get(&self, k: usize) -> ShadowReceiver {
        let instance = self.first.partition_point(|first| *first <= k) - 1;
        ShadowReceiver {
            instance,
            vertex: k - self.first[instance],
            position: self.positions[k],
            normal: self.normals[k],
        }
    }

    /// Place of each receiver (mm), in order.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// The normal of each ([`ShadowReceiver::normal`]).
    pub fn normals(&self) -> &[DVec3] {
        &self.normals
    }
}

/// Mean normals of the triangles around each vertex.
fn normals(blade: &VisibilityMesh) -> Vec<DVec3> {
    let mesh = &blade.mesh;
    let mut sum = vec![DVec3::ZERO; mesh.positions.len()];
    for t in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|k| mesh.positions[t[k] as usize]);
        t.iter().for_each(|k| sum[*k as usize] += (b - a).cross(c - a));
    }
    sum.into_iter().map(DVec3::normalize_or_zero).collect()
}
