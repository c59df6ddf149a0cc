//! The share of the light from a direction that arrives at a height of the lawn, as a mean over the lawn. Ambient light
//! in the lawn is computed from it.

use crate::grass::blades::STEPS;
use crate::grass::march::{LawnSlices, SliceAxis, SliceCrossing};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Numbers of points along each side of the rectangle, of places on slices, and of azimuths that the means are taken
/// over.
const POINTS: usize = 8;
const PLACES: usize = 128;
const AZIMUTHS: usize = 8;

/// A value for each step of the height and each step of |Ω_z|.
pub type LawnTransmittance = [[f64; STEPS + 1]; STEPS + 1];

/// Share of the light that passes the slices above and arrives at blades. The first index is the height (k/[`STEPS`] of
/// the carrier's), and the second |Ω_z| (k/[`STEPS`]). No level light arrives, because it has crossed grass without
/// end. Blades stand in tufts, so less light arrives at them than between them.
pub fn through(slices: &LawnSlices) -> LawnTransmittance {
    let mut out = [[0.0; STEPS + 1]; STEPS + 1];
    out.par_iter_mut().enumerate().for_each(|(k, row)| {
        for (j, share) in row.iter_mut().enumerate().skip(1) {
            *share = at_blades(slices, k as f64 / STEPS as f64, j as f64 / STEPS as f64);
        }
    });
    out
}

/// A direction with this |Ω_z|. The azimuths are turned differently for each place, so that they do not all lie along
/// the slices.
fn towards(up: f64, place: usize, turn: usize) -> DVec3 {
    let across = (1.0 - up * up).max(0.0).sqrt();
    let (sin, cos) = (TAU * (turn as f64 + (place as f64 * 0.618_034).fract()) / AZIMUTHS as f64).sin_cos();
    DVec3::new(across * cos, across * sin, up)
}

/// The mean over what upright slices show from either side, at one height and one |Ω_z| above 0. Where they show
/// nothing, it is the mean between blades.
fn at_blades(slices: &LawnSlices, height: f64, up: f64) -> f64 {
    let mut sums = [0.0; 2];
    for n in 0..PLACES * AZIMUTHS {
        let (place, turn) = (n / AZIMUTHS, n % AZIMUTHS);
        let (slice, along) = (place % (2 * slices.count), (place as f64 * 0.754_877_67).fract());
        let (axis, across) = if slice < slices.count { (0, SliceAxis::X) } else { (1, SliceAxis::Y) };
        let index = (slice % slices.count) as i64;
        let mut at = DVec3::new(0.0, 0.0, height * slices.height);
        at[axis] = ((index as f64 + 0.5) / slices.count as f64 - 0.5) * slices.period[axis];
        at[1 - axis] = (along - 0.5) * slices.period[1 - axis];
        let crossing = SliceCrossing { t: 0.0, across, index, place: at, lean: DVec2::ZERO };
        let texel = slices.texel(&crossing, [1.0, 1.0], 0.0);
        let mut from = DVec3::ZERO;
        from[axis] = if turn % 2 == 0 { 1.0 } else { -1.0 };
        if texel[0] > 0.0 {
            sums[0] += texel[0] * slices.arriving(&crossing, &texel, from, towards(up, place, turn), 0.0);
            sums[1] += texel[0];
        }
    }
    if sums[1] > 0.0 { sums[0] / sums[1] } else { between(slices, height, up) }
}

/// The mean over places and azimuths, at one height and one |Ω_z| above 0.
fn between(slices: &LawnSlices, height: f64, up: f64) -> f64 {
    let mut sum = 0.0;
    for n in 0..POINTS * POINTS * AZIMUTHS {
        let (place, turn) = (n / AZIMUTHS, n % AZIMUTHS);
        let at = |k: usize, axis: usize| ((k as f64 + 0.37) / POINTS as f64 - 0.5) * slices.period[axis];
        let origin = DVec3::new(at(place % POINTS, 0), at(place / POINTS, 1), height * slices.height);
        sum += 1.0 - slices.march(origin, towards(up, place, turn), usize::MAX, 0.0, |_, _| [0.0; 3]).opacity;
    }
    sum / (POINTS * POINTS * AZIMUTHS) as f64
}

/// Share of an even sky's light that arrives at blades of each height. Directions above the horizon are weighted by the
/// area that blades show to them.
pub fn open(slices: &LawnSlices, through: &LawnTransmittance) -> [f64; STEPS + 1] {
    through.map(|row| mean(&row, |k| slices.projection[k]))
}

/// Share of an even sky's light that arrives at the ground.
pub fn open_ground(slices: &LawnSlices) -> f64 {
    let row = std::array::from_fn(|k| if k == 0 { 0.0 } else { between(slices, 0.0, k as f64 / STEPS as f64) });
    mean(&row, |k| k as f64)
}

/// The weighted mean over |Ω_z| by the trapezoid rule. Directions are spread evenly over |Ω_z|.
fn mean(row: &[f64; STEPS + 1], weight: impl Fn(usize) -> f64) -> f64 {
    let mut sums = [0.0; 2];
    for (k, share) in row.iter().enumerate() {
        let w = weight(k) * if k == 0 || k == STEPS { 0.5 } else { 1.0 };
        sums[0] += w * share;
        sums[1] += w;
    }
    if sums[1] > 0.0 { sums[0] / sums[1] } else { 1.0 }
}

/// Mean share of the light that blades scatter to both sides together, for each channel.
pub fn scattered(slices: &LawnSlices) -> [f64; 3] {
    let mut sums = [0.0; 4];
    for t in &slices.upright.levels[0].texels {
        (0..3).for_each(|c| sums[c] += f64::from(0.5 * (t[1 + c] + t[4 + c]) + t[7 + c]));
        sums[3] += f64::from(t[0]);
    }
    [0, 1, 2].map(|c| if sums[3] > 0.0 { sums[c] / sums[3] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grass::sheet::{CHANNELS, CellEdges, SliceAtlas};
    use crate::grass::tests::{options, thin};
    use crate::grass::{Options, baked};

    /// Where all slices have the same small opacity a, and blades show the same area to all directions, light is
    /// dimmed as by a fog: by exp(−τ), where τ is −ln(1 − a) for each step between slices along an axis. Counts of
    /// slices are off by one, and so is τ by one slice. The ground gets 2 E₃(τ) of an even sky's light, here by an
    /// integral in 10,000 steps; the trapezoid rule with 16 steps is off by less than 0.01.
    #[test]
    fn even_slices_dim_light_as_a_fog_does() {
        let (opacity, count) = (0.02f32, 32);
        let mut texel = [0.0; CHANNELS];
        (texel[0], texel[13]) = (opacity, 0.5 * opacity);
        let mut slices = baked(&thin().1, &Options { slices: count, texels: [8, 8], rays: 1, ..options() });
        slices.period = [32.0, 32.0];
        slices.upright = SliceAtlas::new([8, 8], 2 * count, CellEdges::Level, |_, _, _| texel);
        slices.level = None;
        slices.cover = LawnSlices::covers(&slices.upright, None);
        // Slices show more than blades to all directions but the last step: |Ω_x| + |Ω_y| is 0.348 or more there.
        (slices.projection, slices.shown) = ([0.3; STEPS + 1], [1.0, 1.0]);
        let one = -f64::from(1.0 - opacity).ln();
        let depth = |height: f64| 0.3 * one * (1.0 - height) * slices.height;
        let found = through(&slices);
        for (k, row) in found.iter().enumerate() {
            assert_eq!(row[0], 0.0);
            // At |Ω_z| = 1, no upright slice is crossed.
            for (j, share) in row.iter().enumerate().take(STEPS).skip(1) {
                let up = j as f64 / STEPS as f64;
                let right = (-depth(k as f64 / STEPS as f64) / up).exp();
                assert!((share - right).abs() < one, "height {k}, |Ω_z| {up}: {share}, expected {right}");
            }
        }
        let n = 10_000;
        let right = (0..n).map(|k| (f64::from(k) + 0.5) / f64::from(n)).map(|up| 2.0 * up * (-depth(0.0) / up).exp());
        let right = right.sum::<f64>() / f64::from(n);
        let found = open_ground(&slices);
        println!("ground {found:.4}, 2 E₃ {right:.4}, depth {:.3}", depth(0.0));
        // From straight above, upright slices alone stop nothing, which the last step has a share of 1/16 of.
        let above = (1.0 - (-depth(0.0)).exp()) / STEPS as f64;
        assert!((found - right - above).abs() < 0.01 + one, "{found}, expected {right} + {above}");
    }
}
