//! The things that move a scene: branches that bend, sections that carry leaves and bark, and the wind.

#[cfg(doc)]
use super::Instance;
use glam::{Quat, Vec3};
use std::sync::Arc;

/// The largest number of branches, which fill the smallest uniform buffer that every adapter has.
pub const MOST_BRANCHES: usize = 128;

/// How an instance hangs on a branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ride {
    /// Index into the scene's branches.
    pub branch: usize,
    /// The place where it hangs, rigidly, from 0 (root) to 1 (tip). With `None`, the mesh is the branch itself and
    /// bends at every vertex.
    pub at: Option<f32>,
}

/// How sections carry an instance.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    /// Computes all sections at a time (s).
    pub at: Arc<dyn Fn(f64) -> Vec<Section> + Send + Sync>,
}

/// A rigid motion: it moves a point p to `to` + `turn` (p − `from`).
#[derive(Debug, Clone, Copy, PartialEq)]
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

/// A branch at rest, and how it bends. Amplitudes are in units of its length for the normalised deflection u = a₂y² +
/// a₃y³ + a₄y⁴ + a₅y⁵ with y = ln(1 + (α − 1)x)/ln α. The tip moves by amplitude · Σa · length, before a correction
/// that keeps the length.
/// length is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Branch {
    /// The place where its axis begins.
    pub root: Vec3,
    /// Unit vector from root to tip.
    pub t: Vec3,
    /// A unit vector across the branch.
    pub r: Vec3,
    /// A unit vector across the branch: r = s × t.
    pub s: Vec3,
    /// Length of the axis, in the world's units.
    pub length: f32,
    /// α, tip radius over root radius.
    pub alpha: f32,
    /// ln α.
    pub ln_alpha: f32,
    /// ln α/(α − 1), which is 1 at α = 1.
    pub ell: f32,
    /// Coefficients a₂ to a₅ of the deflection.
    pub a: [f32; 4],
    /// Amplitude towards r and s without gusts, by the weight and by the mean wind.
    pub still: [f32; 2],
    /// Amplitude for 1 in the motion texture.
    pub gain: f32,
    /// The branch's place in the motion texture at time 0. From there it moves along a line.
    pub start: [f64; 2],
    /// Velocity along this line, in sides of the texture for each second.
    pub velocity: [f64; 2],
}

/// Gusts: a periodic texture, whose two channels drive the deflections towards r and s, and the time.
#[derive(Debug, Clone)]
pub struct Wind {
    /// Texels along a side of the texture. They are stored row by row with centres at (i + ½)/size; the texture is
    /// sampled linearly and repeats. With 0, no branch sways.
    pub size: u32,
    /// The texels, row by row.
    pub motion: Vec<[f32; 2]>,
    /// Time since the beginning of the scene.
    pub time_s: f64,
}
