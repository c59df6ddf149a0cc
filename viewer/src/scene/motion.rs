//! The things that move a scene: sections that carry leaves and bark, and the time of the wind.

#[cfg(doc)]
use super::Instance;
use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How sections carry an instance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SectionBinding {
    /// The section, or the first section if the vertices have sections of their own.
    pub first: u32,
    /// First entry in [`SectionAnimation::of_vertices`] for the mesh's vertices. With `None`, one section carries the
    /// whole instance.
    pub vertices: Option<u32>,
}

/// Rigid motions in world space at a time (s). Each is that of a cross-section of a plant's branch.
#[derive(Clone)]
pub struct SectionAnimation {
    /// Number of sections, which is the same at any time.
    pub count: usize,
    /// For each vertex of bark, the section that carries it, counted from the instance's first section.
    pub of_vertices: Arc<Vec<u32>>,
    /// Whether normals and tangents turn with the sections. If not, surfaces are lit as if they had not turned.
    pub turn_normals: bool,
    /// Computes all sections at a time (s).
    pub at: Arc<dyn Fn(f64) -> Vec<SectionMotion> + Send + Sync>,
    /// How the adapter computes the same sections for pictures; without it, the CPU computes them for each time.
    pub poses: Option<Arc<PoseHierarchy>>,
}

/// A hierarchy of branches that bend, for the adapter ([`SectionAnimation::poses`]). Places and directions are in world
/// space and at rest.
pub struct PoseHierarchy {
    /// The branches. A parent stands before what grows on it.
    pub limbs: Vec<PoseLimb>,
    /// The pieces of the axes of all branches, in the order of the branches; no two branches share any.
    pub pieces: Vec<AxisPiece>,
    /// Where each section sits, in the order of the sections.
    pub seats: Vec<SectionSeat>,
    /// Whether lengths of branches are kept in closed form only.
    pub closed_form: bool,
    /// The amplitude of each branch towards its r and s at a time (s).
    pub amplitudes: Arc<dyn Fn(f64) -> Vec<[f32; 2]> + Send + Sync>,
    /// The angle (rad) by which each section turns about its seat's axis at a time (s), before the branch carries it.
    pub turns: Option<Arc<dyn Fn(f64) -> Vec<f32> + Send + Sync>>,
}

/// A branch that bends in its own frame, and follows its parent where it grows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseLimb {
    /// The place where it begins.
    pub root: Vec3,
    /// Unit vectors from root to tip (t) and across (r).
    pub axes: [Vec3; 2],
    /// Length along the axis (mm).
    pub length: f32,
    /// Taper (tip radius over root radius), its logarithm ln α, and ln α/(α − 1).
    pub taper: [f32; 3],
    /// Coefficients of the deflection.
    pub coefficients: [f32; 4],
    /// The branch that it grows on.
    pub parent: Option<u32>,
    /// Where on the parent's axis (0 root, 1 tip), and on which of the parent's pieces.
    pub at: (f32, u32),
    /// Its root from that place.
    pub offset: Vec3,
    /// Its first piece among all pieces, and their number, which is at least 1. The first begins at 0.
    pub pieces: [u32; 2],
}

/// A straight piece of a branch's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisPiece {
    /// The share of the branch's length at which it begins.
    pub begin: f32,
    /// Where it begins, from the branch's root.
    pub place: Vec3,
    /// Its unit direction.
    pub way: Vec3,
}

/// Where a section sits on a branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SectionSeat {
    /// The branch.
    pub limb: u32,
    /// 0 at the root, 1 at the tip.
    pub share: f32,
    /// The piece of the branch at that share, which lies between the piece's beginning and its end.
    pub piece: u32,
    /// The point whose place the section states ([`SectionMotion::from`]).
    pub from: Vec3,
    /// From the axis to that point.
    pub offset: Vec3,
    /// The unit vector about which the section turns.
    pub axis: Vec3,
}

/// A rigid motion: it moves a point p to `to` + `turn` (p − `from`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SectionMotion {
    /// A point at rest.
    pub from: Vec3,
    /// The place that this point moves to.
    pub to: Vec3,
    /// The rotation of directions.
    pub turn: Quat,
}

impl std::fmt::Debug for SectionAnimation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Sections({}, of {} vertices)", self.count, self.of_vertices.len())
    }
}

/// The wind of a scene, which moves sections and lawns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WindState {
    /// Time since the beginning of the scene.
    pub time_s: f64,
}
