//! Faults of single frames: one that is brighter than its neighbours, one without light or without readings, one that
//! was copied, two that were exchanged.
//!
//! A fit with a wrong model leaves residuals that change slowly from frame to frame. So a frame is compared with the
//! frames around it and not with zero: what counts is how far it stands out from the median of three frames on either
//! side, in units of how far the other frames do.

use super::sample::{PassReadings, TexelSample};
use crate::record::fault::{FaultGrade, MeasurementFault};
use mesophyll_base::statistics::{NORMAL_SCATTER, median_of};
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use std::collections::HashSet;

/// Frames on either side that a frame is compared with.
const AROUND: usize = 3;
/// A frame stands out from its neighbours by more than this many scatters of all frames: of normal noise, never.
const SCATTERS: f64 = 8.0;
/// … by more than this many standard errors of its own …
const ERRORS: f64 = 6.0;
/// … and its brightness by more than this share: lamps flicker by less.
const FLICKER: f64 = 0.02;
/// Residuals count as this many standard deviations at most.
const FARTHEST: f64 = 5.0;
/// A frame with readings in fewer than this share of its texels, where its neighbours have them, is damaged.
const READ: f64 = 0.5;
/// A frame with fewer different values than this is not compared with others.
const DISTINCT: usize = 12;
/// More frames than this share of a pass that stand out are no single frames.
const FEW: f64 = 0.125;

/// What is wrong with a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameDefect {
    /// No reading in this share of the texels.
    Unread(f64),
    /// This many times as bright as the frames beside it.
    Gain(f64),
    /// One channel alone is this many times as bright.
    Channel(usize, f64),
    /// The very values of another frame.
    Copy(usize),
    /// This many frames hold its values.
    Repeated(usize),
    /// Shows the tube where another frame has it.
    Shows(usize),
    /// Unlike its neighbours in no way that has a name.
    Unlike,
}

/// A frame that is wrong, and what is wrong with it.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameFault {
    pub side: Side,
    pub travel: Travel,
    pub frame: usize,
    pub wrong: FrameDefect,
}

/// Looks at every frame of a side.
pub fn look(sample: &TexelSample) -> Vec<FrameFault> {
    sample.passes.iter().flat_map(|pass| of_pass(sample, pass)).collect()
}

fn of_pass(sample: &TexelSample, pass: &PassReadings) -> Vec<FrameFault> {
    let (texels, frames) = (sample.texels.len(), pass.frames());
    let found = |frame: usize, wrong: FrameDefect| FrameFault { side: sample.side, travel: pass.travel, frame, wrong };
    let copies = copies(pass, texels);
    let sums: Vec<Sums> = (0..frames).map(|k| Sums::of(sample, pass, k)).collect();
    let read: Vec<f64> = sums.iter().map(|s| s.readings as f64 / (3 * texels) as f64).collect();
    let mut out: Vec<FrameFault> = Vec::new();
    let unread: Vec<usize> = (0..frames).filter(|&k| read[k] < READ * around(&read, k, &[])).collect();
    let mut wrong: Vec<usize> = unread.clone();
    out.extend(unread.iter().map(|&k| found(k, FrameDefect::Unread(1.0 - read[k]))));
    if copies.len() as f64 > (FEW * frames as f64).max(2.0) {
        out.push(found(copies[0].1, FrameDefect::Repeated(copies.len() + 1)));
        return out;
    }
    for (k, first) in copies {
        if !wrong.contains(&k) {
            wrong.push(k);
            out.push(found(k, FrameDefect::Copy(first)));
        }
    }
    // A frame that stands out must not hide its neighbours, so those already found are left out of their medians.
    let stands_out = |k: &usize| {
        let s = &sums[*k];
        let gains: Vec<f64> = sums.iter().map(|s| s.gain).collect();
        let chi: Vec<f64> = sums.iter().map(|s| s.chi2.max(1e-12).ln()).collect();
        let rise = chi[*k] - around(&chi, *k, &wrong);
        let noise = (2.0 / s.readings.max(1) as f64).sqrt();
        let unlike = s.chi2 > 1.5 && rise > (SCATTERS * scatter(&chi, &wrong)).max(ERRORS * noise).max(0.5);
        let change = (s.gain - around(&gains, *k, &wrong)).abs();
        unlike || change > (SCATTERS * scatter(&gains, &wrong)).max(ERRORS * s.gain_err).max(FLICKER)
    };
    let odd: Vec<usize> = (0..frames).filter(|k| !wrong.contains(k)).filter(stands_out).collect();
    if (odd.len() as f64) <= (FEW * frames as f64).max(2.0) {
        for &k in &odd {
            out.push(found(k, name(sample, pass, &sums, k, &[&wrong[..], &odd[..]].concat())));
        }
    }
    out.sort_by_key(|f| f.frame);
    out
}

/// Sums over the sampled texels of one frame.
struct Sums {
    readings: usize,
    /// Mean squared residual, each of [`FARTHEST`] at most.
    chi2: f64,
    /// Measured over predicted, all channels, by least squares, with its standard error.
    gain: f64,
    gain_err: f64,
    /// The same of each channel.
    channels: [f64; 3],
}

impl Sums {
    fn of(sample: &TexelSample, pass: &PassReadings, k: usize) -> Sums {
        let (mut readings, mut chi2) = (0, 0.0);
        let (mut products, mut squares) = ([0.0; 3], [0.0; 3]);
        for n in 0..sample.texels.len() {
            let (measured, predicted) = pass.of(n, k);
            for c in 0..3 {
                let z = sample.residual(n, c, measured[c], predicted[c]);
                if z.is_nan() {
                    continue;
                }
                readings += 1;
                chi2 += z.abs().min(FARTHEST).powi(2);
                let (y, v) = (f64::from(measured[c]), f64::from(predicted[c]));
                let weight = 1.0 / sample.noise[n].variance(c, v);
                products[c] += weight * y * v;
                squares[c] += weight * v * v;
            }
        }
        let all: f64 = squares.iter().sum();
        Sums {
            readings,
            chi2: chi2 / readings.max(1) as f64,
            gain: products.iter().sum::<f64>() / all,
            gain_err: all.sqrt().recip(),
            channels: [0, 1, 2].map(|c: usize| products[c] / squares[c]),
        }
    }
}

/// Median of the frames around `k`, without it and without those of `but`.
fn around(values: &[f64], k: usize, but: &[usize]) -> f64 {
    let near = k.saturating_sub(AROUND)..(k + AROUND + 1).min(values.len());
    let others = near.filter(|j| *j != k && !but.contains(j)).map(|j| values[j]).filter(|v| v.is_finite());
    median_of(others).unwrap_or(f64::NAN)
}

/// Scatter of the frames about the medians around them (as a normal distribution's standard deviation).
fn scatter(values: &[f64], but: &[usize]) -> f64 {
    let away = (0..values.len()).filter(|k| !but.contains(k)).map(|k| (values[k] - around(values, k, but)).abs());
    NORMAL_SCATTER * median_of(away.filter(|v| v.is_finite())).unwrap_or(f64::NAN)
}

/// Frames that hold the same picture as an earlier one. The camera's values are compared, because every frame has a
/// gain of its own.
fn copies(pass: &PassReadings, texels: usize) -> Vec<(usize, usize)> {
    let same = |j: usize, k: usize| {
        (0..texels).all(|n| {
            let (a, b) = (pass.raw(n, j), pass.raw(n, k));
            (0..3).all(|c| (a[c] - b[c]).abs() <= 1e-5 * a[c].abs() || (a[c].is_nan() && b[c].is_nan()))
        })
    };
    // Frames without light or without readings are alike without being copies, and so are coarsely rounded ones.
    let varied = |k: &usize| {
        let values = (0..texels).flat_map(|n| pass.raw(n, *k)).filter(|v| v.is_finite());
        values.map(f32::to_bits).collect::<HashSet<u32>>().len() > DISTINCT
    };
    let frames: Vec<usize> = (0..pass.frames()).filter(varied).collect();
    let earlier = |k: usize| frames.iter().copied().take_while(|j| *j < k).find(|j| same(*j, k));
    frames.iter().filter_map(|&k| Some((k, earlier(k)?))).collect()
}

/// What is wrong with a frame that stands out. Predictions for every place of the tube are compared with it.
fn name(sample: &TexelSample, pass: &PassReadings, sums: &[Sums], k: usize, wrong: &[usize]) -> FrameDefect {
    let step = sample.texels.len().div_ceil(400).max(1);
    // Mean square residual of frame k's readings, `gain` times the prediction for frame j's place.
    let cost = |j: usize, gain: [f64; 3]| {
        let (mut sum, mut count) = (0.0, 0usize);
        for n in (0..sample.texels.len()).step_by(step) {
            let (measured, predicted) = (pass.of(n, k).0, pass.of(n, j).1);
            for c in 0..3 {
                let z = sample.residual(n, c, measured[c], predicted[c] * gain[c] as f32);
                if !z.is_nan() {
                    count += 1;
                    sum += z.abs().min(FARTHEST).powi(2);
                }
            }
        }
        sum / count.max(1) as f64
    };
    let gain = sums[k].gain;
    let own = cost(k, [1.0; 3]);
    let brighter = cost(k, [gain; 3]);
    let channels = cost(k, sums[k].channels);
    let (elsewhere, there) = (0..pass.frames())
        .filter(|j| *j != k)
        .map(|j| (cost(j, [1.0; 3]), j))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or((f64::INFINITY, k));
    let beside = around(&sums.iter().map(|s| s.chi2).collect::<Vec<_>>(), k, wrong).max(1.0);
    // A cause is named where it takes away most of what the frame's residuals have more than its neighbours'.
    let explains = |cost: f64| own - cost > 0.6 * (own - beside);
    if gain < 0.02 {
        FrameDefect::Gain(gain.max(0.0))
    } else if explains(elsewhere) && elsewhere < brighter {
        FrameDefect::Shows(there)
    } else if explains(brighter) {
        FrameDefect::Gain(gain)
    } else if explains(channels) {
        let odd = (0..3).max_by(|a, b| {
            let off = |c: &usize| (sums[k].channels[*c] - 1.0).abs();
            off(a).total_cmp(&off(b))
        });
        FrameDefect::Channel(odd.unwrap_or(0), sums[k].channels[odd.unwrap_or(0)])
    } else {
        FrameDefect::Unlike
    }
}

/// The faults of what was found on all sides. `whites`: whether the capture has white frames.
pub fn faults(found: &[FrameFault], whites: bool) -> Vec<MeasurementFault> {
    let mut out = Vec::new();
    let mut said: Vec<usize> = Vec::new();
    for (n, f) in found.iter().enumerate() {
        if said.contains(&n) {
            continue;
        }
        let same = |g: &&(usize, &FrameFault)| g.1.travel == f.travel && g.1.side != f.side && g.1.frame == f.frame;
        let other = found.iter().enumerate().collect::<Vec<_>>();
        let twin = other.iter().find(same).copied();
        let pass = f.travel.name();
        let file = format!("{}/{pass}/{:04}.exr", f.side.name(), f.frame);
        let here = format!("{file}: frame {} of pass {pass} of the {}", f.frame, f.side.name());
        let mut sides = vec![f.side.name().to_string()];
        let (name, says) = match f.wrong {
            FrameDefect::Gain(gain) if gain >= 0.02 => {
                let both =
                    twin.filter(|(_, g)| matches!(g.wrong, FrameDefect::Gain(h) if (h / gain).ln().abs() < 0.05));
                if let (true, Some((at, _))) = (whites, both) {
                    said.push(at);
                    sides = vec!["front".into(), "back".into()];
                    (
                        "white-frame",
                        format!(
                            "white/{pass}/{:04}.exr: frame {} of pass {pass} is {gain:.2} times as bright as the \
                             frames beside it on both sides, so the white frame is {:.2} times as bright as its \
                             neighbours (a flicker of the lamp, or another exposure); its readings are outliers",
                            f.frame,
                            f.frame,
                            1.0 / gain
                        ),
                    )
                } else {
                    (
                        "frame-brightness",
                        format!(
                            "{here} is {gain:.2} times as bright as the frames beside it (a flicker of the lamp, or \
                             another exposure); its readings are outliers"
                        ),
                    )
                }
            }
            FrameDefect::Gain(_) => {
                ("frame-dark", format!("{here} shows no light (lamp off, or shutter shut); its readings are outliers"))
            }
            FrameDefect::Channel(c, gain) => (
                "frame-brightness",
                format!(
                    "{here}: its channel {} is {gain:.2} times as bright as in the frames beside it; its readings are \
                     outliers",
                    ["R", "G", "B"][c]
                ),
            ),
            FrameDefect::Unread(share) => (
                "frame-unread",
                format!(
                    "{here} has no reading in {:.0} % of the texels (saturated in every exposure, or damaged)",
                    100.0 * share
                ),
            ),
            FrameDefect::Copy(first) => (
                "frame-copied",
                format!("{here} is a copy of frame {first}: a picture was stored twice; its readings tell nothing new"),
            ),
            FrameDefect::Repeated(count) => (
                "frame-copied",
                format!("{here} is the same picture as {} other frames of its pass: the tube did not move", count - 1),
            ),
            FrameDefect::Shows(there) => {
                let back = other.iter().find(|(_, g)| {
                    g.side == f.side
                        && g.travel == f.travel
                        && g.frame == there
                        && g.wrong == FrameDefect::Shows(f.frame)
                });
                if let Some((at, _)) = back {
                    said.push(*at);
                    (
                        "frames-exchanged",
                        format!(
                            "{file}: frames {} and {there} of pass {pass} of the {} are exchanged: each shows the tube \
                             where the other has it",
                            f.frame,
                            f.side.name()
                        ),
                    )
                } else {
                    (
                        "frame-displaced",
                        format!(
                            "{here} shows the tube where frame {there} has it (a picture taken twice, a stop that was \
                             missed, or frames in the wrong order)"
                        ),
                    )
                }
            }
            FrameDefect::Unlike => (
                "frame-unlike",
                format!(
                    "{here} is unlike the frames beside it (a reflection, a shadow, or a shake); its readings are far \
                     from the fit"
                ),
            ),
        };
        out.push(MeasurementFault { name: name.into(), grade: FaultGrade::Doubtful, sides, spoils: Vec::new(), says });
    }
    out
}
