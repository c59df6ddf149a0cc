//! The cross-sections of a branch that carry its bark.

use crate::form::{Branch, nearest};
use std::collections::BTreeMap;

/// A vertex whose share differs by at most this from that of a point of the axis follows the section there. The corners
/// of a ring stand nearly, but not quite, at one share of a bent axis, so a ring has one section and not three. On a
/// branch that is evenly bent by a radian, the place of such a vertex is then wrong by at most 1e-3 of the branch's
/// radius and 5e-7 of its length.
const RING: f64 = 1.0 / 1024.0;
/// Sections between the points of the axis lie at multiples of this share of a branch, and a vertex follows the nearest
/// one. On a branch that is evenly bent by a radian, its place is then wrong by at most 1e-4 of the branch's radius.
const STEP: f64 = 1.0 / 8192.0;

/// How the cross-sections of a branch carry its bark.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BarkCarriers {
    /// Shares of the axis (0 root, 1 tip), each of them once, in the order in which the vertices need them.
    pub at: Vec<f64>,
    /// Which of these sections carries each vertex of the branch's wood.
    pub of_vertices: Vec<u32>,
}

/// The share of a branch's length at which each point of its axis lies; 0 for a branch without length.
pub fn shares(branch: &Branch) -> Vec<f64> {
    let length = branch.length();
    let mut before = 0.0;
    let steps = branch.axis.windows(2).map(|w| w[0].distance(w[1]));
    let ends = steps.map(|step| {
        before += step;
        if length > 0.0 { before / length } else { 0.0 }
    });
    std::iter::once(0.0).chain(ends).collect()
}

impl BarkCarriers {
    /// The sections that carry a branch's bark.
    pub fn new(branch: &Branch) -> BarkCarriers {
        let mut joints = shares(branch);
        if joints.len() as f64 * STEP > 1.0 {
            // In the mean they stand as near to each other as the multiples of the step. So a branch has at most 16,385
            // sections, which a glTF file can number in two bytes.
            joints.clear();
        }
        let mut bark = BarkCarriers::default();
        let mut known = BTreeMap::new();
        for vertex in &branch.wood.positions {
            let share = nearest(&branch.axis, *vertex).0;
            let after = joints.partition_point(|j| *j < share);
            let beside = joints[after.saturating_sub(1)..].iter().take(2);
            let joint = beside.copied().min_by(|a, b| (a - share).abs().total_cmp(&(b - share).abs()));
            let at = joint.filter(|j| (j - share).abs() <= RING).unwrap_or((share / STEP).round() * STEP);
            let section = *known.entry(at.to_bits()).or_insert_with(|| {
                bark.at.push(at);
                bark.at.len() as u32 - 1
            });
            bark.of_vertices.push(section);
        }
        bark
    }
}
