//! Light from all around on the six faces of a cube, and the same light when only its largest Haar wavelets are kept
//! (Ng, Ramamoorthi & Hanrahan 2003). This is the all-frequency baseline of Wang et al. 2005, Fig. 9.
//!
//! A picture depends linearly on its light. So the method's picture with few wavelets is the picture under the light
//! that has only these wavelets. Nothing else of the method is needed to see its error.

use super::environment::Environment;
use super::visibility::directions::{on_face, place};
use super::visibility::light::{AreaLight, frame};
use super::world::ReferenceWorld;
use crate::{Error, Result};
use glam::DVec3;
use mesophyll_sky::panorama;

/// Radiance in the texels of a cube map.
#[derive(Debug, Clone, PartialEq)]
pub struct CubeLight {
    side: usize,
    /// The texels face by face and row by row, with one number for each channel.
    texels: Vec<[f64; 3]>,
}

/// Number of points along either side of a texel at which the sky is evaluated.
const POINTS: usize = 4;
/// Number of points on the sun's disk.
const DISK: usize = 256;

impl CubeLight {
    /// Sky and sun of a world, as mean radiance in each of the `side`² · 6 texels.
    ///
    /// # Errors
    /// [`Error::Usage`] for a side that is no power of two up to 512, or for an impossible radius of the sun.
    pub fn new(world: &ReferenceWorld, side: usize) -> Result<CubeLight> {
        if !side.is_power_of_two() || side > 512 {
            return Err(Error::Usage(format!("a cube of side {side}, expected a power of two up to 512")));
        }
        let texel = |k: usize| {
            let (face, i, j) = (k / (side * side), k % side, k / side % side);
            let at = |n: usize| (n as f64 + 0.5) / POINTS as f64 - 0.5;
            let mut sum = [0.0; 3];
            for n in 0..POINTS * POINTS {
                let d = on_face(face, [i as f64 + at(n % POINTS), j as f64 + at(n / POINTS)], side);
                let l = world.sky_radiance(d.normalize());
                (0..3).for_each(|c| sum[c] += l[c] / (POINTS * POINTS) as f64);
            }
            sum
        };
        let mut out = CubeLight { side, texels: (0..6 * side * side).map(texel).collect() };
        let Some(sun) = world.sun else { return Ok(out) };
        let (disk, from) = (AreaLight::disk(sun.radius, DISK)?, frame(sun.direction));
        for (n, weight) in disk.weights().iter().enumerate() {
            let k = out.index(from * disk.direction(n));
            let share = weight / out.solid_angle(k);
            (0..3).for_each(|c| out.texels[k][c] += share * sun.irradiance[c]);
        }
        Ok(out)
    }

    /// The texel in which a direction lies.
    fn index(&self, d: DVec3) -> usize {
        let (face, at) = place(d, self.side);
        let [i, j] = at.map(|x| (x.round().max(0.0) as usize).min(self.side - 1));
        (face * self.side + j) * self.side + i
    }

    /// Solid angle of a texel, computed at its centre. The error is below its width squared.
    fn solid_angle(&self, k: usize) -> f64 {
        let side = self.side;
        let d = on_face(k / (side * side), [(k % side) as f64, (k / side % side) as f64], side);
        4.0 / (side * side) as f64 / d.length().powi(3)
    }

    /// Radiance from a direction of any length above 0.
    pub fn at(&self, d: DVec3) -> [f64; 3] {
        self.texels[self.index(d)]
    }

    /// Keeps the `count` largest wavelets of the three channels together, and drops the others. Values that become
    /// negative count as 0. Returns the share of the sum of squares that is left, 0 to 1.
    pub fn keep(&mut self, count: usize) -> f64 {
        let mut all = self.texels.clone();
        all.chunks_exact_mut(self.side * self.side).for_each(|face| transform(face, self.side));
        let size = |w: &[f64; 3]| w.iter().map(|v| v * v).sum::<f64>();
        let mut order: Vec<usize> = (0..all.len()).collect();
        order.sort_by(|a, b| size(&all[*b]).total_cmp(&size(&all[*a])));
        let whole: f64 = all.iter().map(size).sum();
        order.into_iter().skip(count).for_each(|k| all[k] = [0.0; 3]);
        let left: f64 = all.iter().map(size).sum();
        all.chunks_exact_mut(self.side * self.side).for_each(|face| restore(face, self.side));
        self.texels = all.into_iter().map(|t| t.map(|v| v.max(0.0))).collect();
        if whole > 0.0 { left / whole } else { 1.0 }
    }

    /// The same light as an environment map with `rows` rows.
    ///
    /// # Errors
    /// [`Error::Usage`] for values that are no radiance.
    pub fn environment(&self, rows: usize) -> Result<Environment> {
        let texels = panorama::centres(2 * rows, rows).map(|d| self.at(DVec3::from(d)).map(|v| v as f32)).collect();
        Environment::new(2 * rows, rows, texels).map_err(|what| Error::Usage(format!("light of a cube: {what}")))
    }
}

/// The coefficients of 2 × 2 texels in the four orthonormal Haar functions, the mean first.
fn haar([a, b, c, d]: [f64; 4]) -> [f64; 4] {
    [a + b + c + d, a - b + c - d, a + b - c - d, a - b - c + d].map(|v| 0.5 * v)
}

/// Haar's transform of a square. At each level the means of size `n` go to the first quarter and are transformed again.
fn transform(face: &mut [[f64; 3]], side: usize) {
    let mut n = side;
    while n > 1 {
        step(face, side, n, |half, i, j| {
            let (x, y) = (2 * i, 2 * j);
            (
                [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]],
                [[i, j], [i + half, j], [i, j + half], [i + half, j + half]],
            )
        });
        n /= 2;
    }
}

/// Undoes [`transform`].
fn restore(face: &mut [[f64; 3]], side: usize) {
    let mut n = 2;
    while n <= side {
        step(face, side, n, |half, i, j| {
            let (x, y) = (2 * i, 2 * j);
            (
                [[i, j], [i + half, j], [i, j + half], [i + half, j + half]],
                [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]],
            )
        });
        n *= 2;
    }
}

/// One step over the first `n` × `n` texels. `places(n/2, i, j)` gives the places where four values are read, and those
/// where they are written. Haar's step is its own inverse.
fn step(
    face: &mut [[f64; 3]],
    side: usize,
    n: usize,
    places: impl Fn(usize, usize, usize) -> ([[usize; 2]; 4], [[usize; 2]; 4]),
) {
    let before = face.to_vec();
    for (i, j) in (0..n / 2).flat_map(|j| (0..n / 2).map(move |i| (i, j))) {
        let (read, write) = places(n / 2, i, j);
        for c in 0..3 {
            let out = haar(read.map(|[x, y]| before[y * side + x][c]));
            for ([x, y], value) in write.into_iter().zip(out) {
                face[y * side + x][c] = value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::ReferenceSun;
    use std::f64::consts::PI;

    fn world() -> ReferenceWorld {
        let sun = ReferenceSun { direction: DVec3::new(0.3, -0.5, 0.8), irradiance: [3.0, 2.0, 1.0], radius: 0.00465 };
        ReferenceWorld { sun: Some(sun), sky: Some([0.25, 0.5, 1.0]), ..ReferenceWorld::default() }
    }

    /// The sum over the texels is the sun's irradiance plus 4π times the sky's radiance.
    #[test]
    fn no_light_is_lost() {
        for side in [8, 32] {
            let cube = CubeLight::new(&world(), side).unwrap();
            for c in 0..3 {
                let sum: f64 = (0..cube.texels.len()).map(|k| cube.texels[k][c] * cube.solid_angle(k)).sum();
                let expected = [3.0, 2.0, 1.0][c] + 4.0 * PI * [0.25, 0.5, 1.0][c];
                assert!((sum / expected - 1.0).abs() < 2.0 / (side * side) as f64, "{side}: {sum} {expected}");
            }
        }
        assert!(CubeLight::new(&world(), 33).is_err());
    }

    #[test]
    fn all_wavelets_give_the_light_back_and_few_the_best_of_it() {
        let whole = CubeLight::new(&world(), 16).unwrap();
        let mut all = whole.clone();
        assert!((all.keep(6 * 256) - 1.0).abs() < 1e-12);
        for (a, b) in all.texels.iter().flatten().zip(whole.texels.iter().flatten()) {
            assert!((a - b).abs() < 1e-9 * (1.0 + b));
        }
        // A single bright texel is a mean and one wavelet at each level. The uniform rest of its face and the other
        // faces are six means.
        let mut few = whole.clone();
        few.keep(6 + 3 * 4);
        for (a, b) in few.texels.iter().flatten().zip(whole.texels.iter().flatten()) {
            assert!((a - b).abs() < 1e-9 * (1.0 + b), "{a} {b}");
        }
        let mut fewer = whole.clone();
        assert!(fewer.keep(6) < 1.0);
        let map = whole.environment(64).unwrap();
        let d = DVec3::new(-0.2, 0.4, -0.7).normalize();
        assert!((map.at(d)[2] - 1.0).abs() < 1e-6);
    }
}
