//! Two height scans become one thickness. Lengths in mm, widths of smoothing in texels.
//!
//! With heights towards each camera, front + back (mirrored) = thickness + a plane: each scan has a zero and a lean of its own. The
//! lean is that of the lamina (a robust plane through the sum: veins stand out of it and are weighed down), so **a thickness that grows
//! evenly over the whole leaf cannot be seen and is taken off with it**. The zero follows from the thickest place, measured by caliper
//! (Habel 2009, §3.3.2), whose contact the scans are averaged over as the tissue is under it. The highest of many noisy values is too high: the noise that is left is doubled by adding more of it, and by
//! as much as the highest value rises it is taken down.

use super::noise::{deviation, median};
use super::smooth::{Kernel, pass, smooth};
use crate::capture::synth::random::Stream;
use serde::Serialize;

/// Noise that smoothing must leave of the thickness, as a share of the thickest.
const KEEP: f64 = 0.015;
/// Noise that smoothing must leave of a slope: about a degree.
const KEEP_SLOPE: f64 = 0.02;
/// Widest smoothing it may take.
const WIDEST: f64 = 3.0;
/// Times the noise is doubled.
const TRIALS: u64 = 8;

/// How the scans lie to each other, and what was done about noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Alignment {
    /// Lean of the sum of both scans along x and y (mm per mm) that was taken off.
    pub tilt: [f64; 2],
    /// What was added to the sum of both scans, at the image's centre (mm).
    pub offset_mm: f64,
    /// Standard error of the zero of the thickness: the caliper's and the noise's.
    pub offset_err_mm: f64,
    /// By how much noise had raised the highest value.
    pub raised_mm: f64,
    /// Noise of a height as scanned, and whether it was stated.
    pub height_noise_mm: f64,
    pub noise_stated: bool,
    /// Gaussian smoothing of the thickness and of the heights that normals are made of (mm).
    pub smooth_thickness_mm: f64,
    pub smooth_height_mm: f64,
    /// Noise left of thickness (mm) and of a slope.
    pub thickness_noise_mm: f64,
    pub slope_noise: f64,
    /// How far the thickness reaches above and below its median (mm).
    pub above_mm: f64,
    pub below_mm: f64,
}

/// A plane a + b x + c y over the image, x and y in texels from its centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane([f64; 3]);

impl Plane {
    pub fn at(&self, k: usize, width: usize, height: usize) -> f64 {
        let [x, y] = place(k, width, height);
        self.0[0] + self.0[1] * x + self.0[2] * y
    }

    /// Lean along x and y per texel.
    pub fn lean(&self) -> [f64; 2] {
        [self.0[1], self.0[2]]
    }
}

fn place(k: usize, width: usize, height: usize) -> [f64; 2] {
    [(k % width) as f64 + 0.5 - 0.5 * width as f64, 0.5 * height as f64 - 0.5 - (k / width) as f64]
}

/// The plane through `values` where they are numbers on `mask`: least squares, then Tukey's biweight. `None` with fewer than 16 such
/// texels, or where they lie on one line.
pub fn plane(values: &[f64], mask: &[bool], width: usize) -> Option<Plane> {
    let height = values.len() / width;
    let at: Vec<usize> = (0..values.len()).filter(|&k| mask[k] && values[k].is_finite()).collect();
    if at.len() < 16 {
        return None;
    }
    let mut weight = vec![1.0; at.len()];
    let mut found = Plane([0.0; 3]);
    for _ in 0..20 {
        let mut normal = nalgebra::Matrix3::<f64>::zeros();
        let mut right = nalgebra::Vector3::<f64>::zeros();
        for (&k, &w) in at.iter().zip(&weight) {
            let [x, y] = place(k, width, height);
            let row = nalgebra::Vector3::new(1.0, x, y);
            normal += w * row * row.transpose();
            right += w * values[k] * row;
        }
        let solved = normal.cholesky()?.solve(&right);
        if !solved.iter().all(|v| v.is_finite()) {
            return None;
        }
        let before = found;
        found = Plane([solved[0], solved[1], solved[2]]);
        let rest: Vec<f64> = at.iter().map(|&k| values[k] - found.at(k, width, height)).collect();
        let middle = median(&mut rest.clone());
        let scale = 4.685 * median(&mut rest.iter().map(|r| (r - middle).abs()).collect::<Vec<_>>()) / 0.674_489_75;
        let moved = (0..3).map(|c| (found.0[c] - before.0[c]).abs() * if c == 0 { 1.0 } else { width as f64 }).fold(0.0, f64::max);
        if scale <= 0.0 || moved < 1e-9 * scale {
            break;
        }
        weight.iter_mut().zip(&rest).for_each(|(w, r)| {
            let u = (r - middle) / scale;
            *w = if u.abs() < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 };
        });
    }
    Some(found)
}

/// Noise of a height (mm) from the sum of two scans that were smoothed by `filter` before delivery.
pub fn height_noise(sum: &[f64], mask: &[bool], width: usize, filter: &Kernel) -> Option<f64> {
    deviation(sum, mask, width).map(|(sd, _)| sd / filter.laplacian_noise() / 2f64.sqrt())
}

/// The narrowest smoothing (texels) that leaves at most `allowed` of a noise of 1, given what `left` says is left of it.
fn narrowest(allowed: f64, left: impl Fn(f64) -> f64) -> f64 {
    if left(0.0) <= allowed {
        return 0.0;
    }
    let steps = 1 + (20.0 * (WIDEST - 0.3)) as usize;
    (0..steps).map(|k| 0.3 + 0.05 * k as f64).find(|&s| left(s) <= allowed).unwrap_or(WIDEST)
}

/// Widths (texels) that keep the noise of thickness and slopes in bounds, and what is left: (width, noise) of thickness (mm) and of a
/// slope. `forced`: these widths instead.
pub fn widths(noise: f64, filter: &Kernel, thickest: f64, texel: f64, forced: Option<f64>) -> [(f64, f64); 2] {
    // Noise of the scan as delivered is that of white noise after the filter.
    let left = |s: f64| filter.then(&Kernel::gaussian(s)).noise() / filter.noise() * 2f64.sqrt() * noise;
    let slope = |s: f64| filter.then(&Kernel::gaussian(s)).slope_noise() / filter.noise() * noise / texel;
    let thin = forced.unwrap_or_else(|| narrowest(KEEP * thickest, left));
    let flat = forced.unwrap_or_else(|| narrowest(KEEP_SLOPE, slope));
    [(thin, left(thin)), (flat, slope(flat))]
}

/// The thickest place as a gauge meets it, without the noise's part, and the standard error that noise leaves it: (highest, raised by,
/// error). `values` are sums of two scans (NaN off the leaf) smoothed by `filter` before delivery, `noise` that of a sum as delivered
/// (mm), `contact` the standard deviation of the gauge's contact (texels).
pub fn highest(values: &[f64], width: usize, filter: &Kernel, contact: f64, noise: f64) -> (f64, f64, f64) {
    let weight: Vec<f64> = values.iter().map(|v| f64::from(u8::from(v.is_finite()))).collect();
    // What the scan's filter did need not be done again.
    let more = Kernel::gaussian((contact.powi(2) - filter.variance()).max(0.0).sqrt());
    let highest_of = |values: &[f64]| {
        let met = smooth(values, &weight, width, &more);
        met.iter().zip(&weight).filter(|(v, w)| **w > 0.0 && v.is_finite()).fold(f64::MIN, |a, (v, _)| a.max(*v))
    };
    let first = highest_of(values);
    if noise <= 0.0 {
        return (first, 0.0, 0.0);
    }
    let scale = 3f64.sqrt() * noise / filter.noise();
    let trials: Vec<f64> = (0..TRIALS)
        .map(|t| {
            let mut stream = Stream::new(0x00d0_3e5c, &[t]);
            let white: Vec<f64> = (0..values.len().div_ceil(2)).flat_map(|_| stream.normal_pair()).collect();
            let added = pass(&white[..values.len()], width, filter);
            // With three times the variance added, the noise is twice what it was.
            let noisier: Vec<f64> = values.iter().zip(&added).map(|(v, n)| v + scale * n).collect();
            highest_of(&noisier)
        })
        .collect();
    let mean = trials.iter().sum::<f64>() / TRIALS as f64;
    let spread = (trials.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / (TRIALS - 1) as f64 / 3.0).sqrt();
    let raised = (mean - first).max(0.0);
    // The first map's own noise, and half of what was taken off: the correction is no exact one.
    (first - raised, raised, spread.hypot(0.5 * raised))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ridge(w: usize, h: usize) -> Vec<f64> {
        // A lamina of .2 mm with a midrib of .15 mm more along x.
        (0..w * h).map(|k| 0.2 + 0.15 * (-((k / w) as f64 - 0.5 * h as f64).powi(2) / 36.0).exp()).collect()
    }

    fn drawn(n: usize, seed: u64) -> Vec<f64> {
        (0..n.div_ceil(2)).flat_map(|k| Stream::new(seed, &[k as u64]).normal_pair()).take(n).collect()
    }

    #[test]
    fn the_plane_is_the_laminas_whatever_the_veins_do() {
        let (w, h) = (160, 120);
        let noise = drawn(w * h, 3);
        let lean = Plane([1.5, 2e-4, -5e-4]);
        // A second vein off the middle, so that plain least squares would lean.
        let values: Vec<f64> = (0..w * h)
            .map(|k| {
                let vein = if (k / w) > 90 && (k % w) < 40 { 0.1 } else { 0.0 };
                ridge(w, h)[k % (w * h)] + vein + 0.01 * noise[k] + lean.at(k, w, h)
            })
            .collect();
        let found = plane(&values, &vec![true; w * h], w).unwrap();
        // σ_b = σ/(√n · w/√12) = 1.6e-6 per texel for the noise alone.
        assert!((found.lean()[0] - 2e-4).abs() < 1e-5 && (found.lean()[1] + 5e-4).abs() < 1e-5, "{found:?}");
        assert!(plane(&values, &(0..w * h).map(|k| k < w).collect::<Vec<_>>(), w).is_none(), "one row says nothing of the other direction");
    }

    #[test]
    fn the_highest_place_is_not_the_noises() {
        let (w, h) = (160, 120);
        let filter = Kernel::gaussian(0.5);
        let contact = 1.5;
        let clean = pass(&ridge(w, h), w, &filter);
        // A ridge exp(−y²/36) has the variance 18; the contact flattens it to √(18/(18 + 2.25)) (away from the image's upper and lower
        // edge, where nothing is).
        let truth = 0.2 + 0.15 * (18f64 / (18.0 + contact * contact)).sqrt();
        let inside = |v: Vec<f64>| {
            v.into_iter()
                .enumerate()
                .map(|(k, v)| if (4..h - 4).contains(&(k / w)) && (4..w - 4).contains(&(k % w)) { v } else { f64::NAN })
                .collect::<Vec<_>>()
        };
        let (exact, _, _) = highest(&inside(clean.clone()), w, &filter, contact, 0.0);
        assert!((exact - truth).abs() < 1e-3, "{exact} {truth}");
        let mut misses = Vec::new();
        for seed in 0..6 {
            let noise = pass(&drawn(w * h, 100 + seed), w, &filter);
            let sd = 0.012;
            let values = inside(clean.iter().zip(&noise).map(|(v, n)| v + sd / filter.noise() * n).collect());
            let (found, raised, err) = highest(&values, w, &filter, contact, sd);
            assert!(raised > 0.002 && err > 0.0, "{raised} {err}");
            // The plain highest value lies far too high.
            let plain = values.iter().copied().filter(|v| v.is_finite()).fold(f64::MIN, f64::max);
            assert!(plain - truth > 4.0 * (found - truth).abs(), "{plain} {found}");
            misses.push((found - truth) / err);
        }
        let mean = misses.iter().sum::<f64>() / 6.0;
        assert!(misses.iter().all(|m| m.abs() < 3.0) && mean.abs() < 1.3, "{misses:?}");
    }

    #[test]
    fn smoothing_is_as_narrow_as_the_noise_allows() {
        let filter = Kernel::gaussian(0.5);
        let [(none, left), _] = widths(0.0, &filter, 0.4, 0.1, None);
        assert!(none == 0.0 && left == 0.0);
        let [(some, left), (flat, slope)] = widths(0.01, &filter, 0.4, 0.1, None);
        assert!(some > 0.3 && some < 2.0 && left <= 0.006 && left > 0.004, "{some} {left}");
        assert!(flat > some && slope <= 0.02, "{flat} {slope}");
        assert!(widths(0.5, &filter, 0.4, 0.1, None)[0].0 == WIDEST);
    }
}
