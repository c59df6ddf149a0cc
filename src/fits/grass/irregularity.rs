//! Irregular lawns, whose rectangles all show other parts of the meadow.

use glam::UVec3;

/// In an irregular lawn, every rectangle shows the meadow moved by a whole number of these parts of its sides. Slices
/// stay where they are, so their number is a multiple of it.
pub const SHIFTS: usize = 8;

/// By how many [`SHIFTS`] of its sides a rectangle of an irregular lawn is moved. Its point at a share p of a side
/// shows what the meadow has at p plus this. The rectangle around the origin is the first, and the count goes on
/// without end in all directions. The hash is pcg3d of the rectangle and the seed, of whose numbers the highest bits
/// count (Jarzynski and Olano, "Hash functions for GPU rendering", 2020).
pub fn shifted(seed: u32, rectangle: [i64; 2]) -> [usize; 2] {
    let [x, y] = rectangle.map(|k| k as u32);
    let mut v = UVec3::new(x, y, seed).wrapping_mul(UVec3::splat(1_664_525)).wrapping_add(UVec3::splat(1_013_904_223));
    for round in 0..2 {
        v.x = v.x.wrapping_add(v.y.wrapping_mul(v.z));
        v.y = v.y.wrapping_add(v.z.wrapping_mul(v.x));
        v.z = v.z.wrapping_add(v.x.wrapping_mul(v.y));
        if round == 0 {
            v ^= v >> 16;
        }
    }
    [v.x, v.y].map(|k| ((k >> 16) as usize * SHIFTS) >> 16)
}
