//! The things that move a scene: sections that carry leaves and bark, and the time of the wind.

#[cfg(doc)]
use super::Instance;
use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How sections carry an instance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Carried {
    /// The section, or the first section if the vertices have sections of their own.
    pub first: u32,
    /// First entry in [`Sections::of_vertices`] for the mesh's vertices. With `None`, one section carries the whole
    /// instance.
    pub vertices: Option<u32>,
}

/// Rigid motions in world space at a time (s). Each is that of a cross-section of a plant's branch.
#[derive(Clone)]
pub struct Sections {
    /// Number of sections, which is the same at any time.
    pub count: usize,
    /// For each vertex of bark, the section that carries it, counted from the instance's first section.
    pub of_vertices: Arc<Vec<u32>>,
    /// Whether normals and tangents turn with the sections. If not, surfaces are lit as if they had not turned.
    pub turn_normals: bool,
    /// Computes all sections at a time (s).
    pub at: Arc<dyn Fn(f64) -> Vec<Section> + Send + Sync>,
}

/// A rigid motion: it moves a point p to `to` + `turn` (p − `from`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// A point at rest.
    pub from: Vec3,
    /// The place that this point moves to.
    pub to: Vec3,
    /// The rotation of directions.
    pub turn: Quat,
}

impl std::fmt::Debug for Sections {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Sections({}, of {} vertices)", self.count, self.of_vertices.len())
    }
}

/// The wind of a scene, which moves sections and lawns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Wind {
    /// Time since the beginning of the scene.
    pub time_s: f64,
}
