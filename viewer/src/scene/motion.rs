//! What moves a scene: branches that bend, sections that carry leaves and bark, and the wind.

#[cfg(doc)]
use super::Instance;
use glam::{Quat, Vec3};
use std::sync::Arc;

/// As many branches as fill the smallest uniform buffer every adapter has.
pub const MOST_BRANCHES: usize = 128;

/// How an instance hangs on a branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ride {
    /// Index into the scene's branches.
    pub branch: usize,
    /// Where it hangs, rigidly: 0 (root) to 1 (tip). `None`: the mesh is the branch itself and bends at every vertex.
    pub at: Option<f32>,
}

/// How sections carry an instance about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    /// The section, or the first of those that the mesh's vertices count from.
    pub first: u32,
    /// Where [`Sections::of_vertices`] begins for the mesh's vertices; `None`: the whole instance is carried by one.
    pub vertices: Option<u32>,
}

/// Rigid motions in world space, a cross-section of a plant's branch each, as they are at a time (s).
#[derive(Clone)]
pub struct Sections {
    /// How many there are, at any time.
    pub count: usize,
    /// Of the vertices of bark: which section carries each, counted from the instance's first.
    pub of_vertices: Arc<Vec<u32>>,
    /// All of them at a time (s).
    pub at: Arc<dyn Fn(f64) -> Vec<Section> + Send + Sync>,
}

/// A rigid motion: a point p goes to `to` + `turn` (p − `from`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// A point at rest.
    pub from: Vec3,
    /// Where it goes.
    pub to: Vec3,
    /// How directions turn.
    pub turn: Quat,
}

impl std::fmt::Debug for Sections {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Sections({}, of {} vertices)", self.count, self.of_vertices.len())
    }
}

/// A branch at rest and how it bends. Amplitudes are in units of its length for the normalised deflection
/// u = a₂y² + a₃y³ + a₄y⁴ + a₅y⁵ with y = ln(1 + (α − 1)x)/ln α: the tip goes by amplitude · Σa · length, before the
/// length is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Branch {
    /// Where its axis begins.
    pub root: Vec3,
    /// From root to tip, a unit vector.
    pub t: Vec3,
    /// A unit vector across the branch.
    pub r: Vec3,
    /// A unit vector across the branch: r = s × t.
    pub s: Vec3,
    /// Of the axis, in the world's units.
    pub length: f32,
    /// α, tip radius over root radius.
    pub alpha: f32,
    /// ln α.
    pub ln_alpha: f32,
    /// ln α/(α − 1), which is 1 at α = 1.
    pub ell: f32,
    /// Coefficients a₂ to a₅ of the deflection.
    pub a: [f32; 4],
    /// Amplitude towards r and s without gusts: weight and mean wind.
    pub still: [f32; 2],
    /// Amplitude per unit of the motion texture.
    pub gain: f32,
    /// Line through the motion texture: where at time 0, and texture sides a second.
    pub start: [f64; 2],
    /// Texture sides a second.
    pub velocity: [f64; 2],
}

/// Gusts: a periodic texture whose channels drive the deflections towards r and s, and the time.
#[derive(Debug, Clone)]
pub struct Wind {
    /// Texels a side; row-major, texel centres at (i + ½)/size, sampled linearly and repeated. 0: no branch sways.
    pub size: u32,
    /// Row by row.
    pub motion: Vec<[f32; 2]>,
    /// Since the beginning of the scene.
    pub time_s: f64,
}
