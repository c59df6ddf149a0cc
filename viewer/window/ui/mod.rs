//! The state and the layout of the window. They do not depend on a real window: tests draw them offscreen, and
//! `open_window` draws them on screen.
//!
//! On the left is the leaf's appearance (Wang et al. 2005, Fig. 6). On the right are lights, check, texel read-out and
//! frame times. In the middle is the picture. Dragging turns it, dragging with the right button or with shift pans it,
//! the wheel zooms, and a click selects a leaf. Below are undo and redo, the comparison of two states (A and B), and
//! screenshots.

mod analysis;
mod appearance;
mod check;
mod comparison;
mod edits;
mod history;
mod layout;
mod light;
mod live_picture;
mod plants;
mod presets;
mod readout;
mod scene;
mod thumbnails;
mod wind;

pub use check::CheckLayout;
pub use scene::{WindowScene, WindowView};

use crate::editor::{Editor, LeafEdit};
use check::Check;
use egui::{Rect, Response};
use mesophyll_viewer::gpu::AdapterInfo;
use mesophyll_viewer::picking::PickHit;
use mesophyll_viewer::scene::{
    Camera, Instance, Interior, LeafMaterial, RadianceTransfer, Scene, Side, Sides, Translucency,
};
use mesophyll_viewer::{OrbitCamera, Picture};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::PathBuf;
use std::sync::Arc;

/// Work that takes so long that a frame announces it first. It is done after that frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Job {
    Check,
    Screenshot,
    /// Draws the state that was kept as A.
    Kept,
    /// Reads the live picture for the histogram and the false colours.
    Analyse,
}

/// The state behind the window.
pub struct ViewerUi {
    pub(crate) scene: Scene,
    editor: Box<dyn Editor>,
    title: String,
    adapter: AdapterInfo,
    /// All instances. The scene has fewer while a leaf is shown alone.
    instances: Vec<Instance>,
    /// The transfer of all instances. The scene has none while one leaf is shown alone.
    transfer: Option<RadianceTransfer>,
    /// The vertices' shares of the sun, which the scene also lacks while one leaf is shown alone.
    sun_shares: Option<Arc<Vec<u8>>>,
    /// The fitted gloss of the front and of the back, which the gloss factors scale.
    own_gloss: BTreeMap<usize, Sides<Option<Vec<[f32; 4]>>>>,
    /// Thickness and interiors as fitted, of the leaves that were edited. A reset restores them.
    own_interiors: BTreeMap<usize, (f32, Sides<Interior>)>,
    /// Translucency maps of the front and of the back, of leaves that are shown without them.
    laid_by: BTreeMap<usize, Sides<Option<Translucency>>>,
    own_sun: Option<[f32; 3]>,
    own_sky: Option<[f32; 3]>,
    sun_factor: f32,
    sky_factor: f32,
    /// Turbidity of the dome, as the slider shows it.
    turbidity: f32,
    sun_angles: (f32, f32),
    /// The parameters as fitted and the present ones, of the materials that are leaves.
    starts: BTreeMap<usize, LeafEdit>,
    edits: BTreeMap<usize, LeafEdit>,
    /// The material whose appearance is shown.
    leaf: usize,
    side: Side,
    alone: bool,
    views: Vec<WindowView>,
    orbit: OrbitCamera,
    radius: f32,
    thumbnails: appearance::Thumbnails,
    hover: Option<(PickHit, Vec<(String, String)>)>,
    check: Option<Check>,
    show_check: Option<CheckLayout>,
    check_size: [u32; 2],
    screenshots: PathBuf,
    times: VecDeque<f64>,
    continuous: bool,
    plants: plants::Plants,
    /// Whether the wind's time runs.
    playing: bool,
    history: history::History,
    /// The lights as the window opened.
    own_light: light::Light,
    kept: Option<comparison::Kept>,
    /// The share of the picture on the left of the line, where two are wiped.
    wipe: f32,
    analysis: analysis::Analysis,
    /// The pixel of the live picture under the pointer.
    pointer_pixel: Option<[u32; 2]>,
    /// The name that the next screenshot gets; empty for the scene's.
    shot_name: String,
    message: String,
    landmarks: BTreeMap<String, Rect>,
    pub(crate) job: Option<Job>,
    // Changes that the picture has not taken over yet.
    pub(crate) scene_changed: bool,
    pub(crate) lights_changed: bool,
    pub(crate) time_changed: bool,
    pub(crate) leaves_changed: BTreeSet<usize>,
    pub(crate) dirty: bool,
    /// Whether the environment map behind the scene is seen.
    pub(crate) backdrop_shown: bool,
    /// Size of the picture in pixels in the last layout.
    pub(crate) picture_size: [u32; 2],
    /// Whether the camera is being dragged. A slow adapter then draws fewer pixels until it rests.
    moving: bool,
    drawn_as_draft: bool,
}

/// Width over height.
fn aspect([width, height]: [u32; 2]) -> f32 {
    width.max(1) as f32 / height.max(1) as f32
}

impl ViewerUi {
    /// Makes the state of a window. `adapter` is shown beside the frame times.
    pub fn new(window: WindowScene, editor: Box<dyn Editor>, adapter: &AdapterInfo) -> ViewerUi {
        let WindowScene { title, scene, camera, views, check_size, screenshots } = window;
        let (_, radius) = mesophyll_viewer::ball_around(&scene);
        let leaves = || (0..scene.materials.len()).filter_map(|i| Some((i, scene.leaf(i)?)));
        let starts: BTreeMap<usize, LeafEdit> = leaves().map(|(i, _)| (i, editor.start(i))).collect();
        let gloss = |(i, leaf): (usize, &LeafMaterial)| (i, Sides::of(|side| leaf.sides[side].gloss.clone()));
        let mut ui = ViewerUi {
            plants: plants::Plants::new(editor.plants()),
            editor,
            title,
            adapter: adapter.clone(),
            instances: scene.instances.clone(),
            transfer: scene.transfer.clone(),
            sun_shares: scene.sun_shares.clone(),
            own_gloss: leaves().map(gloss).collect(),
            own_interiors: BTreeMap::new(),
            laid_by: BTreeMap::new(),
            own_sun: scene.sun.map(|s| s.irradiance),
            own_sky: scene.sky,
            sun_factor: 1.0,
            sky_factor: 1.0,
            turbidity: scene.dome.as_ref().map_or(0.0, |d| d.turbidity),
            sun_angles: scene.sun.map_or((0.0, 90.0), |s| light::angles(s.direction)),
            edits: starts.clone(),
            starts,
            leaf: scene.instances.iter().map(|i| i.material).find(|m| scene.leaf(*m).is_some()).unwrap_or_default(),
            side: Side::Front,
            alone: false,
            views,
            orbit: OrbitCamera::new(camera, radius),
            radius,
            thumbnails: Default::default(),
            hover: None,
            check: None,
            show_check: None,
            check_size,
            screenshots,
            times: VecDeque::new(),
            continuous: false,
            history: history::History::default(),
            own_light: light::Light::default(),
            kept: None,
            wipe: 0.5,
            analysis: analysis::Analysis::default(),
            pointer_pixel: None,
            shot_name: String::new(),
            message: String::new(),
            landmarks: BTreeMap::new(),
            job: None,
            scene_changed: true,
            lights_changed: false,
            time_changed: false,
            playing: false,
            leaves_changed: BTreeSet::new(),
            dirty: true,
            backdrop_shown: true,
            picture_size: [1, 1],
            moving: false,
            drawn_as_draft: false,
            scene,
        };
        ui.own_light = ui.light();
        ui.history = history::History::new(ui.snapshot());
        ui
    }

    /// The camera of the live picture, as a check would use it.
    pub fn camera(&self) -> Camera {
        self.orbit.camera
    }

    /// The camera of the live picture: that of a check, with a field of view that is wide enough to show everything in
    /// a check's picture in a window of this shape.
    pub fn live_camera(&self) -> Camera {
        let Camera { fov_y_deg, .. } = self.orbit.camera;
        let wider = (aspect(self.check_size) / aspect(self.picture_size)).max(1.0);
        let half = ((0.5 * fov_y_deg.to_radians()).tan() * wider).atan();
        Camera { fov_y_deg: 2.0 * half.to_degrees(), ..self.orbit.camera }
    }

    /// The scene in its present state, with edits.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The present parameters of leaf `leaf`. Panics if that material is no leaf.
    pub fn edit(&self, leaf: usize) -> LeafEdit {
        self.edits[&leaf]
    }

    /// The last message of the window: what was saved, or what failed.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// Whether the last check passed; `None` before the first one.
    pub fn passed(&self) -> Option<bool> {
        self.check.as_ref().map(|c| c.verdict.passed)
    }

    /// The area of a control in the last layout (points), for scripts that move the pointer there.
    pub fn landmark_rect(&self, name: &str) -> Option<Rect> {
        self.landmarks.get(name).copied()
    }

    /// What is under the pointer, and what the editor knows about it.
    pub fn under_pointer(&self) -> Option<&(PickHit, Vec<(String, String)>)> {
        self.hover.as_ref()
    }

    fn landmark(&mut self, name: &str, response: &Response) {
        self.landmarks.insert(name.to_string(), response.rect);
    }

    fn camera_changed(&mut self) {
        self.dirty = true;
        self.show_check = None;
        self.make_stale();
    }

    /// Requests a check of the present view. It is done with the next frame.
    pub fn request_check(&mut self) {
        self.message = "Computing the reference …".into();
        self.job = Some(Job::Check);
    }

    /// Requests a screenshot of the picture. It is written with the next frame.
    pub fn request_screenshot(&mut self) {
        self.job = Some(Job::Screenshot);
    }

    pub(crate) fn check_size(&self) -> [u32; 2] {
        self.check_size
    }

    /// Compares `picture` with the reference and takes over the verdict.
    pub(crate) fn finish_check(&mut self, context: &egui::Context, picture: &Picture) {
        let [width, height] = self.check_size;
        match self.editor.reference(&self.scene, &self.orbit.camera, width, height) {
            Ok(r) if (r.width, r.height, r.ldr.len()) == (width, height, picture.ldr.len()) => {
                let verdict = self.editor.judge(picture, &r);
                self.check = Some(Check::new(context, picture, &r, verdict));
                self.show_check = self.show_check.or(Some(CheckLayout::SideBySide));
                self.message.clear();
            }
            Ok(r) => self.message = format!("the reference is {}x{}, expected {width}x{height}", r.width, r.height),
            Err(reason) => self.message = reason,
        }
    }

    /// Writes `picture` to the first free name, and the message says where. The name is the one that was typed, or the
    /// scene's with a number.
    pub(crate) fn finish_screenshot(&mut self, picture: &Picture) {
        let plain = |text: &str| -> String {
            text.trim().chars().map(|c| if c.is_alphanumeric() || "-_ ".contains(c) { c } else { '-' }).collect()
        };
        let typed = self.shot_name.trim().trim_end_matches(".png");
        let named = |i: u32| match (typed.is_empty(), i) {
            (true, _) => format!("{}-{i}.png", plain(&self.title)),
            (false, 1) => format!("{}.png", plain(typed)),
            (false, _) => format!("{}-{i}.png", plain(typed)),
        };
        let path = (1..).map(|i| self.screenshots.join(named(i))).find(|p| !p.exists());
        let Some(path) = path else { return };
        self.message = match picture.save_png(&path) {
            Ok(()) => format!("screenshot: {}", path.display()),
            Err(error) => error.to_string(),
        };
    }

    pub(crate) fn say(&mut self, message: String) {
        self.message = message;
    }

    /// Size of the next live picture. It is half as wide and high while the camera moves on a software adapter.
    pub(crate) fn live_size(&self) -> [u32; 2] {
        if self.moving && self.adapter.is_software {
            self.picture_size.map(|s| s.div_ceil(2))
        } else {
            self.picture_size
        }
    }

    /// Records the time of a drawn picture (ms). Drafts do not count.
    pub(crate) fn drawn(&mut self, ms: f64) {
        self.dirty = false;
        self.analysis.fresh = false;
        self.drawn_as_draft = self.live_size() != self.picture_size;
        if self.drawn_as_draft {
            return;
        }
        self.times.push_back(ms);
        while self.times.len() > readout::FRAMES {
            self.times.pop_front();
        }
    }

    pub(crate) fn continuous(&self) -> bool {
        self.continuous || self.playing
    }
}
