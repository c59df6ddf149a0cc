//! A picture of the meadow, drawn from its blades and from its slices, for people to look at.

use crate::grass::Result;
use crate::grass::blades::LawnMeadow;
use crate::grass::judge::{LawnAppearance, LawnRays, of_blades, of_slices, towards};
use crate::grass::march::LawnSlices;
use glam::DVec3;
use mesophyll_files::image::{to_srgb8, write_png};
use rayon::prelude::*;
use std::path::Path;

/// Pixels of each of the two views.
const SIZE: [usize; 2] = [640, 280];
/// Number of rays along each side of a pixel, for the blades and for the slices. A shader also follows one ray a pixel.
const RAYS: [usize; 2] = [3, 1];
/// Irradiance of an even sky relative to the sun's, and the value that is drawn white. Only this picture uses them.
const SKY: f64 = 0.3;
const WHITE: f64 = 0.22;
/// Reflectance of the ground, which lies in shade.
const GROUND: [f64; 3] = [0.06, 0.045, 0.03];
/// Pixels between the views.
const GAP: usize = 6;

/// Draws the blades (above) and the slices (below) from 25° over the ground, under the sun of
/// [`crate::grass::judge::SUN`].
///
/// # Errors
/// [`crate::grass::Error::Write`] where the file cannot be written.
pub fn write(path: &Path, meadow: &LawnMeadow, slices: &LawnSlices) -> Result<()> {
    let blades = view(meadow, RAYS[0], |rays, o, d| of_blades(meadow, rays, o, d));
    let other = view(meadow, RAYS[1], |rays, o, d| {
        // As in a shader, the level follows from the size of the sheet's texel and the size of the pixel on the slice.
        let texel = slices.period[0] / slices.upright.cell[0] as f64;
        let level = (rays.level / texel).log2().max(0.0);
        of_slices(slices, LawnRays { level, ..rays }, usize::MAX, o, d)
    });
    let gap = vec![255; 3 * GAP * SIZE[0]];
    write_png(path, SIZE[0], 2 * SIZE[1] + GAP, &[blades, gap, other].concat())
}

/// Draws one view with `side` rays along each side of a pixel. `look` gets the width that a ray represents (mm) as its
/// level.
fn view(meadow: &LawnMeadow, side: usize, look: impl Fn(LawnRays, DVec3, DVec3) -> LawnAppearance + Sync) -> Vec<u8> {
    let [w, h] = SIZE;
    let back = towards(25.0, 250.0);
    let far = 0.9 * meadow.period[0] + 2.0 * meadow.height;
    let eye = back * far + DVec3::Z * meadow.height;
    let right = DVec3::Z.cross(back).normalize();
    let up = back.cross(right);
    let size = 0.9 / (w * side) as f64;
    let pixel = |k: usize| {
        let mut sum = [0.0; 3];
        for i in 0..side * side {
            let x = ((k % w) * side + i % side) as f64 + 0.5 - 0.5 * (w * side) as f64;
            let y = ((k / w) * side + i / side) as f64 + 0.5 - 0.5 * (h * side) as f64;
            let d = (right * (x * size) - up * (y * size) - back).normalize();
            let t = (meadow.height - eye.z) / d.z;
            let seen = look(LawnRays { side, level: t * size, sunlit: true }, eye + d * t, d);
            for c in 0..3 {
                sum[c] += seen.sunlit[c] + SKY * (seen.colour[c] + (1.0 - seen.coverage) * GROUND[c]);
            }
        }
        sum.map(|s| to_srgb8((s / (side * side) as f64 / WHITE) as f32))
    };
    (0..w * h).into_par_iter().flat_map_iter(pixel).collect()
}
