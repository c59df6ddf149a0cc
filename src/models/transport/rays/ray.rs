//! A half-line.

use glam::{DAffine3, DVec3};

/// A half-line o + t·d with t > 0; d need not be of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// The beginning of the half-line.
    pub origin: DVec3,
    /// Its direction. t counts in lengths of this vector.
    pub direction: DVec3,
}

impl Ray {
    /// The half-line from `origin` along `direction`.
    pub fn new(origin: DVec3, direction: DVec3) -> Ray {
        Ray { origin, direction }
    }

    /// The same half-line after an affine map. t keeps its meaning.
    #[inline(always)]
    pub(crate) fn through(&self, to_local: &DAffine3) -> Ray {
        Ray::new(to_local.transform_point3(self.origin), to_local.transform_vector3(self.direction))
    }
}
