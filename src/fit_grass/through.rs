//! What of the light from a direction arrives at a height of the lawn, in the mean over it: what ambient light in the
//! lawn is worked out from.

use crate::blades::STEPS;
use crate::march::Slices;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Points along each side of the rectangle, and azimuths, that the mean is over.
const POINTS: usize = 8;
const AZIMUTHS: usize = 8;

/// A value at a step of the height and of |Ω_z|.
pub type Through = [[f64; STEPS + 1]; STEPS + 1];

/// Share of the light that arrives past the slices above, by height (k/[`STEPS`] of the carrier's; first index) and by
/// |Ω_z| (k/[`STEPS`]; second). Level light arrives nowhere: it has crossed grass without end.
pub fn through(slices: &Slices) -> Through {
    let mut out = [[0.0; STEPS + 1]; STEPS + 1];
    out.par_iter_mut().enumerate().for_each(|(k, row)| {
        for (j, share) in row.iter_mut().enumerate().skip(1) {
            *share = arrives(slices, k as f64 / STEPS as f64, j as f64 / STEPS as f64);
        }
    });
    out
}

/// The mean over places and azimuths at one height and one |Ω_z| above 0.
fn arrives(slices: &Slices, height: f64, up: f64) -> f64 {
    let across = (1.0 - up * up).max(0.0).sqrt();
    let mut sum = 0.0;
    for n in 0..POINTS * POINTS * AZIMUTHS {
        let (place, turn) = (n / AZIMUTHS, n % AZIMUTHS);
        // Azimuths of a place are turned against those of the others, so that none lies along the slices only.
        let (sin, cos) = (TAU * (turn as f64 + (place as f64 * 0.618_034).fract()) / AZIMUTHS as f64).sin_cos();
        let at = |k: usize, axis: usize| ((k as f64 + 0.37) / POINTS as f64 - 0.5) * slices.period[axis];
        let origin = DVec3::new(at(place % POINTS, 0), at(place / POINTS, 1), height * slices.height);
        let d = DVec3::new(across * cos, across * sin, up);
        sum += 1.0 - slices.march(origin, d, usize::MAX, 0.0, |_, _| [0.0; 3]).opacity;
    }
    sum / (POINTS * POINTS * AZIMUTHS) as f64
}

/// Share of an even sky's light that arrives at blades of a height: over all directions above, each as much as blades
/// show to it.
pub fn open(slices: &Slices, through: &Through) -> [f64; STEPS + 1] {
    through.map(|row| mean(&row, |k| slices.projection[k]))
}

/// Share of an even sky's light that arrives at the ground.
pub fn open_ground(through: &Through) -> f64 {
    mean(&through[0], |k| k as f64)
}

/// The mean over |Ω_z|, which is even over directions, by trapezoids.
fn mean(row: &[f64; STEPS + 1], weight: impl Fn(usize) -> f64) -> f64 {
    let mut sums = [0.0; 2];
    for (k, share) in row.iter().enumerate() {
        let w = weight(k) * if k == 0 || k == STEPS { 0.5 } else { 1.0 };
        sums[0] += w * share;
        sums[1] += w;
    }
    if sums[1] > 0.0 { sums[0] / sums[1] } else { 1.0 }
}

/// Mean share of the light that blades scatter, to both sides, a channel.
pub fn scattered(slices: &Slices) -> [f64; 3] {
    let mut sums = [0.0; 4];
    for t in &slices.upright.levels[0].texels {
        (0..3).for_each(|c| sums[c] += f64::from(0.5 * (t[1 + c] + t[4 + c]) + t[7 + c]));
        sums[3] += f64::from(t[0]);
    }
    [0, 1, 2].map(|c| if sums[3] > 0.0 { sums[c] / sums[3] } else { 0.0 })
}
