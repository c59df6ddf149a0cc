//! The noise of the measurement: as the capture states it, otherwise estimated from the roughness of the traces.

use crate::Result;
use crate::gloss::ReadingNoise;
use crate::leaf::held_out::FrameSplits;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::{NORMAL_MEDIAN, median, median_of};
use mesophyll_capture::reader::TubeCapture;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;

/// Standard deviation √((relative·value)² + floor²) of a value as the camera recorded it, before the dark frame is
/// taken off and before division by the white sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraNoise {
    pub relative: f64,
    /// The floor of calibrated values: the camera's floor divided by the white sheet's median gain.
    pub floor: f64,
    /// The white sheet's median gain: the camera's value where the calibrated value is 1.
    pub median_gain: f64,
    /// Noise of a light-box photograph over that of a frame: below 1 where photographs were averaged.
    pub lightbox: f64,
    /// Standard deviation of the dark frame, in camera values: common to everything measured at a texel.
    pub dark: f64,
    /// Whether the noise was estimated rather than stated.
    pub estimated: bool,
    /// The roughness of the traces divided by the roughness that the noise alone would cause: 1 where the noise is as
    /// stated. It does not depend on the texel model. `None` where the noise is not stated, or where there are too few
    /// frames.
    pub seen: Option<f64>,
}

impl CameraNoise {
    /// The camera's own noise floor, in camera values.
    pub fn camera_floor(&self) -> f64 {
        self.floor * self.median_gain
    }

    /// The noise of the readings at each of `texels`, by the gain and the dark level there.
    pub fn readings(&self, capture: &TubeCapture, texels: &[[u32; 2]]) -> Vec<ReadingNoise> {
        let width = capture.manifest.width;
        let of = |(t, gain): (&[u32; 2], Rgb)| {
            let dark = match capture.dark() {
                // Noise that was estimated from calibrated traces already contains the part of the dark level.
                Some(dark) if !self.estimated => {
                    dark[t[1] as usize * width + t[0] as usize].map(|d| f64::from(d).max(0.0))
                }
                _ => Rgb::default(),
            };
            ReadingNoise {
                relative: self.relative,
                floor: self.camera_floor() / gain,
                dark: dark.zip(gain, |d, g| if d.is_finite() { d / g } else { 0.0 }),
                dark_error: self.dark / gain,
            }
        };
        texels.iter().zip(capture.gain(texels)).map(of).collect()
    }
}

/// The texel model is integrated to about 1e-5 (`optics/tube`). Claiming less noise than this would treat the error of
/// the integration as signal.
pub const LEAST_RELATIVE: f64 = 2e-5;
const LEAST_FLOOR: f64 = 1e-7;

/// Stated noise, or the noise estimated from the frames that the fit sees.
pub fn level(capture: &TubeCapture, splits: &FrameSplits) -> Result<CameraNoise> {
    let m = &capture.manifest;
    let median_gain = capture.median_gain();
    let stated = m.noise_relative.zip(m.noise_floor.map(|f| f / median_gain));
    let (relative, floor) = match stated {
        Some(both) => both,
        None => {
            let (relative, floor) = estimate(&sample(capture, splits)?.traces);
            (m.noise_relative.unwrap_or(relative), m.noise_floor.map_or(floor, |f| f / median_gain))
        }
    };
    let (relative, floor) = (relative.max(LEAST_RELATIVE), floor.max(LEAST_FLOOR));
    let dark = capture.dark().and_then(|d| roughness(d, m.width, |_, _| Rgb::splat(1.0))).map_or(0.0, |r| r.0);
    let empty = capture.lightbox_empty()?;
    let taken_off = |k: usize| capture.dark().map_or(Rgb::default(), |d| d[k].map(|v| f64::from(v).max(0.0)));
    let of_a_frame = |k: usize, value: Rgb| (relative * (value + taken_off(k))).map(|v| v.hypot(floor * median_gain));
    // The photograph's own noise, without that of the dark frame which was subtracted.
    let lightbox = roughness(&empty, m.width, of_a_frame)
        .map_or(1.0, |(ratio, frame)| (ratio.powi(2) - (dark / frame).powi(2)).max(0.0).sqrt().clamp(1e-3, 1.0));
    let mut level =
        CameraNoise { relative, floor, median_gain, lightbox, dark, estimated: stated.is_none(), seen: None };
    if !level.estimated {
        let SampledTraces { texels, traces } = sample(capture, splits)?;
        level.seen = roughness_of_traces(&traces, &level.readings(capture, &texels));
    }
    Ok(level)
}

/// Noise of a smooth image in units of `unit`, and the median unit. `unit` is the standard deviation that a texel of
/// this place and value would have. The noise is found from third differences along rows, whose variance is 20 times
/// that of a sample. Each difference is divided by its own unit, because one median over differences of unequal units
/// would come out too small.
fn roughness(image: &[Rgb<f32>], width: usize, unit: impl Fn(usize, Rgb) -> Rgb) -> Option<(f64, f64)> {
    let (mut differences, mut units) = (Vec::new(), Vec::new());
    for (row, values) in image.chunks(width).enumerate() {
        for (i, w) in values.windows(4).enumerate() {
            // The smooth value between the middle two.
            let middle = Rgb::of(|c| 0.5 * (f64::from(w[1][c]) + f64::from(w[2][c])));
            let units_here = unit(row * width + i + 1, middle);
            for c in 0..3 {
                let [p, q, r, s] = [0, 1, 2, 3].map(|k: usize| f64::from(w[k][c]));
                let d = (s - 3.0 * r + 3.0 * q - p).abs() / 20f64.sqrt() / units_here[c];
                if d.is_finite() {
                    differences.push(d);
                    units.push(units_here[c]);
                }
            }
        }
    }
    if differences.len() < 256 {
        return None;
    }
    let first = median(&mut differences)? / 0.6745;
    // Then the root mean square within three standard deviations is taken, which is a more precise estimate than the
    // median. The mean square of a normal distribution that is cut off there is 0.97334.
    let (count, sum) = differences.iter().filter(|d| **d <= 3.0 * first).fold((0, 0.0), |(n, s), d| (n + 1, s + d * d));
    let seen = if first > 0.0 { (sum / f64::from(count) / 0.97334).sqrt() } else { 0.0 };
    Some((seen, median(&mut units)?))
}

/// Robust standard deviation of the traces' fourth differences, in units of what the noise makes of them. Fourth
/// differences cancel whatever is as smooth as the tube's fall-off. `traces` holds three channels a texel, in turn.
fn roughness_of_traces(traces: &[Vec<f64>], noise: &[ReadingNoise]) -> Option<f64> {
    const WEIGHTS: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
    let mut all: Vec<f64> = Vec::new();
    for (n, trace) in traces.iter().enumerate() {
        let variance = |value: f64| noise[n / 3].variance(n % 3, value);
        for window in trace.windows(WEIGHTS.len()) {
            let (mut difference, mut expected) = (0.0, 0.0);
            for (v, w) in window.iter().zip(WEIGHTS) {
                difference += w * v;
                expected += w * w * variance(*v);
            }
            all.push((difference * difference / expected).sqrt());
        }
    }
    all.retain(|v| v.is_finite());
    if all.len() < 1000 {
        return None;
    }
    Some(median(&mut all)? / NORMAL_MEDIAN)
}

/// Traces of some texels.
struct SampledTraces {
    texels: Vec<[u32; 2]>,
    /// The three channels of each texel in turn.
    traces: Vec<Vec<f64>>,
}

/// Traces of texels across the middle rows, with NaN in the frames that the fit leaves out.
fn sample(capture: &TubeCapture, splits: &FrameSplits) -> Result<SampledTraces> {
    let m = &capture.manifest;
    let rows = m.height / 2..(m.height / 2 + 2).min(m.height);
    let step = (m.width / 200).max(1);
    let texels: Vec<[u32; 2]> = (0..m.width).step_by(step).map(|i| [i as u32, rows.start as u32]).collect();
    let band = capture.band(Side::Front, Travel::X, rows, &texels, &splits.x.kept)?;
    let frames = m.pass(Travel::X).map_or(0, |p| p.positions().len());
    let trace = |n: usize, c: usize| {
        let mut all = vec![f64::NAN; frames];
        splits.x.kept.iter().zip(&band).for_each(|(k, frame)| all[*k] = f64::from(frame[n][c]));
        all
    };
    let traces = (0..texels.len()).flat_map(|n| [0, 1, 2].map(|c: usize| trace(n, c))).collect();
    Ok(SampledTraces { texels, traces })
}

/// Fits variance = (r·value)² + f² to third differences. On a smooth trace these are only noise: a third difference of
/// independent samples has 20 times their variance. Medians are used so that the glossy peak, where third differences
/// are signal, does not count.
fn estimate(traces: &[Vec<f64>]) -> (f64, f64) {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for trace in traces {
        for w in trace.windows(4) {
            let d = (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs() / 20f64.sqrt();
            let mean = (w[0] + w[1] + w[2] + w[3]) / 4.0;
            if d.is_finite() && mean > 0.0 {
                points.push((mean, d));
            }
        }
    }
    if points.len() < 64 {
        return (0.01, 5e-4);
    }
    points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    // Median |d| = 0.6745 sd in bins of equal counts over the value.
    let bins: Vec<(f64, f64)> = points
        .chunks(points.len().div_ceil(16))
        .map(|chunk| {
            let middle = median_of(chunk.iter().map(|p| p.1)).unwrap_or(f64::NAN);
            (chunk[chunk.len() / 2].0, middle / 0.6745)
        })
        .collect();
    // A weighted straight line of sd² over value². The weights are 1/sd⁴, so that bright bins do not hide the floor.
    let (mut s, mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (value, sd) in bins {
        let (x, y) = (value * value, sd * sd);
        let w = 1.0 / (y * y).max(1e-30);
        s += w;
        sx += w * x;
        sy += w * y;
        sxx += w * x * x;
        sxy += w * x * y;
    }
    let det = (s * sxx - sx * sx).max(f64::MIN_POSITIVE);
    let (slope, intercept) = ((s * sxy - sx * sy) / det, (sxx * sy - sx * sxy) / det);
    (slope.max(0.0).sqrt(), intercept.max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_read_off_smooth_traces() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        let traces: Vec<Vec<f64>> = (0..300)
            .map(|_| {
                let scale: f64 = 0.05 + 0.3 * rng.random::<f64>();
                (0..100)
                    .map(|k| {
                        let u = -4.0 + 0.065 * f64::from(k);
                        let v = scale / (1.0 + u * u);
                        let (a, b): (f64, f64) = (rng.random(), rng.random());
                        let z = (-2.0 * a.max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * b).cos();
                        v + z * ((0.01 * v).powi(2) + 5e-4f64.powi(2)).sqrt()
                    })
                    .collect()
            })
            .collect();
        let (relative, floor) = estimate(&traces);
        assert!((relative / 0.01 - 1.0).abs() < 0.15, "{relative}");
        assert!((floor / 5e-4 - 1.0).abs() < 0.15, "{floor}");
    }

    /// A lit box is darker towards its border and its channels differ. There, one median over all differences would be
    /// too small.
    #[test]
    fn noise_is_read_off_a_smooth_picture_of_unlike_channels() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        let (width, height) = (240, 180);
        let level = |k: usize| {
            let (u, v) = ((k % width) as f64 / width as f64 - 0.5, (k / width) as f64 / height as f64 - 0.5);
            1.0 - 1.2 * (u * u + v * v)
        };
        let image: Vec<Rgb<f32>> = (0..width * height)
            .map(|k| {
                Rgb([1.0, 0.75, 0.5]).map(|c| {
                    let (a, b): (f64, f64) = (rng.random(), rng.random());
                    let z = (-2.0 * a.max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * b).cos();
                    (c * level(k) * (1.0 + 0.004 * z)) as f32
                })
            })
            .collect();
        let (ratio, _) = roughness(&image, width, |_, v| 0.01 * v).unwrap();
        assert!((ratio / 0.4 - 1.0).abs() < 0.01, "{ratio}");
    }
}
