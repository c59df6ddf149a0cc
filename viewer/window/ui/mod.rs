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
mod versions;
mod wind;

pub use check::CheckLayout;
pub use scene::{WindowScene, WindowView};
pub(crate) use versions::Change;

use crate::edit::{Edit, Edits};
use crate::editor::{Editor, PlantInfo, PlantPart};
use check::Check;
use egui::{Rect, Response};
use glam::Vec3;
use mesophyll_viewer::gpu::AdapterInfo;
use mesophyll_viewer::picking::PickHit;
use mesophyll_viewer::scene::{
    Camera, Instance, Interior, LeafMaterial, RadianceTransfer, Scene, Side, Sides, Translucency,
};
use mesophyll_viewer::{OrbitCamera, Picture};
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::sync::Arc;
use versions::Versions;

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

/// A picture of the scene: its version, its size in pixels, and whether the backdrop is seen.
pub(crate) type DrawnPicture = (u64, [u32; 2], bool);

/// What the window opened with. Nobody changes it; only a leaf's own maps are put here when it is edited first.
struct Opened {
    /// Without its scene.
    window: WindowScene,
    adapter: AdapterInfo,
    radius: f32,
    /// The values that are no factors.
    starts: Edits,
    plants: Vec<Rc<PlantInfo>>,
    /// The transfer of all instances. The scene has none while one leaf is shown alone.
    transfer: Option<RadianceTransfer>,
    /// The fitted gloss of the front and of the back, which the gloss factors scale.
    gloss: BTreeMap<usize, Sides<Option<Vec<[f32; 4]>>>>,
    /// Thickness and interiors as fitted, of the leaves that were edited. A reset restores them.
    interiors: BTreeMap<usize, (f32, Sides<Interior>)>,
    sun_direction: Option<Vec3>,
    sky: Option<[f32; 3]>,
}

/// How the scene is looked at, and what the panels show. None of it is an edit.
pub(crate) struct View {
    /// The material whose appearance is shown.
    leaf: usize,
    side: Side,
    alone: bool,
    /// The plant, and the part of it, whose factors are shown.
    part: (usize, PlantPart),
    branch_name: String,
    /// An edit that a drag prepares, before the scene takes it over.
    pending: Option<Edit>,
    orbit: OrbitCamera,
    /// Whether the camera is being dragged. A slow adapter then draws fewer pixels until it rests.
    moving: bool,
    /// Whether the wind's time runs.
    playing: bool,
    continuous: bool,
    show_check: Option<CheckLayout>,
    /// The share of the picture on the left of the line, where two are wiped.
    wipe: f32,
    /// The pixel of the live picture under the pointer.
    pointer_pixel: Option<[u32; 2]>,
    /// The name that the next screenshot gets; empty for the scene's.
    shot_name: String,
    /// Whether the environment map behind the scene is seen.
    pub backdrop_shown: bool,
    /// Size of the picture in pixels in the last layout.
    pub picture_size: [u32; 2],
}

/// What follows from the edits and from the view. Each part keeps the version that it was made of.
#[derive(Default)]
pub(crate) struct Made {
    pub versions: Versions,
    /// The scene with the edits.
    pub scene: Scene,
    /// The version of the scene that the renderer has.
    pub uploaded: Option<u64>,
    /// The picture on the screen; `None` where another one was drawn since.
    pub drawn: Option<DrawnPicture>,
    /// All instances. The scene has fewer while a leaf is shown alone.
    instances: Vec<Instance>,
    /// The vertices' shares of the sun, which the scene also lacks while one leaf is shown alone.
    sun_shares: Option<Arc<Vec<u8>>>,
    /// The sun without the factor on it.
    sun_irradiance: Option<[f32; 3]>,
    /// Translucency maps of the front and of the back, of leaves that are shown without them.
    laid_by: BTreeMap<usize, Sides<Option<Translucency>>>,
    thumbnails: appearance::Thumbnails,
    hover: Option<(PickHit, Vec<(String, String)>)>,
    check: Option<Check>,
    analysis: analysis::Analysis,
    times: VecDeque<f64>,
}

/// The state behind the window: the edits, how they are looked at, and what follows.
pub struct ViewerUi {
    editor: Box<dyn Editor>,
    opened: Opened,
    edits: Edits,
    history: history::History,
    kept: Option<comparison::Kept>,
    pub(crate) view: View,
    pub(crate) made: Made,
    message: String,
    landmarks: BTreeMap<String, Rect>,
    pub(crate) job: Option<Job>,
}

/// Width over height.
fn aspect([width, height]: [u32; 2]) -> f32 {
    width.max(1) as f32 / height.max(1) as f32
}

impl ViewerUi {
    /// Makes the state of a window. `adapter` is shown beside the frame times.
    pub fn new(mut window: WindowScene, editor: Box<dyn Editor>, adapter: &AdapterInfo) -> ViewerUi {
        let (scene, camera) = (std::mem::take(&mut window.scene), window.camera);
        let (_, radius) = mesophyll_viewer::ball_around(&scene);
        let leaves = || (0..scene.materials.len()).filter_map(|i| Some((i, scene.leaf(i)?)));
        let lights = light::starts(&scene);
        let starts = leaves().flat_map(|(i, _)| editor.start(i).iter().collect::<Vec<_>>()).chain(lights).collect();
        let gloss = |(i, leaf): (usize, &LeafMaterial)| (i, Sides::of(|side| leaf.sides[side].gloss.clone()));
        let opened = Opened {
            window,
            adapter: adapter.clone(),
            radius,
            starts,
            plants: editor.plants().into_iter().map(Rc::new).collect(),
            transfer: scene.transfer.clone(),
            gloss: leaves().map(gloss).collect(),
            interiors: BTreeMap::new(),
            sun_direction: scene.sun.map(|s| s.direction),
            sky: scene.sky,
        };
        let view = View {
            leaf: scene.instances.iter().map(|i| i.material).find(|m| scene.leaf(*m).is_some()).unwrap_or_default(),
            side: Side::Front,
            alone: false,
            part: (0, PlantPart::Level(0)),
            branch_name: String::new(),
            pending: None,
            orbit: OrbitCamera::new(camera, radius),
            moving: false,
            playing: false,
            continuous: false,
            show_check: None,
            wipe: 0.5,
            pointer_pixel: None,
            shot_name: String::new(),
            backdrop_shown: true,
            picture_size: [1, 1],
        };
        let made = Made {
            instances: scene.instances.clone(),
            sun_shares: scene.sun_shares.clone(),
            sun_irradiance: scene.sun.map(|s| s.irradiance),
            scene,
            ..Made::default()
        };
        let (edits, history, landmarks) = Default::default();
        ViewerUi {
            editor,
            opened,
            edits,
            history,
            kept: None,
            view,
            made,
            message: String::new(),
            landmarks,
            job: None,
        }
    }

    /// The camera of the live picture, as a check would use it.
    pub fn camera(&self) -> Camera {
        self.view.orbit.camera
    }

    /// The camera of the live picture: that of a check, with a field of view that is wide enough to show everything in
    /// a check's picture in a window of this shape.
    pub fn live_camera(&self) -> Camera {
        let wider = (aspect(self.opened.window.check_size) / aspect(self.view.picture_size)).max(1.0);
        let camera = self.view.orbit.camera;
        Camera { fov_y_deg: 2.0 * (camera.half_height() * wider).atan().to_degrees(), ..camera }
    }

    /// The scene in its present state, with edits.
    pub fn scene(&self) -> &Scene {
        &self.made.scene
    }

    /// The last message of the window: what was saved, or what failed.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// Whether the last check passed; `None` before the first one.
    pub fn passed(&self) -> Option<bool> {
        self.made.check.as_ref().map(|c| c.verdict.passed)
    }

    /// The area of a control in the last layout (points), for scripts that move the pointer there.
    pub fn landmark_rect(&self, name: &str) -> Option<Rect> {
        self.landmarks.get(name).copied()
    }

    /// What is under the pointer, and what the editor knows about it.
    pub fn under_pointer(&self) -> Option<&(PickHit, Vec<(String, String)>)> {
        self.made.hover.as_ref()
    }

    fn landmark(&mut self, name: &str, response: &Response) {
        self.landmarks.insert(name.to_string(), response.rect);
    }

    fn camera_changed(&mut self) {
        self.view.show_check = None;
        self.made.versions.change(Change::View);
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
        self.opened.window.check_size
    }

    /// Compares `picture` with the reference and takes over the verdict.
    pub(crate) fn finish_check(&mut self, context: &egui::Context, picture: &Picture) {
        let [width, height] = self.opened.window.check_size;
        match self.editor.reference(&self.made.scene, &self.view.orbit.camera, width, height) {
            Ok(r) if (r.width, r.height, r.ldr.len()) == (width, height, picture.ldr.len()) => {
                let verdict = self.editor.judge(picture, &r);
                self.made.check = Some(Check::new(context, picture, &r, verdict, self.made.versions.now));
                self.view.show_check = self.view.show_check.or(Some(CheckLayout::SideBySide));
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
        let typed = self.view.shot_name.trim().trim_end_matches(".png");
        let named = |i: u32| match (typed.is_empty(), i) {
            (true, _) => format!("{}-{i}.png", plain(&self.opened.window.title)),
            (false, 1) => format!("{}.png", plain(typed)),
            (false, _) => format!("{}-{i}.png", plain(typed)),
        };
        let path = (1..).map(|i| self.opened.window.screenshots.join(named(i))).find(|p| !p.exists());
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
        if self.view.moving && self.opened.adapter.is_software {
            self.view.picture_size.map(|s| s.div_ceil(2))
        } else {
            self.view.picture_size
        }
    }

    /// The live picture as it should be.
    fn picture(&self) -> DrawnPicture {
        (self.made.versions.now, self.live_size(), self.view.backdrop_shown)
    }

    /// Whether the picture on the screen is as it should be.
    pub(crate) fn is_drawn(&self) -> bool {
        self.made.drawn == Some(self.picture())
    }

    /// Records the time of a drawn picture (ms). Drafts do not count.
    pub(crate) fn drawn(&mut self, ms: f64) {
        self.made.drawn = Some(self.picture());
        if self.live_size() != self.view.picture_size {
            return;
        }
        self.made.times.push_back(ms);
        while self.made.times.len() > readout::FRAMES {
            self.made.times.pop_front();
        }
    }

    pub(crate) fn continuous(&self) -> bool {
        self.view.continuous || self.view.playing
    }
}
