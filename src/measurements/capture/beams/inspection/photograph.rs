//! One photograph: its brightness, its noise, whether it is clipped, and how much of the leaf it shows.

use crate::beams::manifest::BeamPhotograph;
use crate::dome::noise::deviation;
use mesophyll_base::statistics::{median_of, quantile};
use serde::Serialize;

/// A photograph's readings; 1 is a white sheet that faces the beam. Shares are 0 to 1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BeamPhotographSummary {
    /// Number of the beam, from 1.
    pub beam: usize,
    /// The photograph's file, relative to the capture's folder.
    pub file: String,
    /// The side that the light falls on.
    pub lit: &'static str,
    /// Elevation of the light over the blade's plane (degrees).
    pub elevation_deg: f64,
    /// Azimuth of the light in the lit side's image (degrees), from right to up.
    pub azimuth_deg: f64,
    /// Quantile .001 of the readings of all channels.
    pub low: f64,
    /// Median of the readings of all channels.
    pub median: f64,
    /// Their quantile .999.
    pub high: f64,
    /// Median of each channel (R G B).
    pub colour: [f64; 3],
    /// Standard deviation of the noise seen, a channel each. It is an upper bound, because fine texture counts as
    /// noise. `None` where too little of the leaf is seen.
    pub noise: [Option<f64>; 3],
    /// Texels with a number in every channel.
    pub read: usize,
    /// Of the texels that any photograph reads: the share without a number in some channel of this one.
    pub no_reading_share: f64,
    /// Share of the readings below 0.
    pub negative_share: f64,
    /// Share of the readings above the white sheet.
    pub above_white_share: f64,
    /// Readings that have exactly the largest value: many where a sensor clips.
    pub at_the_top: usize,
}

/// Readings of one value are no chance if there are more than this many, and more than this share.
const CLIPPED: (usize, f64) = (8, 1e-3);
/// Shares above which a warning is due.
const FEW: f64 = 0.01;
/// Noise of a reading over the median that leaves little to fit.
const NOISY: f64 = 0.5;
/// Readings below zero are no chance if they are this many standard deviations below.
const BELOW: f64 = 4.0;

impl BeamPhotographSummary {
    /// The `k`-th photograph, as it was read: a channel each, row by row.
    pub fn look(k: usize, beam: &BeamPhotograph, channels: &[Vec<f64>; 3], width: usize) -> BeamPhotographSummary {
        let read: Vec<bool> = (0..channels[0].len()).map(|at| channels.iter().all(|c| c[at].is_finite())).collect();
        let mut all: Vec<f64> = channels.iter().flatten().copied().filter(|v| v.is_finite()).collect();
        let highest = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let share =
            |test: &dyn Fn(f64) -> bool| all.iter().filter(|v| test(**v)).count() as f64 / all.len().max(1) as f64;
        let (negative_share, above_white_share) = (share(&|v| v < 0.0), share(&|v| v > 1.0));
        let at_the_top = all.iter().filter(|v| **v == highest).count();
        let [low, median, high] = [0.001, 0.5, 0.999].map(|q| quantile(&mut all, q).unwrap_or(0.0));
        let each = |c: usize| median_of(channels[c].iter().copied().filter(|v| v.is_finite())).unwrap_or(0.0);
        BeamPhotographSummary {
            beam: k + 1,
            file: beam.file.clone(),
            lit: beam.lit.name(),
            elevation_deg: beam.elevation_deg,
            azimuth_deg: beam.azimuth_deg,
            low,
            median,
            high,
            colour: [0, 1, 2].map(each),
            noise: [0, 1, 2].map(|c: usize| deviation(&channels[c], &read, width).map(|(sd, _)| sd)),
            read: read.iter().filter(|r| **r).count(),
            no_reading_share: 0.0,
            negative_share,
            above_white_share,
            at_the_top,
        }
    }

    /// Warnings that follow from the readings alone.
    pub fn warnings(&self, warnings: &mut Vec<String>) {
        let mut warn = |text: String| warnings.push(format!("{}: {text}", self.file));
        let readings = 3 * self.read;
        if self.at_the_top > CLIPPED.0 && self.at_the_top as f64 > CLIPPED.1 * readings as f64 {
            warn(format!(
                "{} readings share the highest value, {:.4}: clipped? Write NaN where saturated",
                self.at_the_top, self.high
            ));
        }
        if self.above_white_share > FEW {
            warn(format!(
                "{:.1} % of the readings are brighter than a white sheet that faces the beam: divided by the sheet's \
                 photograph? Stray light beside the leaf?",
                100.0 * self.above_white_share
            ));
        }
    }

    /// Warnings that follow from the noise; `stated` holds the relative part and the floor, otherwise the noise seen is
    /// used.
    pub(crate) fn doubts(&self, stated: Option<[f64; 2]>, warnings: &mut Vec<String>) {
        let mut warn = |text: String| warnings.push(format!("{}: {text}", self.file));
        let sd = |c: usize| match stated {
            Some([relative, floor]) => Some((relative * self.colour[c]).hypot(floor)),
            None => self.noise[c],
        };
        for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
            if let Some(sd) = sd(c).filter(|sd| *sd > NOISY * self.colour[c]) {
                warn(format!(
                    "{name}: a reading's noise is about {sd:.1e}, the median reading {:.1e}: under-exposed?",
                    self.colour[c]
                ));
            }
        }
        // Where the noise is not stated, that of the darkest channel shows what chance does.
        let floor = stated.map(|s| s[1]).or(self.noise.iter().flatten().copied().reduce(f64::min)).unwrap_or(0.0);
        if self.negative_share > FEW && self.low < -BELOW * floor {
            let share = 100.0 * self.negative_share;
            warn(format!(
                "{share:.1} % of the readings are negative, down to {:.1e}: is the dark level too high?",
                self.low
            ));
        }
    }

    /// Records and reports the share of the leaf's `texels` that the photograph misses.
    pub fn miss(&mut self, texels: usize, warnings: &mut Vec<String>) {
        self.no_reading_share = 1.0 - self.read as f64 / texels.max(1) as f64;
        if self.no_reading_share > FEW {
            warnings.push(format!("{}: {:.1} % of the leaf has no reading", self.file, 100.0 * self.no_reading_share));
        }
    }
}
