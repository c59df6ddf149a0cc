//! The sun's disk.

use crate::scene::Sun;
use glam::Vec3;

/// Directions to the sun's disk: the centre alone, or `n` points that each represent the same share of it.
pub(crate) fn disk_directions(sun: &Sun, n: u32) -> Vec<Vec3> {
    let centre = sun.direction.normalize();
    if n == 1 || sun.radius == 0.0 {
        return vec![centre; n as usize];
    }
    let (a, b) = centre.any_orthonormal_pair();
    let golden = std::f32::consts::PI * (3.0 - 5.0f32.sqrt());
    (0..n)
        .map(|i| {
            let tan = sun.radius.tan() * ((i as f32 + 0.5) / n as f32).sqrt();
            let (sin, cos) = (i as f32 * golden).sin_cos();
            (centre + tan * (cos * a + sin * b)).normalize()
        })
        .collect()
}
