//! Turns two height scans into one thickness. Lengths in mm, widths of smoothing in texels.
//!
//! With heights towards each camera, front + back (mirrored) = thickness + a plane, because each scan has its own zero
//! and its own lean. The lean is found as that of the lamina: a robust plane through the sum, in which veins have
//! little weight because they stand out. So **a thickness that grows evenly over the whole leaf cannot be seen and is
//! subtracted with the lean**. The zero follows from the thickest place, which is measured by caliper (Habel 2009,
//! §3.3.2); the scans are averaged over the caliper's contact, as the tissue under it is. The highest of many noisy
//! values is too high. To correct this, more noise is added so that it doubles, and doubles again. The rise of the
//! highest value tells how much the map's own noise had raised it.

use super::noise::deviation;
use super::smoothing::{SmoothingKernel, pass, smooth};
use mesophyll_base::image::ImageSize;
use mesophyll_base::random::RandomStream;
use mesophyll_base::statistics::{NORMAL_MEDIAN, median_of};
use serde::Serialize;

/// Widths of smoothing that are tried (texels).
const WIDTHS: [f64; 12] = [0.0, 0.35, 0.5, 0.65, 0.8, 1.0, 1.25, 1.5, 1.8, 2.2, 2.6, 3.0];
/// How many times noise is drawn.
const TRIALS: u64 = 8;

/// How the scans lie relative to each other, and how noise was treated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ScanAlignment {
    /// Lean of the sum of both scans along x and y (mm per mm), which was subtracted.
    pub tilt: [f64; 2],
    /// How far the back's scan is displaced from the front's (mm along x and y of the front). It is not corrected.
    pub shift_mm: [f64; 2],
    pub shift_err_mm: [f64; 2],
    /// The zero that was added to the sum of both scans, at the image's centre (mm).
    pub offset_mm: f64,
    /// Standard error of the zero of the thickness. It combines those of the caliper, of the noise, and of a trend
    /// between the thickest place and the middle.
    pub offset_err_mm: f64,
    /// The part of the trend alone.
    pub trend_err_mm: f64,
    /// How much noise had raised the highest value.
    pub raised_mm: f64,
    /// Noise of a height as scanned, and whether it was stated.
    pub height_noise_mm: f64,
    pub noise_stated: bool,
    /// Gaussian smoothing of the thickness and of the heights that normals are made of (mm).
    pub smooth_thickness_mm: f64,
    pub smooth_height_mm: [f64; 2],
    /// Noise that is left in the thickness (mm) and in a slope of front and back.
    pub thickness_noise_mm: f64,
    pub slope_noise: [f64; 2],
    /// The same combined with the detail that smoothing blurred, as root mean squares. Detail that the scanner's own
    /// filter blurred is not included.
    pub thickness_error_mm: f64,
    pub slope_error: [f64; 2],
    /// How far the thickness reaches above and below its median (mm).
    pub above_mm: f64,
    pub below_mm: f64,
}

/// A plane a + b x + c y over the image, x and y in texels from its centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanPlane([f64; 3]);

impl ScanPlane {
    pub fn at(&self, k: usize, size: ImageSize) -> f64 {
        let [x, y] = size.place_mm(1.0, k);
        self.0[0] + self.0[1] * x + self.0[2] * y
    }

    /// Lean along x and y per texel.
    pub fn lean(&self) -> [f64; 2] {
        [self.0[1], self.0[2]]
    }
}

/// The plane through `values` where they are numbers on `mask`, by least squares and then Tukey's biweight. `None` with
/// fewer than 16 such texels, or where they lie on one line.
pub fn plane(values: &[f64], mask: &[bool], size: ImageSize) -> Option<ScanPlane> {
    let at: Vec<usize> = (0..values.len()).filter(|&k| mask[k] && values[k].is_finite()).collect();
    if at.len() < 16 {
        return None;
    }
    let mut weight = vec![1.0; at.len()];
    let mut found = ScanPlane([0.0; 3]);
    for _ in 0..20 {
        let mut normal = nalgebra::Matrix3::<f64>::zeros();
        let mut right = nalgebra::Vector3::<f64>::zeros();
        for (&k, &w) in at.iter().zip(&weight) {
            let [x, y] = size.place_mm(1.0, k);
            let row = nalgebra::Vector3::new(1.0, x, y);
            normal += w * row * row.transpose();
            right += w * values[k] * row;
        }
        let solved = normal.cholesky()?.solve(&right);
        if !solved.iter().all(|v| v.is_finite()) {
            return None;
        }
        let before = found;
        found = ScanPlane([solved[0], solved[1], solved[2]]);
        let rest: Vec<f64> = at.iter().map(|&k| values[k] - found.at(k, size)).collect();
        let moved = (0..3)
            .map(|c| (found.0[c] - before.0[c]).abs() * if c == 0 { 1.0 } else { size.width as f64 })
            .fold(0.0, f64::max);
        match biweight(&rest) {
            Some((scale, next)) if moved > 1e-9 * scale => weight = next,
            _ => break,
        }
    }
    Some(found)
}

/// Tukey's weights of the residuals, and the residual from which on the weight is 0; `None` where all residuals are the
/// same.
fn biweight(rest: &[f64]) -> Option<(f64, Vec<f64>)> {
    let middle = median_of(rest.iter().copied())?;
    let scale = 4.685 * median_of(rest.iter().map(|r| (r - middle).abs()))? / NORMAL_MEDIAN;
    let weight = |r: &f64| {
        let u = (r - middle) / scale;
        if u.abs() < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 }
    };
    (scale > 0.0).then(|| (scale, rest.iter().map(weight).collect()))
}

/// Standard error (mm) of a trend of the thickness at texel `at` relative to the leaf's middle; such a trend cannot be
/// told from a plane. Slow variations have larger amplitudes the longer their waves are. A lean is half a wave and a
/// bend a whole wave, so the lean is assumed to be twice as large as the second-order bends that `rest` (values less
/// their plane) shows.
pub(crate) fn trend_err(rest: &[f64], mask: &[bool], size: ImageSize, at: usize) -> f64 {
    let place = |k: usize| size.place_mm(1.0, k);
    let on: Vec<usize> = (0..rest.len()).filter(|&k| mask[k] && rest[k].is_finite()).collect();
    let n = on.len().max(1) as f64;
    let centre = [0, 1].map(|c: usize| on.iter().map(|&k| place(k)[c]).sum::<f64>() / n);
    let spread = [0, 1].map(|c: usize| (on.iter().map(|&k| (place(k)[c] - centre[c]).powi(2)).sum::<f64>() / n).sqrt());
    let unit = |k: usize| {
        let p = place(k);
        [0, 1].map(|c: usize| (p[c] - centre[c]) / spread[c].max(1e-9))
    };
    let values: Vec<f64> = on.iter().map(|&k| rest[k]).collect();
    let Some((_, weight)) = biweight(&values) else { return 0.0 };
    let terms = |[u, v]: [f64; 2]| nalgebra::Vector6::new(1.0, u, v, u * u, u * v, v * v);
    let mut normal = nalgebra::Matrix6::<f64>::zeros();
    let mut right = nalgebra::Vector6::<f64>::zeros();
    for ((&k, w), r) in on.iter().zip(&weight).zip(&values) {
        let row = terms(unit(k));
        normal += *w * row * row.transpose();
        right += *w * *r * row;
    }
    let Some(solved) = normal.cholesky().map(|c| c.solve(&right)) else { return 0.0 };
    let middle = on.iter().map(|&k| terms(unit(k)).dot(&solved)).sum::<f64>() / n;
    let bent = (on.iter().map(|&k| (terms(unit(k)).dot(&solved) - middle).powi(2)).sum::<f64>() / n).sqrt();
    let [u, v] = unit(at);
    // There are three bends. The lean in each direction is twice one of them.
    2.0 * bent / 3f64.sqrt() * u.hypot(v)
}

/// How far the back's scan is displaced from the front's (mm along x and y of the front), and its standard error by the
/// jackknife. A shift s adds s·∇z to the sum of the scans, where z is the blade's relief (here the front's, smoothed by
/// a texel and a half). `rest` is the sum less its plane; a lean in both is left out.
pub fn shift(rest: &[f64], front: &[f64], mask: &[bool], size: ImageSize, texel_mm: f64) -> ([f64; 2], [f64; 2]) {
    let ImageSize { width, height } = size;
    let weight: Vec<f64> = (0..rest.len()).map(|k| f64::from(u8::from(mask[k] && front[k].is_finite()))).collect();
    let calm = smooth(front, &weight, width, &SmoothingKernel::gaussian(1.5));
    let near = |k: usize| size.neighbours(k).filter(|&n| weight[n] > 0.0).count() == 4;
    let on: Vec<usize> = (0..rest.len()).filter(|&k| weight[k] > 0.0 && rest[k].is_finite() && near(k)).collect();
    let values: Vec<f64> = on.iter().map(|&k| rest[k]).collect();
    let Some((_, tukey)) = biweight(&values) else { return ([0.0; 2], [0.0; 2]) };
    // The picture is divided into blocks, and leaving blocks out tells the error. It is needed because relief and
    // thickness are related in some places.
    const BLOCKS: usize = 4;
    let mut sums = vec![(nalgebra::Matrix5::<f64>::zeros(), nalgebra::Vector5::<f64>::zeros()); BLOCKS * BLOCKS];
    for ((&k, w), r) in on.iter().zip(&tukey).zip(&values) {
        let [x, y] = size.place_mm(1.0, k);
        let slope = [calm[k + 1] - calm[k - 1], calm[k - width] - calm[k + width]].map(|d| 0.5 * d / texel_mm);
        let row = nalgebra::Vector5::new(1.0, x / width as f64, y / height as f64, slope[0], slope[1]);
        let [i, j] = size.position(k);
        let (normal, right) = &mut sums[j * BLOCKS / height * BLOCKS + i * BLOCKS / width];
        *normal += *w * row * row.transpose();
        *right += *w * *r * row;
    }
    let solve = |without: Option<usize>| {
        let kept = sums.iter().enumerate().filter(|(b, _)| Some(*b) != without);
        let (normal, right) =
            kept.fold((nalgebra::Matrix5::zeros(), nalgebra::Vector5::zeros()), |(n, r), (_, s)| (n + s.0, r + s.1));
        normal
            .cholesky()
            .map(|c: nalgebra::Cholesky<f64, nalgebra::U5>| c.solve(&right))
            .map(|v: nalgebra::Vector5<f64>| [v[3], v[4]])
    };
    let Some(found) = solve(None) else { return ([0.0; 2], [0.0; 2]) };
    let others: Vec<[f64; 2]> = (0..sums.len()).filter_map(|b| solve(Some(b))).collect();
    let n = others.len().max(1) as f64;
    let err = [0, 1].map(|c: usize| {
        let mean = others.iter().map(|o| o[c]).sum::<f64>() / n;
        ((n - 1.0) / n * others.iter().map(|o| (o[c] - mean).powi(2)).sum::<f64>()).sqrt()
    });
    (found, err)
}

/// Noise of a height (mm), from the sum of two scans that were smoothed by `filter` before delivery.
pub fn height_noise(sum: &[f64], mask: &[bool], width: usize, filter: &SmoothingKernel) -> Option<f64> {
    deviation(sum, mask, width).map(|(sd, _)| sd / filter.laplacian_noise() / 2f64.sqrt())
}

/// A smoothing and its effect: width (texels), noise left, and the root mean square of noise left and detail lost
/// together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothingWidth {
    pub texels: f64,
    pub noise: f64,
    pub error: f64,
}

/// Which property of a map is to be good after smoothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SmoothingGoal {
    /// Its values.
    Values,
    /// Its slopes, per texel.
    Slopes,
}

/// The smoothing that gives `values` (NaN where there is none) the smallest mean square error. Their noise has the
/// deviation `noise` and was smoothed by `filter`. The error is estimated from the map itself (Stein 1981: mean (Kx −
/// x)² + 2 cov(Kx, x) − var x), relative to the map as delivered. With `only`, this width is taken.
pub(crate) fn best_width(
    values: &[f64],
    width: usize,
    filter: &SmoothingKernel,
    noise: f64,
    wanted: SmoothingGoal,
    only: Option<f64>,
) -> SmoothingWidth {
    let weight: Vec<f64> = values.iter().map(|v| f64::from(u8::from(v.is_finite()))).collect();
    let slopes = |map: &[f64]| -> Vec<f64> {
        match wanted {
            SmoothingGoal::Values => map.to_vec(),
            SmoothingGoal::Slopes => (0..map.len())
                .flat_map(|k| {
                    let across =
                        if k % width > 0 && k % width + 1 < width { 0.5 * (map[k + 1] - map[k - 1]) } else { f64::NAN };
                    let down = if k >= width && k + width < map.len() {
                        0.5 * (map[k + width] - map[k - width])
                    } else {
                        f64::NAN
                    };
                    [across, down]
                })
                .collect(),
        }
    };
    let raw = slopes(values);
    let white = (noise / filter.noise()).powi(2);
    let try_width = |texels: f64| {
        let kernel = SmoothingKernel::gaussian(texels);
        let smoothed = slopes(&smooth(values, &weight, width, &kernel));
        let (sum, n) = smoothed
            .iter()
            .zip(&raw)
            .map(|(s, r)| (s - r).powi(2))
            .filter(|d| d.is_finite())
            .fold((0.0, 0usize), |(s, n), d| (s + d, n + 1));
        let whole = filter.then(&kernel);
        let (left, common, own) = match wanted {
            SmoothingGoal::Values => (whole.noise(), whole.covariance(filter), filter.noise()),
            SmoothingGoal::Slopes => (whole.slope_noise(), whole.slope_covariance(filter), filter.slope_noise()),
        };
        let risk = sum / n.max(1) as f64 + white * (2.0 * common - own * own);
        let noise = white.sqrt() * left;
        SmoothingWidth { texels, noise, error: risk.max(noise * noise).sqrt() }
    };
    match only {
        Some(texels) => try_width(texels),
        None if noise <= 0.0 => try_width(0.0),
        None => WIDTHS
            .into_iter()
            .map(try_width)
            .min_by(|a, b| a.error.total_cmp(&b.error))
            .unwrap_or_else(|| try_width(0.0)),
    }
}

/// The thickest place of a blade.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThickestPlace {
    pub value: f64,
    pub at: usize,
    /// How much was subtracted for noise, and the standard error that noise leaves.
    pub raised: f64,
    pub error: f64,
}

/// The thickest place as a gauge measures it, corrected for noise. `values` are sums of two scans (NaN off the leaf)
/// smoothed by `filter` before delivery. `noise` is that of a sum as delivered (mm). `contact` is the standard
/// deviation of the gauge's contact (texels).
pub fn highest(values: &[f64], width: usize, filter: &SmoothingKernel, contact: f64, noise: f64) -> ThickestPlace {
    let weight: Vec<f64> = values.iter().map(|v| f64::from(u8::from(v.is_finite()))).collect();
    // The smoothing of the scan's filter counts as part of that of the contact.
    let more = SmoothingKernel::gaussian((contact.powi(2) - filter.variance()).max(0.0).sqrt());
    let highest_of = |values: &[f64]| {
        let met = smooth(values, &weight, width, &more);
        (0..met.len())
            .filter(|&k| weight[k] > 0.0 && met[k].is_finite())
            .fold((0, f64::MIN), |a, k| if met[k] > a.1 { (k, met[k]) } else { a })
    };
    let (at, first) = highest_of(values);
    if noise <= 0.0 {
        return ThickestPlace { value: first, at, raised: 0.0, error: 0.0 };
    }
    // The mean height of the thickest place after noise was added until there is `times` as much.
    let with = |times: f64| {
        let scale = (times * times - 1.0).sqrt() * noise / filter.noise();
        let trial = |t: u64| {
            let mut stream = RandomStream::new(0x00d0_3e5c, &[t]);
            let white: Vec<f64> = (0..values.len().div_ceil(2)).flat_map(|_| stream.normal_pair()).collect();
            let added = pass(&white[..values.len()], width, filter);
            let noisier: Vec<f64> = values.iter().zip(&added).map(|(v, n)| v + scale * n).collect();
            highest_of(&noisier).1
        };
        (0..TRIALS).map(trial).sum::<f64>() / TRIALS as f64
    };
    // The rise grows with a power p of the noise: p is 1 where many places are equally thick, and 2 or more around a
    // single one. When the noise is doubled twice, the ratio of the rises is 2^p. The rise due to the map's own noise
    // is the first of them divided by 2^p − 1.
    let (double, fourfold) = (with(2.0), with(4.0));
    let (rise, more_rise) = ((double - first).max(0.0), (fourfold - double).max(0.0));
    let ratio = if rise > 0.0 { (more_rise / rise).clamp(2.0, 8.0) } else { 8.0 };
    let raised = rise / (ratio - 1.0);
    // The noise of a single place, and half of the correction, which is not exact.
    let single = noise / filter.noise() * filter.then(&more).noise();
    ThickestPlace { value: first - raised, at, raised, error: single.hypot(0.5 * raised) }
}

#[cfg(test)]
mod tests;
