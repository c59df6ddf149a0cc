//! Who looks, and how a picture is checked against its reference.

use mesophyll_capture::manifest::Travel;
use mesophyll_optics::side::Side;
use serde::Deserialize;

/// What a view shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ViewKind {
    /// The scene as it stands.
    #[default]
    Perspective,
    /// A flat patch with one leaf's mean parameters, lit as the scene is: its radiance is known in closed form.
    Card,
    /// A leaf as its own scan saw it, from the fit, against a frame that the fit did not see.
    Capture,
}

/// What light through translucency maps is judged against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JudgedBy {
    /// The full convolution for this very sun.
    #[default]
    Convolution,
    /// The reference by the stored coefficients: the renderer alone is judged, and what the basis costs is reported
    /// beside it.
    Maps,
}

/// A picture of the scene.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// What its files are called.
    pub name: String,
    /// What it shows.
    pub kind: ViewKind,
    /// Where the camera is.
    pub eye_mm: Option<[f64; 3]>,
    /// What it looks at.
    pub target_mm: Option<[f64; 3]>,
    /// What is up in the picture; z when absent.
    pub up: Option<[f64; 3]>,
    /// From the bottom of the picture to its top.
    pub fov_deg: Option<f64>,
    /// The card's or the scan's leaf, and how the card is turned.
    pub leaf: Option<String>,
    /// About x, then y, then z.
    pub rotation_deg: Option<[f64; 3]>,
    /// Which held-out frame of the scan: side (front where it is not said), pass and number. Where something is open it
    /// is the brightest one that the fit keeps.
    pub side: Option<Side>,
    /// The axis along which the tube travelled.
    pub pass: Option<Travel>,
    /// Number of the frame in its pass.
    pub frame: Option<usize>,
    /// When the scene is seen, instead of the wind's own time.
    pub time_s: Option<f64>,
    /// Largest 99th percentile of FLIP against the reference.
    pub flip_p99: Option<f64>,
    /// Largest difference of a displayed value (0 to 1) over interior pixels; for a card, of the radiance relative to
    /// the closed form; for a scan, how far the picture may be off in units of the measurement's noise.
    pub max_error: Option<f64>,
    /// Largest median frame time (ms); judged on real GPUs only.
    pub frame_ms: Option<f64>,
    /// Pictures are compared by the means of blocks of so many pixels a side: where what is drawn stands for what is there
    /// in the mean only, as slices do for a lawn's blades.
    pub blocks: Option<u32>,
    /// What translucency is compared with.
    #[serde(default)]
    pub judged_by: JudgedBy,
}

/// The exposure of a camera, for pictures that are made to be looked at (`mesophyll render --tone film`).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Focal length over the width of the aperture.
    pub f_number: f64,
    /// How long it is open.
    pub shutter_s: f64,
    /// The film's or the sensor's speed.
    #[serde(default = "iso")]
    pub iso: f64,
}

fn iso() -> f64 {
    100.0
}

impl Camera {
    /// What luminance (cd/m²) is multiplied with, so that 1 is where a sensor of this speed saturates (ISO 12232;
    /// Lagarde & de Rousiers 2014, §5.1.1): 1/(1.2 · 2^EV), with EV = log₂(N²/t · 100/S).
    pub fn exposure(&self) -> f64 {
        let light = self.f_number.powi(2) / self.shutter_s * 100.0 / self.iso;
        1.0 / (1.2 * light)
    }
}

/// How a check is done.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Check {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Rays a pixel of the reference.
    pub samples: u32,
    /// Frames timed a view.
    pub frames: u32,
    /// Seed of the reference; its noise is measured against the next seed.
    pub seed: u64,
}

impl Default for Check {
    fn default() -> Self {
        Check { width: 800, height: 600, samples: 64, frames: 20, seed: 1 }
    }
}
