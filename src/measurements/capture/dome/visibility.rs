//! How much of an even dome a texel sees: V(x) = (1/π) ∫ max(0, n·ω) dω, 0 … 1, over the directions above the blade's
//! plane that no part of the leaf blocks. Light that neighbouring slopes send each other is left out: with albedos of a
//! few per cent it is a few per cent of the missing light.
//!
//! V is computed from horizons in 16 slices of azimuth (Max 1988), each slice in closed form. With h the sine of its
//! horizon's elevation, ∫_h^1 z dz = (1 − h²)/2 and ∫_h^1 √(1 − z²) dz = (acos h − h √(1 − h²))/2.

use mesophyll_optics::translucency::blade::LitSide;
use mesophyll_optics::translucency::horizon::{Horizon, SLICES};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// V of every texel of a side, row-major in its own columns; 0 off the leaf.
pub fn visible(lit: &LitSide) -> Vec<f64> {
    let horizon = Horizon::new(lit);
    let n = lit.width * lit.height;
    let slices: Vec<(&[f32], [f64; 2])> = (0..SLICES)
        .map(|k| {
            let azimuth = TAU * k as f64 / SLICES as f64;
            // Averaged over a slice of the width δ, the vector (cosine, sine) is shorter by sin(δ/2)/(δ/2).
            let shorter = (PI / SLICES as f64).sin() / (PI / SLICES as f64);
            (horizon.slice(k), [shorter * azimuth.cos(), shorter * azimuth.sin()])
        })
        .collect();
    (0..n)
        .into_par_iter()
        .map(|k| {
            if !lit.mask[k] {
                return 0.0;
            }
            let normal = lit.surface.normal[k];
            let sum: f64 = slices
                .iter()
                .map(|(plane, [c, s])| {
                    let h = f64::from(plane[k]).clamp(0.0, 1.0);
                    let up = 0.5 * (1.0 - h * h);
                    let across = 0.5 * (h.acos() - h * (1.0 - h * h).sqrt());
                    // Where a slope's own plane hides a direction, so does the horizon. So n·ω can be negative only
                    // because a slice has a width.
                    (normal[2] * up + (normal[0] * c + normal[1] * s) * across).max(0.0)
                })
                .sum();
            sum * 2.0 / SLICES as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_optics::side::Side;
    use mesophyll_optics::translucency::blade::BladeMaps;

    fn of(heights: Vec<f64>, w: usize, h: usize) -> (Vec<f64>, Vec<[f64; 3]>) {
        let n = w * h;
        let blade =
            BladeMaps::from_heights(w, h, 0.1, vec![true; n], [heights, vec![0.1; n]], [vec![0.9; n], vec![0.9; n]]);
        (visible(&blade.lit(Side::Front)), blade.front.normal)
    }

    #[test]
    fn a_level_blade_sees_all_and_a_leaning_one_what_lies_above_both_planes() {
        let (level, _) = of(vec![0.2; 400], 20, 20);
        assert!(level.iter().all(|v| (v - 1.0).abs() < 1e-6));
        // Far from the upper edge, the slope's own plane is the horizon, and V = (1 + n_z)/2.
        let (w, h) = (400, 8);
        let (lean, n) = of((0..w * h).map(|k| 0.04 * (k % w) as f64).collect(), w, h);
        let k = 4 * w + 200;
        assert!((lean[k] - 0.5 * (1.0 + n[k][2])).abs() < 4e-3, "{} {}", lean[k], n[k][2]);
    }

    /// All light that falls through the blade's plane lands on the leaf: V/n_z, per area of the plane, has the mean 1
    /// for any relief.
    #[test]
    fn no_light_is_lost_between_the_slopes() {
        let (w, h) = (160, 160);
        let wave = |x: f64| 0.3 * (x * TAU / 20.0).sin();
        for relief in [
            (0..w * h).map(|k| wave((k % w) as f64)).collect::<Vec<_>>(),
            (0..w * h).map(|k| wave((k % w) as f64 + (k / w) as f64) + wave((k % w) as f64 - (k / w) as f64)).collect(),
        ] {
            let (v, n) = of(relief, w, h);
            // The mean is taken away from the edges, over whole waves.
            let inner: Vec<usize> = (40..120).flat_map(|j| (40..120).map(move |i| j * w + i)).collect();
            let mean = inner.iter().map(|&k| v[k] / n[k][2]).sum::<f64>() / inner.len() as f64;
            let (plain, least) =
                inner.iter().fold((0.0, 1.0f64), |(s, m), &k| (s + 0.5 * (1.0 + n[k][2]) / n[k][2], m.min(v[k])));
            assert!(least < 0.85, "{least}: there is something to hide behind");
            assert!((mean - 1.0).abs() < 0.015, "{mean}");
            assert!(
                (plain / inner.len() as f64 - 1.0).abs() > 2.0 * (mean - 1.0).abs(),
                "without horizons it would not be so"
            );
        }
    }
}
