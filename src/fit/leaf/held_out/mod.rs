//! Frames that no fit sees. `fit leaf` leaves out one frame of every N, predicts it from the fitted ρd, ρs, m and
//! normals with the tube model, and compares the prediction with what was measured, in units of the measurement's
//! noise. Some of these frames are kept in the fit's folder, so that the fit can be judged by a measurement for as long
//! as it exists.
//!
//! **What to expect.** A reading that the fit did not see differs from its prediction by its own noise and by what the
//! fit's parameters are off. With the weighted slopes J of a texel's readings to its parameters, the expected square is
//! 1 + j (JᵀJ)⁻¹ jᵀ for a reading of slope j, in units of the noise: a little above 1 (the mean of the second term is
//! about parameters / readings). It is computed, not assumed: [`leverage`].

mod judge;
mod leverage;
mod predict;
mod stored;

pub use judge::{Judged, Tally, judge, stored_step};
pub use predict::{Predictor, Scratch, Texel, texel_of};
pub use stored::{Kept, KeptFrame, LIGHT_BOX, kept};

use mesophyll_capture::manifest::{Manifest, Travel};
use mesophyll_capture::synth::random::Stream;
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Tube;
use serde::{Deserialize, Serialize};

/// A pass of fewer frames keeps all of them for the fit: a texel has nine parameters, and every frame counts.
pub const FEWEST_FRAMES: usize = 20;
/// A reading farther from its prediction counts as this many standard deviations, so that a spark in one frame does not
/// hide all other readings.
pub const FARTHEST: f64 = 5.0;
/// A prediction that is off by less than this share of the noise is good …
pub const GOOD: f64 = 1.0 / 3.0;
/// … and one that is off by more than the noise of a single reading is bad.
pub const BAD: f64 = 1.0;

/// Which frames are left out: one of every `every` in a row, drawn by `seed`; 0 leaves none out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HoldOut {
    pub every: usize,
    pub seed: u64,
}

impl Default for HoldOut {
    fn default() -> Self {
        HoldOut { every: 20, seed: 1 }
    }
}

/// The frames of one pass, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Split {
    pub kept: Vec<usize>,
    pub held: Vec<usize>,
}

impl HoldOut {
    /// Divides the frames of a pass. Each whole group of `every` frames loses the one that the seed names; both sides
    /// of a leaf lose the same ones.
    pub fn split(&self, travel: Travel, frames: usize) -> Split {
        if self.every == 0 || frames < FEWEST_FRAMES {
            return Split { kept: (0..frames).collect(), held: Vec::new() };
        }
        let mut draw = Stream::new(self.seed, &[0x401d, travel as u64]);
        let held: Vec<usize> = (0..frames / self.every)
            .map(|group| group * self.every + (draw.uniform() * self.every as f64) as usize)
            .collect();
        Split { kept: (0..frames).filter(|k| !held.contains(k)).collect(), held }
    }
}

/// The frames of both passes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Splits {
    pub x: Split,
    pub y: Split,
}

impl Splits {
    pub fn of(&self, travel: Travel) -> &Split {
        match travel {
            Travel::X => &self.x,
            Travel::Y => &self.y,
        }
    }

    pub fn any(&self) -> bool {
        !(self.x.held.is_empty() && self.y.held.is_empty())
    }
}

/// What was left out, for people: `every 20th frame, seed 1; pass x: 5 of 100 (12 33 51 70 99); pass y: none of 16,
/// fewer than 20`.
pub fn in_words(manifest: &Manifest, told: HoldOut, splits: &Splits) -> String {
    if told.every == 0 {
        return "no frame".into();
    }
    let mut text = format!("one frame of every {}, seed {}", told.every, told.seed);
    for pass in &manifest.passes {
        let Split { kept, held } = splits.of(pass.name);
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

/// The device of a scan as the fit took it: what a frame is predicted with. `[scan]` in `fit.toml`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Scan {
    pub texel_mm: f64,
    /// Orthographic camera in the direction (sin, 0, cos).
    pub camera_deg: f64,
    pub lightbox_camera_deg: f64,
    pub tube_height_mm: f64,
    pub tube_length_mm: f64,
    pub tube_radius_mm: f64,
    /// `beckmann`, `ggx` or `cook-torrance`, the latter with its index.
    pub lobe: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lobe_index: Option<f64>,
    /// Standard deviation of a reading: √((relative · value)² + floor²).
    pub noise_relative: f64,
    pub noise_floor: f64,
    /// One frame of every so many was left out (0: none), as this seed drew it.
    pub hold_out: usize,
    pub hold_out_seed: u64,
    /// Every so many rows and columns stand in the files of held-out frames, from the first on.
    pub stored_step: usize,
}

impl Scan {
    pub fn tube(&self) -> Tube {
        Tube { height_mm: self.tube_height_mm, length_mm: self.tube_length_mm, radius_mm: self.tube_radius_mm }
    }

    /// Towards the camera.
    pub fn camera(&self) -> [f64; 3] {
        let (sin, cos) = self.camera_deg.to_radians().sin_cos();
        [sin, 0.0, cos]
    }

    pub fn lobe(&self) -> Lobe {
        match self.lobe.as_str() {
            "ggx" => Lobe::Ggx,
            "cook-torrance" => Lobe::CookTorrance { index: self.lobe_index.unwrap_or(1.5) },
            _ => Lobe::Beckmann,
        }
    }

    /// Name and index of a lobe.
    pub fn name_lobe(lobe: Lobe) -> (String, Option<f64>) {
        match lobe {
            Lobe::Beckmann => ("beckmann".into(), None),
            Lobe::Ggx => ("ggx".into(), None),
            Lobe::CookTorrance { index } => ("cook-torrance".into(), Some(index)),
        }
    }

    /// Standard deviation of a reading of this value.
    pub fn noise(&self, value: f64) -> f64 {
        (self.noise_relative * value).hypot(self.noise_floor.max(1e-6))
    }
}

/// How well one pass's held-out frames are predicted. `[front.held_out.x]` in `fit.toml`; residuals are in standard
/// deviations of the noise.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct HeldOut {
    /// Frames that the fit did not see, and where the tube stood (mm).
    pub frames: Vec<usize>,
    pub positions_mm: Vec<f64>,
    /// Those of them whose readings stand in `front_held_out.exr`.
    pub stored: Vec<usize>,
    pub readings: usize,
    /// Mean square of the residuals, each counted as 5 at most.
    pub reduced_chi2: f64,
    /// What a right fit leaves: 1 and its parameters' own errors.
    pub expected: f64,
    /// Standard error of `reduced_chi2`, from the scatter over the texels.
    pub stderr: f64,
    /// Share of residuals beyond 3 (0.0027 of Gaussian noise).
    pub share_beyond_3: f64,
    /// Mean residual, measured less predicted.
    pub bias: f64,
    /// `reduced_chi2` and what is expected of it a frame, in the order of `frames`, and the frame where it is largest.
    pub frame_chi2: Vec<f64>,
    pub frame_expected: Vec<f64>,
    pub worst_frame: usize,
    pub worst_frame_chi2: f64,
    /// Largest residual and its texel (column, row).
    pub worst: f64,
    pub worst_at: [usize; 2],
}

impl HeldOut {
    /// How far predictions are off, beyond noise and chance, in units of the noise of one reading.
    pub fn off(&self) -> f64 {
        off(self.reduced_chi2, self.expected, self.stderr)
    }
}

/// How far a model is off in units of the noise: an error of e times the noise raises the mean square from its
/// expectation by the factor
/// 1 + e². Two standard errors are chance.
pub fn off(reduced_chi2: f64, expected: f64, stderr: f64) -> f64 {
    let excess = (reduced_chi2 - 2.0 * stderr) / expected - 1.0;
    // A figure that is no number is no agreement.
    if excess.is_nan() { f64::INFINITY } else { excess.max(0.0).sqrt() }
}

/// What came through the light box against the slab of σa, σs and h + δ. `[front.light_box]` in `fit.toml`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LightBox {
    /// Standard deviation of a transmittance: √((relative · value)² + floor²), the floor a channel.
    pub noise_relative: f64,
    pub noise_floor: [f64; 3],
    pub readings: usize,
    pub reduced_chi2: f64,
    /// Each texel's thickness was fitted to its three transmittances: two of three are left.
    pub expected: f64,
    pub stderr: f64,
    pub bias: f64,
}

impl LightBox {
    pub fn off(&self) -> f64 {
        off(self.reduced_chi2, self.expected, self.stderr)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_frame_of_every_group_is_left_out_and_few_frames_stay_whole() {
        let hold_out = HoldOut::default();
        let split = hold_out.split(Travel::X, 107);
        assert_eq!(split.held.len(), 5);
        assert!(split.held.iter().enumerate().all(|(g, k)| (20 * g..20 * (g + 1)).contains(k)), "{:?}", split.held);
        let mut all = [split.kept.clone(), split.held.clone()].concat();
        all.sort_unstable();
        assert_eq!(all, (0..107).collect::<Vec<_>>());
        // Another pass and another seed draw other frames; the same ones draw the same.
        assert_ne!(hold_out.split(Travel::Y, 107).held, split.held);
        assert_ne!(HoldOut { seed: 2, ..hold_out }.split(Travel::X, 107).held, split.held);
        assert_eq!(hold_out.split(Travel::X, 107), split);
        for (every, frames) in [(20, 19), (0, 100), (20, 8), (40, 30)] {
            assert!(HoldOut { every, seed: 1 }.split(Travel::X, frames).held.is_empty(), "{every} of {frames}");
        }
    }

    #[test]
    fn an_error_of_the_noise_s_size_is_off_by_one() {
        assert!((off(2.0 * 1.05, 1.05, 0.0) - 1.0).abs() < 1e-12);
        assert_eq!(off(1.0, 1.05, 0.0), 0.0);
        assert_eq!(off(1.2, 1.0, 0.1), 0.0);
        assert_eq!(off(f64::NAN, 1.0, 0.1), f64::INFINITY);
    }
}
