//! Triangles that a file has twice, as the back of a leaf that is drawn as triangles of its own.

use glam::DVec3;
use std::collections::HashSet;

/// Finds triangles whose three corners are those of another, in either order. A leaf is one surface with two sides, so
/// such a pair is one triangle.
#[derive(Debug, Clone, Default)]
pub struct DuplicateTriangles {
    seen: HashSet<[[u64; 3]; 3]>,
    /// How many were found.
    pub found: usize,
}

impl DuplicateTriangles {
    /// Whether a triangle with these corners came before.
    pub fn again(&mut self, corners: [DVec3; 3]) -> bool {
        // + 0.0 makes one zero of both.
        let mut key = corners.map(|p| p.to_array().map(|v| (v + 0.0).to_bits()));
        key.sort_unstable();
        let again = !self.seen.insert(key);
        self.found += usize::from(again);
        again
    }
}
