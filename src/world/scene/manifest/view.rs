//! The cameras of a scene, and how a picture is checked against its reference.

use super::table::StatedTable;
use crate::manifest::Result;
use glam::DVec3;
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use mesophyll_transport::ReferenceCamera;
use serde::{Deserialize, Serialize};

/// What a view shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ViewKind {
    /// The scene as it stands.
    #[default]
    Perspective,
    /// A flat patch with the mean parameters of one leaf, under the scene's light. Its radiance is known in closed
    /// form.
    Card,
    /// A leaf as its scan saw it, drawn from the fit and compared with a frame that the fit did not use.
    Capture,
}

/// What transmitted light by translucency maps is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TranslucencyReference {
    /// The full convolution for the sun's present direction.
    #[default]
    Convolution,
    /// The reference with the stored coefficients. Then only the renderer is judged, and the error of the basis is
    /// reported separately.
    Maps,
}

/// A picture of the scene.
#[derive(Debug, Clone, PartialEq)]
pub enum SceneView {
    /// The scene as it stands.
    Perspective(PerspectiveView),
    /// A flat patch with the mean parameters of one leaf.
    Card(CardView),
    /// A leaf as its scan saw it.
    Capture(CaptureView),
}

/// The scene as it stands.
#[derive(Debug, Clone, PartialEq)]
pub struct PerspectiveView {
    /// Name of the view, which its files carry.
    pub name: String,
    /// Where it is seen from.
    pub camera: ReferenceCamera,
    /// Time at which the scene is seen, instead of the wind's `time_s`.
    pub time_s: Option<f64>,
    /// Largest 99th percentile of FLIP against the reference.
    pub flip_p99: Option<f64>,
    /// Largest difference of a displayed value (0 to 1) over interior pixels.
    pub max_error: Option<f64>,
    /// Largest median time of a frame (ms), which is judged on real GPUs only.
    pub frame_ms: Option<f64>,
    /// Side of blocks in pixels. Pictures are compared by the means of these blocks, where the picture is right only on
    /// average, as with slices for a lawn's blades.
    pub blocks: Option<u32>,
    /// What transmitted light is compared with.
    pub judged_by: TranslucencyReference,
}

/// A flat patch with the mean parameters of one leaf, under the scene's light.
#[derive(Debug, Clone, PartialEq)]
pub struct CardView {
    /// Name of the view, which its files carry.
    pub name: String,
    /// Where it is seen from.
    pub camera: ReferenceCamera,
    /// The leaf.
    pub leaf: String,
    /// How the card is turned: angles about x, then y, then z.
    pub rotation_deg: [f64; 3],
    /// Largest relative difference of the radiance from the closed form.
    pub max_error: Option<f64>,
    /// Largest median time of a frame (ms), which is judged on real GPUs only.
    pub frame_ms: Option<f64>,
}

/// A leaf as its scan saw it. Of the held-out frames that match, the brightest one that the fit keeps is taken.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureView {
    /// Name of the view, which its files carry.
    pub name: String,
    /// The leaf.
    pub leaf: String,
    /// Side of the frame.
    pub side: Side,
    /// The axis along which the tube travelled.
    pub pass: Option<Travel>,
    /// Number of the frame in its pass.
    pub frame: Option<usize>,
    /// The allowed error of the picture in units of the measurement's noise.
    pub max_error: Option<f64>,
}

impl SceneView {
    /// Name of the view.
    pub fn name(&self) -> &str {
        match self {
            SceneView::Perspective(view) => &view.name,
            SceneView::Card(view) => &view.name,
            SceneView::Capture(view) => &view.name,
        }
    }

    pub(super) fn read(mut t: StatedTable) -> Result<SceneView> {
        let name = t.name()?;
        let (view, what) = match t.needed("kind")? {
            ViewKind::Perspective => {
                let mut view = PerspectiveView::new(&name, camera(&mut t)?);
                (view.time_s, view.flip_p99) = (t.stated("time_s")?, t.stated("flip_p99")?);
                (view.max_error, view.frame_ms) = (t.stated("max_error")?, t.stated("frame_ms")?);
                (view.blocks, view.judged_by) = (t.stated("blocks")?, t.stated("judged_by")?.unwrap_or_default());
                (SceneView::Perspective(view), "a perspective view, which shows the whole scene")
            }
            ViewKind::Card => {
                let (leaf, camera) = (t.needed("leaf")?, camera(&mut t)?);
                let rotation_deg = t.stated("rotation_deg")?.unwrap_or_default();
                let (max_error, frame_ms) = (t.stated("max_error")?, t.stated("frame_ms")?);
                let view = CardView { name, camera, leaf, rotation_deg, max_error, frame_ms };
                (SceneView::Card(view), "a card, which does not move and is judged by max_error alone")
            }
            ViewKind::Capture => {
                let (leaf, side) = (t.needed("leaf")?, t.stated("side")?.unwrap_or(Side::Front));
                let (pass, frame, max_error) = (t.stated("pass")?, t.stated("frame")?, t.stated("max_error")?);
                let view = CaptureView { name, leaf, side, pass, frame, max_error };
                (SceneView::Capture(view), "a capture view, which has the camera and the light of its scan")
            }
        };
        t.finish(&format!(", but view \"{}\" is {what}", view.name()))?;
        Ok(view)
    }
}

impl PerspectiveView {
    /// A view without limits, at the wind's own time.
    pub fn new(name: &str, camera: ReferenceCamera) -> PerspectiveView {
        let (time_s, flip_p99, max_error, frame_ms, blocks) = (None, None, None, None, None);
        let judged_by = TranslucencyReference::default();
        PerspectiveView { name: name.into(), camera, time_s, flip_p99, max_error, frame_ms, blocks, judged_by }
    }
}

/// Where a view is seen from.
fn camera(t: &mut StatedTable) -> Result<ReferenceCamera> {
    let (eye, target, up) = (t.needed::<[f64; 3]>("eye_mm")?, t.needed::<[f64; 3]>("target_mm")?, t.stated("up")?);
    let (eye, target): (DVec3, DVec3) = (eye.into(), target.into());
    // A camera that looks straight down or up has north above.
    let level = (target - eye).truncate() != glam::DVec2::ZERO;
    let usual = if level { DVec3::Z } else { DVec3::Y };
    Ok(ReferenceCamera { eye, target, up: up.map_or(usual, <[f64; 3]>::into), fov_y_deg: t.needed("fov_deg")? })
}

/// The exposure of a camera, for pictures that are made to be looked at (`mesophyll render --tone film`).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneCamera {
    /// Focal length over the width of the aperture.
    pub f_number: f64,
    /// Time for which the shutter is open.
    pub shutter_s: f64,
    /// Speed of the film or of the sensor.
    #[serde(default = "iso")]
    pub iso: f64,
}

fn iso() -> f64 {
    100.0
}

impl SceneCamera {
    /// The factor for luminance (cd/m²) that maps the luminance at which a sensor of this speed saturates to 1 (ISO
    /// 12232; Lagarde & de Rousiers 2014, §5.1.1): 1/(1.2 · 2^EV), where EV = log₂(N²/t · 100/S).
    pub fn exposure(&self) -> f64 {
        let light = self.f_number.powi(2) / self.shutter_s * 100.0 / self.iso;
        1.0 / (1.2 * light)
    }
}

/// The settings of a check.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CheckSettings {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Rays for each pixel of the reference.
    pub samples: u32,
    /// Frames that are timed for each view.
    pub frames: u32,
    /// Seconds of the film in the first view that shows whether anything pops; 0 for none. The film begins at the
    /// view's time.
    pub seconds: f64,
    /// Frames of that film for each second.
    pub fps: f64,
    /// Seed of the reference. Its noise is measured by comparison with the next seed.
    pub seed: u64,
}

impl CheckSettings {
    /// Pixels along a side of the blocks in which a film is judged.
    pub const FILM_BLOCK: u32 = 16;

    /// Number of frames of the film.
    pub fn film_frames(&self) -> u32 {
        (self.seconds * self.fps).round() as u32
    }
}

impl Default for CheckSettings {
    fn default() -> Self {
        CheckSettings { width: 800, height: 600, samples: 64, frames: 20, seconds: 0.0, fps: 30.0, seed: 1 }
    }
}
