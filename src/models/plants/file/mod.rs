//! A plant as glTF: what a file holds, and how it is read back.
//!
//! The scene has one node for the plant, which turns it to y up and scales mm to metres. Below it every branch is a
//! node, placed in the node of the branch that it grows on. The node's frame is the branch's own, with x along the axis
//! at its beginning. Its mesh is the bark, and its `extras` hold [`NodeExtras`]. Leaves are instances
//! (`EXT_mesh_gpu_instancing`) in a node below their branch. The attribute `_AT` gives the place of each leaf on the
//! branch.
//!
//! A reader without the extension draws one leaf for each branch. Plain nodes with a mesh below a branch are read as
//! leaves too. Their place is `at` in their `extras` or, where that is missing, the nearest place on the axis.
//!
//! A file without such nodes, as other programs write it, can be read as a plant that stands still ([`read_any`]).
//!
//! A plant that moves ([`write_moving`]) has leaves as plain nodes. Its bark is skinned meshes beside the plant's node.

mod moving_parts;
mod pivots;
mod reader;
#[cfg(test)]
mod tests;
mod writer;

pub use moving_parts::{MovingParts, write_moving};
pub use pivots::write_pivots;
pub(crate) use reader::count;
pub use reader::{branched, read, read_any};
pub use writer::write;

use serde::{Deserialize, Serialize};

pub use mesophyll_files::gltf_file::{INSTANCING, MOST_TRIANGLES};

/// What the `extras` of a branch's node state, in addition to its frame. Lengths are in the node's own units, which are
/// mm in files of this program.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeExtras {
    /// Level of the branch; 0 is a trunk.
    pub level: usize,
    /// Share of the parent's axis at which it grows; absent for a trunk.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub at: Option<f64>,
    /// Length along the axis.
    pub length_mm: f64,
    /// Radius at the root.
    pub root_radius_mm: f64,
    /// Radius at the tip.
    pub tip_radius_mm: f64,
    /// Tip radius over root radius.
    #[serde(default)]
    pub taper: f64,
    /// F/(E′r₁⁴) under the load that it carries.
    #[serde(default)]
    pub load_over_stiffness_mm: f64,
    /// The part of this load that the shape does not show yet. A scene bends the branch under it.
    #[serde(skip_serializing_if = "is_zero", default)]
    pub bending_load_mm: f64,
    /// Deflection of the tip over the length for each m/s of a steady wind across the branch; 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lean_per_m_s: Option<f64>,
    /// Resonance frequency.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub resonance_hz: Option<f64>,
    /// Damping relative to critical damping.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub damping: Option<f64>,
    /// Points of the axis in the node's frame. Where they are missing, the axis is a straight line along x.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub axis_mm: Vec<[f64; 3]>,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Name, in the `extras` of a meadow's node, of the rectangle that repeats. It is in the node's own units.
const PERIOD: &str = "period_mm";

/// The `extras` of a branch's node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Extras {
    branch: NodeExtras,
}
