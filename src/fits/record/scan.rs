//! What a leaf fit records of a scan under a tube: the device, and how well the fit predicts frames it did not see.

use super::FitRecord;
use mesophyll_capture::manifest::TubeManifest;
use mesophyll_optics::gloss::{Lobe, LobeKind};
use mesophyll_optics::tube::{Travel, Tube};
use serde::{Deserialize, Serialize};

/// Option: names of the passes that were taken.
pub const PASSES: &str = "passes";

/// The device of a scan as the fit used it; frames are predicted with it. `[scan]` in `fit.toml`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ScanRecord {
    /// Size of a texel (mm).
    pub texel_mm: f64,
    /// Orthographic camera in the direction (sin, 0, cos).
    pub camera_deg: f64,
    /// Angle of the camera to the normal over the light box (degrees).
    pub lightbox_camera_deg: f64,
    /// Height of the tube's axis over the leaf (mm).
    pub tube_height_mm: f64,
    /// Length of the tube (mm).
    pub tube_length_mm: f64,
    /// Radius of the tube (mm); 0 is a thin line.
    pub tube_radius_mm: f64,
    /// Name of the lobe.
    pub lobe: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    /// Refractive index of a lobe with Fresnel reflectance.
    pub lobe_index: Option<f64>,
    /// Standard deviation of a reading: √((relative · value)² + floor²).
    pub noise_relative: f64,
    /// The part of the noise that does not grow with the value.
    pub noise_floor: f64,
    /// Frames of pass x and of pass y that the capture has; 0 where an earlier program did not say.
    #[serde(default)]
    pub frames: [usize; 2],
    /// One frame of every this many was left out (0: none).
    pub hold_out: usize,
    /// Seed by which the frames were drawn.
    pub hold_out_seed: u64,
    /// The step between the rows and columns that the files of held-out frames contain, starting with the first.
    pub stored_step: usize,
}

impl ScanRecord {
    /// The tube.
    pub fn tube(&self) -> Tube {
        Tube { height_mm: self.tube_height_mm, length_mm: self.tube_length_mm, radius_mm: self.tube_radius_mm }
    }

    /// Towards the camera.
    pub fn camera(&self) -> [f64; 3] {
        let (sin, cos) = self.camera_deg.to_radians().sin_cos();
        [sin, 0.0, cos]
    }

    /// How many frames each pass of a capture has.
    pub fn count_frames(manifest: &TubeManifest) -> [usize; 2] {
        [Travel::X, Travel::Y].map(|travel| manifest.pass(travel).map_or(0, |pass| pass.positions().len()))
    }

    /// The lobe that was fitted.
    pub fn lobe(&self) -> Lobe {
        Lobe::of(self.lobe.parse().unwrap_or(LobeKind::Beckmann), self.lobe_index.unwrap_or(1.5))
    }

    /// Name and index of a lobe.
    pub fn name_lobe(lobe: Lobe) -> (String, Option<f64>) {
        (lobe.name().into(), lobe.index())
    }

    /// Standard deviation of a reading of this value.
    pub fn noise(&self, value: f64) -> f64 {
        (self.noise_relative * value).hypot(self.noise_floor.max(1e-6))
    }
}

impl FitRecord {
    /// The pass that a scan lacks. `None` where both were taken, and for fits of anything else.
    pub fn missing_pass(&self) -> Option<Travel> {
        let taken = self.options.get(PASSES)?;
        [Travel::X, Travel::Y].into_iter().find(|travel| taken.split_whitespace().all(|name| name != travel.name()))
    }
}

/// How well one pass's held-out frames are predicted. `[front.held_out.x]` in `fit.toml`; residuals are in standard
/// deviations of the noise.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct HeldOutResiduals {
    /// Numbers of the frames that the fit did not see.
    pub frames: Vec<usize>,
    /// Where the tube stood in each of them (mm).
    pub positions_mm: Vec<f64>,
    /// Those of `frames` whose readings are in `front_held_out.exr`.
    pub stored: Vec<usize>,
    /// How many readings were predicted: frames × texels × channels.
    pub readings: usize,
    /// Mean square of the residuals, each counted as 5 at most.
    pub reduced_chi2: f64,
    /// The value that a right fit gives: 1 for the noise, plus the effect of the errors of its parameters.
    pub expected: f64,
    /// Standard error of `reduced_chi2`, from the scatter over the texels.
    pub stderr: f64,
    /// Share of residuals beyond 3 (0.0027 of Gaussian noise).
    pub share_beyond_3: f64,
    /// Mean residual, measured less predicted.
    pub bias: f64,
    /// `reduced_chi2` of each frame, in the order of `frames`.
    pub frame_chi2: Vec<f64>,
    /// What is expected of `reduced_chi2` in each frame.
    pub frame_expected: Vec<f64>,
    /// The frame that is predicted worst.
    pub worst_frame: usize,
    /// `reduced_chi2` of that frame.
    pub worst_frame_chi2: f64,
    /// Largest residual.
    pub worst: f64,
    /// The texel of the largest residual: column, row.
    pub worst_at: [usize; 2],
}

impl HeldOutResiduals {
    /// How far predictions are off, beyond noise and chance, in units of the noise of one reading.
    pub fn off(&self) -> f64 {
        off(self.reduced_chi2, self.expected, self.stderr)
    }
}

/// How far a model is off in units of the noise. An error of e times the noise multiplies the mean square by 1 + e²
/// relative to its expectation. Two standard errors are attributed to chance.
pub fn off(reduced_chi2: f64, expected: f64, stderr: f64) -> f64 {
    let excess = (reduced_chi2 - 2.0 * stderr) / expected - 1.0;
    // A figure that is not a number counts as no agreement.
    if excess.is_nan() { f64::INFINITY } else { excess.max(0.0).sqrt() }
}

/// Compares the light box's transmittances with the slab of σa, σs and h + δ. `[front.light_box]` in `fit.toml`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LightBoxResiduals {
    /// Standard deviation of a transmittance: √((relative · value)² + floor²), the floor a channel.
    pub noise_relative: f64,
    /// The part of the noise that does not grow with the value, a channel.
    pub noise_floor: [f64; 3],
    /// How many transmittances were compared.
    pub readings: usize,
    /// Mean square of the residuals.
    pub reduced_chi2: f64,
    /// Each texel's thickness was fitted to its three transmittances, so two of three degrees of freedom are left.
    pub expected: f64,
    /// Standard error of `reduced_chi2`.
    pub stderr: f64,
    /// Mean residual, measured less the slab's.
    pub bias: f64,
}

impl LightBoxResiduals {
    /// How far the slab is off, beyond noise and chance, in units of the noise of one reading.
    pub fn off(&self) -> f64 {
        off(self.reduced_chi2, self.expected, self.stderr)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_of_one_pass_lacks_the_other() {
        let of = |passes: &str| FitRecord { options: [(PASSES.into(), passes.into())].into(), ..FitRecord::default() };
        assert_eq!(["x", "y", "x y"].map(|p| of(p).missing_pass()), [Some(Travel::Y), Some(Travel::X), None]);
        assert_eq!(FitRecord::default().missing_pass(), None);
    }

    #[test]
    fn an_error_of_the_noise_s_size_is_off_by_one() {
        assert!((off(2.0 * 1.05, 1.05, 0.0) - 1.0).abs() < 1e-12);
        assert_eq!(off(1.0, 1.05, 0.0), 0.0);
        assert_eq!(off(1.2, 1.0, 0.1), 0.0);
        assert_eq!(off(f64::NAN, 1.0, 0.1), f64::INFINITY);
    }
}
