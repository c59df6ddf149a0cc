//! A window without a display, which synthetic pointer events operate, and the editor behind it.

use crate::common::*;
use glam::{Mat4, Vec3};
use mesophyll_viewer::scene::{Camera, Instance, Interior, Material, Scene, Side, Sides, SkyDome};
use mesophyll_viewer::{Error, Options, Picture};
use mesophyll_window::edit::{Edit, EditGroup, EditQuantity, EditTarget, Edits};
use mesophyll_window::editor::{
    ComparisonVerdict, DisplayPicture, Editor, PlantInfo, PlantPart, SkyUpdate, VerdictMeasure,
};
use mesophyll_window::{ViewerUi, WindowScene, WindowStage, WindowView};
use std::cell::RefCell;
use std::rc::Rc;

pub const PIXELS: [u32; 2] = [1100, 600];

/// The requests of the window to its editor.
#[derive(Default)]
pub struct Asked {
    pub recomputed: Vec<(usize, Edits)>,
    pub saved: Vec<Edits>,
    pub skies: Vec<(Vec3, f32)>,
    /// Whether the leaves have no tissue.
    pub stated: bool,
    pub checked: usize,
    /// The plants that the window lists, and the scene in which their branches are edited.
    pub plants: Option<(Vec<PlantInfo>, Scene)>,
    pub bent: Vec<Edits>,
    pub saved_plants: Vec<usize>,
    /// The sun's direction at each request for shares of it.
    pub suns: Vec<Vec3>,
    /// The shares of all vertices, which are ready when the window asks.
    pub ready: Option<Vec<u8>>,
    /// The reason why there are none, which is returned once.
    pub no_shares: Option<String>,
}

pub struct Toy {
    pub asked: Rc<RefCell<Asked>>,
}

impl Editor for Toy {
    fn start(&self, leaf: usize) -> Edits {
        match self.asked.borrow().stated {
            true => Edits::default(),
            false => Edits::tissue(leaf, 0.2, Sides::of(|_| [[1.0, 0.5, 2.0], [10.0; 3]])),
        }
    }

    fn recompute(&mut self, leaf: usize, edits: &Edits) -> Result<Sides<Interior>, String> {
        let front = EditTarget::LeafSide(leaf, Side::Front);
        if edits.get(front, EditQuantity::SigmaS(0)).is_some_and(|v| v > 200.0) {
            return Err("σs above 200/mm is refused here".into());
        }
        self.asked.borrow_mut().recomputed.push((leaf, edits.clone()));
        // A larger thickness transmits less. Any rule will do whose effect the test can see in the picture.
        let at = edits.get(EditTarget::Leaf(leaf), EditQuantity::Thickness).unwrap_or(0.2) as f32;
        let dim = |c: [f32; 3]| c.map(|v| v * (-(at - 0.2) * 4.0).exp());
        Ok(Sides {
            front: Interior::Scalars(curve(at, dim(RHO_D), dim(RHO_T))),
            back: Interior::Scalars(curve(at, dim(BACK_D), dim(BACK_T))),
        })
    }

    fn sky(&mut self, sun: Vec3, turbidity: f32) -> Result<SkyUpdate, String> {
        if turbidity > 9.0 {
            return Err("turbidity above 9 is refused here".into());
        }
        self.asked.borrow_mut().skies.push((sun, turbidity));
        Ok(SkyUpdate { dome: even_dome(sun, turbidity), sun_irradiance: [turbidity; 3] })
    }

    fn shares(&mut self, sun: Vec3) -> Result<(Option<Vec<u8>>, bool), String> {
        let mut asked = self.asked.borrow_mut();
        asked.suns.push(sun);
        asked.no_shares.take().map_or(Ok(()), Err)?;
        Ok((asked.ready.take(), false))
    }

    fn plants(&self) -> Vec<PlantInfo> {
        self.asked.borrow().plants.as_ref().map_or_else(Vec::new, |p| p.0.clone())
    }

    /// A load moves the second leaf up. Any rule will do whose effect the test can see in the picture.
    fn bend(&mut self, edits: &Edits) -> Result<Scene, String> {
        let mut asked = self.asked.borrow_mut();
        asked.bent.push(edits.clone());
        let load: f64 = edits.iter().filter(|e| e.quantity == EditQuantity::Load).map(|e| e.value - 1.0).sum();
        if load > 8.0 {
            return Err("its tip goes too far".into());
        }
        let mut scene = asked.plants.as_ref().map(|p| p.1.clone()).ok_or("no plants")?;
        scene.instances[1].transform = Mat4::from_translation(Vec3::Z * load as f32) * scene.instances[1].transform;
        Ok(scene)
    }

    fn save_plant(&mut self, plant: usize) -> Result<String, String> {
        self.asked.borrow_mut().saved_plants.push(plant);
        Ok("plants/twig-edit-1.glb".into())
    }

    fn save(&mut self, _: usize, edits: &Edits) -> Result<String, String> {
        self.asked.borrow_mut().saved.push(edits.clone());
        Ok("fits/edited".into())
    }

    fn reference(&mut self, _: &Scene, _: &Camera, width: u32, height: u32) -> Result<DisplayPicture, String> {
        self.asked.borrow_mut().checked += 1;
        Ok(DisplayPicture { width, height, ldr: vec![[0; 4]; (width * height) as usize] })
    }

    fn judge(&mut self, picture: &Picture, reference: &DisplayPicture) -> ComparisonVerdict {
        let worst = picture.ldr.iter().zip(&reference.ldr).map(|(a, b)| a[1].abs_diff(b[1])).max().unwrap_or(0);
        let measure = VerdictMeasure {
            name: "largest error inside leaves".into(),
            value: f64::from(worst) / 255.0,
            threshold: 0.02,
        };
        ComparisonVerdict { passed: measure.value <= measure.threshold, measures: vec![measure], note: String::new() }
    }

    fn probe(&self, _: usize, side: Side, texel: [u32; 2]) -> Vec<(String, String)> {
        vec![("side".into(), side.to_string()), ("column".into(), texel[0].to_string())]
    }
}

pub struct Bench {
    pub stage: WindowStage,
    pub ui: ViewerUi,
    pub asked: Rc<RefCell<Asked>>,
    pub time: f64,
}

/// Two bent leaves side by side, and the editor that records what their window requests.
pub fn two_leaves() -> (WindowScene, Toy) {
    let mut leaf = uniform_leaf();
    leaf.sides.front.gloss = Some(vec![[0.05, 0.05, 0.05, 0.3]; 64]);
    let mut scene = on_mesh(bent(10.0, 12, -0.02), leaf.clone());
    leaf.name = "other".into();
    scene.materials.push(Material::Leaf(leaf));
    scene.instances.push(Instance {
        mesh: 0,
        material: 1,
        transform: Mat4::from_translation(Vec3::new(24.0, 0.0, 0.0)),
        ..Instance::default()
    });
    scene.sun = Some(sun(Vec3::new(-0.4, 0.3, 1.0)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    scene.background = [0.02; 3];
    scene.shadow_samples = 2;
    let camera = Camera { fov_y_deg: 50.0, ..camera(Vec3::new(0.3, -0.5, 1.0), 80.0) };
    let window = WindowScene {
        title: "bench".into(),
        scene,
        camera,
        views: vec![WindowView { name: "front".into(), camera, time_s: None }],
        check_size: [64, 48],
        screenshots: std::env::temp_dir(),
    };
    (window, Toy { asked: Default::default() })
}

/// A sky that becomes brighter with the turbidity. Any rule will do whose effect the test can see in the picture.
pub fn even_dome(sun: Vec3, turbidity: f32) -> SkyDome {
    let l = 0.1 * turbidity;
    SkyDome {
        harmonics: vec![[l * (4.0 * std::f32::consts::PI).sqrt(); 3]],
        picture: None,
        perez: [[0.0; 5]; 3],
        scale: [l, 3.0 * l, l],
        ground: None,
        sun,
        strength: 1.0,
        turbidity,
    }
}

pub fn bench() -> Option<Bench> {
    bench_on(two_leaves())
}

pub fn bench_on((window, toy): (WindowScene, Toy)) -> Option<Bench> {
    let stage = match WindowStage::headless(&Options::default()) {
        Ok(stage) => stage,
        Err(Error::NoAdapter) => {
            skips::skip(skips::Need::Adapter, "no graphics adapter");
            return None;
        }
        Err(other) => panic!("{other}"),
    };
    let asked = toy.asked.clone();
    let ui = ViewerUi::new(window, Box::new(toy), stage.renderer().adapter());
    let mut bench = Bench { stage, ui, asked, time: 0.0 };
    // Two frames, because egui settles its layout in the first.
    bench.frame(vec![]);
    bench.frame(vec![]);
    Some(bench)
}

/// Edit of the thickness of a leaf.
pub fn thick(leaf: usize, value: f64) -> Edit {
    Edit { target: EditTarget::Leaf(leaf), quantity: EditQuantity::Thickness, value }
}

/// Edit of the front of leaf 0.
pub fn on_front(quantity: EditQuantity, value: f64) -> Edit {
    Edit { target: EditTarget::LeafSide(0, Side::Front), quantity, value }
}

/// Factor on the load of a part of the first plant.
pub fn load(part: PlantPart, value: f64) -> Edit {
    Edit { target: EditTarget::Plant(0, part), quantity: EditQuantity::Load, value }
}

impl Bench {
    /// The present edits of leaf 0.
    pub fn leaf(&self) -> Edits {
        self.ui.edits().of(EditGroup::Leaf(0))
    }

    /// The present edits of branches.
    pub fn branches(&self) -> Edits {
        self.ui.edits().of(EditGroup::Plants)
    }

    /// The present thickness of leaf 0 (mm).
    pub fn thickness(&self) -> f64 {
        self.ui.value(EditTarget::Leaf(0), EditQuantity::Thickness).expect("a thickness")
    }

    pub fn frame(&mut self, events: Vec<egui::Event>) {
        self.frame_of(PIXELS, events);
    }

    /// A frame in a window of another size.
    pub fn frame_of(&mut self, pixels: [u32; 2], events: Vec<egui::Event>) {
        self.time += 0.05;
        let size = egui::vec2(pixels[0] as f32, pixels[1] as f32);
        let input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, size)),
            time: Some(self.time),
            focused: true,
            events,
            ..Default::default()
        };
        self.stage.frame(&mut self.ui, input, pixels).expect("frame");
    }

    pub fn pixels(&self) -> Vec<[u8; 4]> {
        self.stage.pixels().expect("pixels").2
    }

    pub fn place(&self, name: &str) -> egui::Pos2 {
        self.ui.landmark_rect(name).unwrap_or_else(|| panic!("no control named {name}")).center()
    }

    pub fn button(pos: egui::Pos2, pressed: bool) -> egui::Event {
        egui::Event::PointerButton { pos, button: egui::PointerButton::Primary, pressed, modifiers: Default::default() }
    }

    pub fn drag(&mut self, from: egui::Pos2, by: egui::Vec2) {
        self.frame(vec![egui::Event::PointerMoved(from)]);
        self.frame(vec![Self::button(from, true)]);
        self.frame(vec![egui::Event::PointerMoved(from + by)]);
        self.frame(vec![Self::button(from + by, false)]);
        self.frame(vec![]);
    }

    pub fn click(&mut self, name: &str) {
        let at = self.place(name);
        self.frame(vec![egui::Event::PointerMoved(at)]);
        self.frame(vec![Self::button(at, true)]);
        self.frame(vec![Self::button(at, false)]);
        self.frame(vec![]);
    }

    /// Mean green value within the picture.
    pub fn brightness(&self) -> f64 {
        let rect = self.ui.landmark_rect("picture").expect("picture");
        let all = self.pixels();
        let mut sum = 0.0;
        for y in rect.top() as usize..rect.bottom() as usize {
            for x in rect.left() as usize..rect.right() as usize {
                sum += f64::from(all[y * PIXELS[0] as usize + x][1]);
            }
        }
        sum / f64::from(rect.area())
    }
}
