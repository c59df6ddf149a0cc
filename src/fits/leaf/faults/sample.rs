//! A sample of a side's texels with all their readings, also those of frames that the fit did not see, and what the
//! fitted texels should have shown. Every search for a fault works on it.

use crate::Result;
use crate::gloss::ReadingNoise;
use crate::leaf::held_out::{FramePredictor, PredictionScratch, TexelParameters, texel_of};
use crate::leaf::interior::LeafSideFit;
use crate::leaf::noise::CameraNoise;
use crate::record::scan::ScanRecord;
use mesophyll_base::rgb::Rgb;
use mesophyll_capture::reader::TubeCapture;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;
use std::collections::HashMap;

/// A leaf with fewer texels than this is looked at as a whole; of others, blocks of 3 × 3 texels are.
const TEXELS: usize = 2400;
/// Rows and columns of blocks.
const BLOCKS: [usize; 2] = [32, 8];

/// Sampled texels of one side.
pub struct TexelSample {
    pub side: Side,
    /// Column and row.
    pub texels: Vec<[u32; 2]>,
    /// Place on the blade (mm).
    pub at: Vec<[f64; 2]>,
    pub fitted: Vec<TexelParameters>,
    pub noise: Vec<ReadingNoise>,
    /// The sampled texel to the right of each, and the one above it (towards +y).
    pub beside: Vec<[Option<usize>; 2]>,
    /// Which of the texels lies in a column and row.
    place: HashMap<[u32; 2], usize>,
    pub passes: Vec<PassReadings>,
}

/// The readings of one pass: texel by texel, and frame by frame within a texel.
pub struct PassReadings {
    pub travel: Travel,
    /// Places of the tube (mm).
    pub positions: Vec<f64>,
    pub measured: Vec<Rgb<f32>>,
    pub predicted: Vec<Rgb<f32>>,
    /// The camera's value of 1 by the white frames; empty where there are none.
    pub gain: Vec<Rgb<f32>>,
}

impl PassReadings {
    /// How many frames there are.
    pub fn frames(&self) -> usize {
        self.positions.len()
    }

    /// The readings of texel `n` in frame `k`, and what is predicted for them.
    pub fn of(&self, n: usize, k: usize) -> (Rgb<f32>, Rgb<f32>) {
        let at = n * self.frames() + k;
        (self.measured[at], self.predicted[at])
    }

    /// Texel `n` in frame `k` as the camera saw it, less the dark frame.
    pub fn raw(&self, n: usize, k: usize) -> Rgb<f32> {
        let at = n * self.frames() + k;
        let gain = self.gain.get(at).copied().unwrap_or(Rgb::splat(1.0));
        self.measured[at] * gain
    }
}

impl TexelSample {
    /// Reads the sample; `None` where no texel has been fitted.
    ///
    /// # Errors
    /// Frames that cannot be read.
    pub fn read(
        capture: &TubeCapture,
        scan: &ScanRecord,
        fitted: &LeafSideFit,
        level: &CameraNoise,
    ) -> Result<Option<TexelSample>> {
        let m = &capture.manifest;
        let Some(texel) = texel_of(&fitted.maps) else { return Ok(None) };
        let known: Vec<bool> = (0..fitted.mask.len()).map(|k| fitted.measured.mask[k] && texel(k).is_some()).collect();
        let texels = choose(&known, m.width);
        if texels.is_empty() {
            return Ok(None);
        }
        let index = |t: &[u32; 2]| t[1] as usize * m.width + t[0] as usize;
        let place: HashMap<[u32; 2], usize> = texels.iter().enumerate().map(|(n, t)| (*t, n)).collect();
        let beside =
            |t: &[u32; 2]| [[t[0] + 1, t[1]], [t[0], t[1].wrapping_sub(1)]].map(|next| place.get(&next).copied());
        let mut sample = TexelSample {
            side: fitted.side,
            at: texels.iter().map(|t| m.texel_position(*t)).collect(),
            fitted: texels.iter().filter_map(|t| texel(index(t))).collect(),
            noise: level.readings(capture, &texels),
            beside: texels.iter().map(beside).collect(),
            passes: Vec::new(),
            place,
            texels,
        };
        for pass in &m.passes {
            sample.passes.push(readings(capture, scan, &sample, pass.name, pass.positions())?);
        }
        Ok(Some(sample))
    }

    /// The sampled texel that lies so many columns to the right of texel `n` and so many rows above it.
    pub fn at(&self, n: usize, right: i32, up: i32) -> Option<usize> {
        let [i, j] = self.texels[n];
        self.place.get(&[i.checked_add_signed(right)?, j.checked_add_signed(-up)?]).copied()
    }

    /// The readings of frame `k` of a pass where texel `n` lies in a picture that is shifted to the right and upwards,
    /// between texels by their weights, and the variance of that mean over a reading's. `None` where the sample does
    /// not reach so far.
    pub fn shifted(&self, pass: &PassReadings, n: usize, k: usize, shift: [f64; 2]) -> Option<(Rgb<f32>, f64)> {
        let (mut sum, mut variance) = (Rgb::splat(0.0), 0.0);
        let [right, up] = shift.map(f64::floor);
        for (b, a) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let share = |whole: f64, of: f64, next: i32| if next == 1 { of - whole } else { 1.0 - of + whole };
            let weight = share(right, shift[0], a) * share(up, shift[1], b);
            if weight > 0.0 {
                sum += pass.of(self.at(n, right as i32 + a, up as i32 + b)?, k).0 * weight as f32;
                variance += weight * weight;
            }
        }
        Some((sum, variance))
    }

    /// Residual of a reading in units of its noise. The noise is that of the predicted value.
    pub fn residual(&self, n: usize, c: usize, measured: f32, predicted: f32) -> f64 {
        (f64::from(measured) - f64::from(predicted)) / self.noise[n].variance(c, f64::from(predicted)).sqrt()
    }
}

fn readings(
    capture: &TubeCapture,
    scan: &ScanRecord,
    sample: &TexelSample,
    travel: Travel,
    positions: Vec<f64>,
) -> Result<PassReadings> {
    let frames: Vec<usize> = (0..positions.len()).collect();
    let predictor = FramePredictor::new(scan, travel, &positions);
    let predicted: Vec<Rgb<f32>> = (0..sample.texels.len())
        .into_par_iter()
        .map_init(PredictionScratch::default, |scratch, n| predictor.values(scratch, &sample.fitted[n], sample.at[n]))
        .flat_map_iter(|values| values.into_iter().map(|v| v.map(|v| v as f32)))
        .collect();
    let mut gain = Vec::new();
    for k in 0..positions.len() {
        let Some(of_frame) = capture.gain_of_frame(travel, k, &sample.texels) else { break };
        gain.resize(predicted.len(), Rgb::splat(f32::NAN));
        of_frame.into_iter().enumerate().for_each(|(n, g)| gain[n * positions.len() + k] = g);
    }
    let mut measured = vec![Rgb::splat(f32::NAN); predicted.len()];
    // Texels are in the order of their rows. Rows that follow each other are read at once.
    let mut from = 0;
    while from < sample.texels.len() {
        let row = |n: usize| sample.texels[n][1];
        let mut to = from + 1;
        while to < sample.texels.len() && row(to) <= row(to - 1) + 1 {
            to += 1;
        }
        let rows = row(from) as usize..row(to - 1) as usize + 1;
        let band = capture.band(sample.side, travel, rows, &sample.texels[from..to], &frames)?;
        for (k, frame) in band.iter().enumerate() {
            for (n, value) in frame.iter().enumerate() {
                measured[(from + n) * positions.len() + k] = *value;
            }
        }
        from = to;
    }
    Ok(PassReadings { travel, positions, measured, predicted, gain })
}

/// Texels of the sample, row by row: all of a small leaf, else blocks of 3 × 3 on an even grid.
fn choose(known: &[bool], width: usize) -> Vec<[u32; 2]> {
    let all = known.iter().filter(|k| **k).count();
    let of = |k: usize| [(k % width) as u32, (k / width) as u32];
    if all <= TEXELS {
        return (0..known.len()).filter(|k| known[*k]).map(of).collect();
    }
    let inside: Vec<[u32; 2]> = (0..known.len()).filter(|k| known[*k]).map(of).collect();
    let range = |axis: usize| {
        let low = inside.iter().map(|t| t[axis]).min().unwrap_or(0);
        (low, inside.iter().map(|t| t[axis]).max().unwrap_or(0) + 1 - low)
    };
    let (columns, rows) = (range(0), range(1));
    // Whether a coordinate lies in one of `count` stretches of three that are evenly spread over the range.
    let in_block = |at: u32, (low, length): (u32, u32), count: usize| {
        let pitch = (f64::from(length) / count as f64).max(3.0);
        let within = (f64::from(at - low) + 0.5) % pitch;
        (within - 0.5 * pitch).abs() <= 1.5
    };
    let chosen = |t: &[u32; 2]| in_block(t[0], columns, BLOCKS[0]) && in_block(t[1], rows, BLOCKS[1]);
    inside.into_iter().filter(chosen).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_leaf_is_sampled_in_blocks_and_a_small_one_whole() {
        let (width, height) = (720, 540);
        let leaf: Vec<bool> = (0..width * height)
            .map(|k| {
                let (x, y) = ((k % width) as f64 / 360.0 - 1.0, (k / width) as f64 / 270.0 - 1.0);
                x * x + y * y < 0.8
            })
            .collect();
        let texels = choose(&leaf, width);
        assert!((1000..3500).contains(&texels.len()), "{}", texels.len());
        // Almost every texel has a neighbour, and rows come in few bands.
        let set: std::collections::HashSet<[u32; 2]> = texels.iter().copied().collect();
        let beside = texels.iter().filter(|t| set.contains(&[t[0] + 1, t[1]])).count();
        assert!(2 * beside > texels.len(), "{beside} of {}", texels.len());
        let rows: std::collections::BTreeSet<u32> = texels.iter().map(|t| t[1]).collect();
        assert!(rows.len() <= 4 * BLOCKS[1], "{rows:?}");
        assert_eq!(choose(&leaf[..width], width).len(), leaf[..width].iter().filter(|l| **l).count());
    }
}
