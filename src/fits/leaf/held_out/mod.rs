//! Frames that no fit sees. `fit leaf` leaves out one frame of every N, predicts it from the fitted ρd, ρs, m and
//! normals with the tube model, and compares the prediction with what was measured, in units of the measurement's
//! noise. Some of these frames are kept in the fit's folder, so that the fit can be judged by a measurement for as long
//! as it exists.
//!
//! **What to expect.** A reading that the fit did not see differs from its prediction for two reasons: its own noise,
//! and the errors of the fitted parameters. Let J be the weighted slopes of a texel's fitted readings by its
//! parameters, and j those of the held-out reading. In units of the noise, the expected square is 1 + j (JᵀJ)⁻¹ jᵀ. It
//! is a little above 1: the mean of the second term is about parameters/readings. It is computed, not assumed: see
//! [`leverage`].

mod frames;
mod judge;
mod leverage;
mod prediction;

pub use frames::{LIGHT_BOX, StoredFrame, StoredFrames, kept};
pub use judge::{HeldOutJudgement, ResidualTally, judge, stored_step};
pub use leverage::{TexelErrors, known_errors};
pub use prediction::{FramePredictor, PredictionScratch, TexelParameters, texel_of};

use crate::record::scan::{HeldOutResiduals, LightBoxResiduals, ScanRecord, off};
use mesophyll_base::random::RandomStream;
use mesophyll_capture::manifest::TubeManifest;
use mesophyll_optics::tube::Travel;

/// A pass with fewer frames than this keeps all of them for the fit: a texel has nine parameters, and every frame is
/// needed.
pub const FEWEST_FRAMES: usize = 20;
/// A reading that is farther from its prediction than this many standard deviations counts as exactly this many, so
/// that a spark in one frame does not hide all other readings.
pub const FARTHEST: f64 = 5.0;
/// A prediction that is off by less than this share of the noise is good …
pub const GOOD: f64 = 1.0 / 3.0;
/// … and one that is off by more than the noise of a single reading is bad.
pub const BAD: f64 = 1.0;

/// Which frames are left out: one of every `every` in a row, drawn by `seed`; 0 leaves none out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HoldOutRule {
    /// One of this many frames is left out; 0 leaves none out.
    pub every: usize,
    /// Decides which one of each group it is.
    pub seed: u64,
}

impl Default for HoldOutRule {
    fn default() -> Self {
        HoldOutRule { every: 20, seed: 1 }
    }
}

/// The frames of one pass, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FrameSplit {
    /// Frames that the fit sees, by their number in the pass.
    pub kept: Vec<usize>,
    /// Frames that it does not see.
    pub held: Vec<usize>,
}

impl HoldOutRule {
    /// Divides the frames of a pass. Each whole group of `every` frames loses the one that the seed names; both sides
    /// of a leaf lose the same ones.
    pub fn split(&self, travel: Travel, frames: usize) -> FrameSplit {
        if self.every == 0 || frames < FEWEST_FRAMES {
            return FrameSplit { kept: (0..frames).collect(), held: Vec::new() };
        }
        let mut draw = RandomStream::new(self.seed, &[0x401d, travel as u64]);
        let held: Vec<usize> = (0..frames / self.every)
            .map(|group| group * self.every + (draw.uniform() * self.every as f64) as usize)
            .collect();
        FrameSplit { kept: (0..frames).filter(|k| !held.contains(k)).collect(), held }
    }
}

/// The frames of both passes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FrameSplits {
    /// Frames of pass x.
    pub x: FrameSplit,
    /// Frames of pass y.
    pub y: FrameSplit,
}

impl FrameSplits {
    /// The frames of one pass.
    pub fn of(&self, travel: Travel) -> &FrameSplit {
        match travel {
            Travel::X => &self.x,
            Travel::Y => &self.y,
        }
    }

    /// Whether any frame is left out.
    pub fn any(&self) -> bool {
        !(self.x.held.is_empty() && self.y.held.is_empty())
    }
}

/// The frames that were left out, in words: `every 20th frame, seed 1; pass x: 5 of 100 (12 33 51 70 99); pass y: none
/// of 16, fewer than 20`.
pub fn in_words(manifest: &TubeManifest, told: HoldOutRule, splits: &FrameSplits) -> String {
    if told.every == 0 {
        return "no frame".into();
    }
    let mut text = format!("one frame of every {}, seed {}", told.every, told.seed);
    for pass in &manifest.passes {
        let FrameSplit { kept, held } = splits.of(pass.name);
        let all = kept.len() + held.len();
        let list: Vec<String> = held.iter().map(usize::to_string).collect();
        text += &match held.len() {
            0 if all < FEWEST_FRAMES => {
                format!("; pass {}: none of {all}, fewer than {FEWEST_FRAMES} stay whole", pass.name.name())
            }
            0 => format!("; pass {}: none of {all}", pass.name.name()),
            n => format!("; pass {}: {n} of {all} ({})", pass.name.name(), list.join(" ")),
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_frame_of_every_group_is_left_out_and_few_frames_stay_whole() {
        let hold_out = HoldOutRule::default();
        let split = hold_out.split(Travel::X, 107);
        assert_eq!(split.held.len(), 5);
        assert!(split.held.iter().enumerate().all(|(g, k)| (20 * g..20 * (g + 1)).contains(k)), "{:?}", split.held);
        let mut all = [split.kept.clone(), split.held.clone()].concat();
        all.sort_unstable();
        assert_eq!(all, (0..107).collect::<Vec<_>>());
        // Another pass and another seed draw other frames; the same ones draw the same.
        assert_ne!(hold_out.split(Travel::Y, 107).held, split.held);
        assert_ne!(HoldOutRule { seed: 2, ..hold_out }.split(Travel::X, 107).held, split.held);
        assert_eq!(hold_out.split(Travel::X, 107), split);
        for (every, frames) in [(20, 19), (0, 100), (20, 8), (40, 30)] {
            assert!(HoldOutRule { every, seed: 1 }.split(Travel::X, frames).held.is_empty(), "{every} of {frames}");
        }
    }
}
