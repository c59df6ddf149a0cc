//! The whole user interface, drawn without a display and moved by synthetic pointer events.

#[path = "../../tests/common/mod.rs"]
mod common;

use common::*;
use glam::{Mat4, Vec3};
use mesophyll_viewer::pick::pick;
use mesophyll_viewer::scene::{
    Basis, Camera, Coefficients, Dome, Instance, Interior, Material, Scene, Side, Sides, Translucency,
};
use mesophyll_viewer::{Error, Options, Picture};
use mesophyll_window::editor::{Editor, LeafEdit, LeafUpdate, Measure, ReferencePicture, SideEdit, SkyUpdate, Verdict};
use mesophyll_window::{Stage, ViewerUi, WindowOptions, WindowScene, WindowView, open_window};
use std::cell::RefCell;
use std::rc::Rc;

const PIXELS: [u32; 2] = [1100, 720];

/// What the window asked of its editor.
#[derive(Default)]
struct Asked {
    recomputed: Vec<(usize, LeafEdit)>,
    saved: Vec<LeafEdit>,
    skies: Vec<(Vec3, f32)>,
    checked: usize,
    /// Where the sun stood, each time that the window asked for shares of it.
    suns: Vec<Vec3>,
    /// What every vertex sees of the sun, as soon as the window asks.
    ready: Option<Vec<u8>>,
    /// Why it cannot be known, said once.
    no_shares: Option<String>,
}

struct Toy {
    asked: Rc<RefCell<Asked>>,
}

impl Editor for Toy {
    fn start(&self, _: usize) -> LeafEdit {
        let side = SideEdit { sigma_a: [1.0, 0.5, 2.0], sigma_s: [10.0; 3], rho_s_scale: 1.0, m_scale: 1.0 };
        LeafEdit { thickness_mm: 0.2, sides: Sides::of(|_| side) }
    }

    fn recompute(&mut self, leaf: usize, edit: &LeafEdit) -> Result<LeafUpdate, String> {
        if edit.sides.front.sigma_s[0] > 200.0 {
            return Err("σs above 200/mm is refused here".into());
        }
        self.asked.borrow_mut().recomputed.push((leaf, *edit));
        // Thicker and darker pigment: less comes through. Any rule will do that the test can see in the picture.
        let dim = |c: [f32; 3]| c.map(|v| v * (-(edit.thickness_mm - 0.2) * 4.0).exp());
        let at = edit.thickness_mm;
        Ok(LeafUpdate {
            thickness_mm: at,
            sides: Sides {
                front: Interior::Scalars(curve(at, dim(RHO_D), dim(RHO_T))),
                back: Interior::Scalars(curve(at, dim(BACK_D), dim(BACK_T))),
            },
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

    fn save(&mut self, _: usize, edit: &LeafEdit) -> Result<String, String> {
        self.asked.borrow_mut().saved.push(*edit);
        Ok("fits/edited".into())
    }

    fn reference(&mut self, _: &Scene, _: &Camera, width: u32, height: u32) -> Result<ReferencePicture, String> {
        self.asked.borrow_mut().checked += 1;
        Ok(ReferencePicture { width, height, ldr: vec![[0; 4]; (width * height) as usize] })
    }

    fn judge(&mut self, picture: &Picture, reference: &ReferencePicture) -> Verdict {
        let worst = picture.ldr.iter().zip(&reference.ldr).map(|(a, b)| a[1].abs_diff(b[1])).max().unwrap_or(0);
        let measure =
            Measure { name: "largest error inside leaves".into(), value: f64::from(worst) / 255.0, threshold: 0.02 };
        Verdict { passed: measure.value <= measure.threshold, measures: vec![measure], note: String::new() }
    }

    fn probe(&self, _: usize, side: Side, texel: [u32; 2]) -> Vec<(String, String)> {
        vec![("side".into(), side.to_string()), ("column".into(), texel[0].to_string())]
    }
}

struct Bench {
    stage: Stage,
    ui: ViewerUi,
    asked: Rc<RefCell<Asked>>,
    time: f64,
}

/// Two bent leaves side by side, and what their window asks for.
fn two_leaves() -> (WindowScene, Toy) {
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

/// A sky that is the brighter the hazier it is: any rule will do that the test can see in the picture.
fn even_dome(sun: Vec3, turbidity: f32) -> Dome {
    let l = 0.1 * turbidity;
    Dome {
        harmonics: vec![[l * (4.0 * std::f32::consts::PI).sqrt(); 3]],
        perez: [[0.0; 5]; 3],
        scale: [l, 3.0 * l, l],
        ground: None,
        sun,
        strength: 1.0,
        turbidity,
    }
}

#[test]
fn sun_and_turbidity_ask_for_another_sky() {
    let stage = match Stage::headless(&Options::default()) {
        Ok(stage) => stage,
        Err(Error::NoAdapter) => return skips::skip(skips::Need::Adapter, "no graphics adapter"),
        Err(other) => panic!("{other}"),
    };
    let (mut window, toy) = two_leaves();
    let asked = toy.asked.clone();
    window.scene.sky = None;
    window.scene.dome = Some(even_dome(Vec3::new(-0.4, 0.3, 1.0).normalize(), 3.0));
    let ui = ViewerUi::new(window, Box::new(toy), stage.renderer().adapter());
    let mut bench = Bench { stage, ui, asked, time: 0.0 };
    bench.frame(vec![]);
    bench.frame(vec![]);
    assert!(bench.asked.borrow().skies.is_empty(), "a sky was asked for before anything was touched");
    let before = bench.brightness();
    let rect = bench.ui.landmark_rect("turbidity").expect("no turbidity slider");
    // The rail is the left part of the control; its left end is the lowest turbidity.
    let at = |share: f32| egui::pos2(rect.left() + 5.0 + share * 100.0, rect.center().y);
    bench.drag(at(0.2), egui::vec2(40.0, 0.0));
    let (sun, turbidity) = *bench.asked.borrow().skies.last().expect("no sky was asked for");
    assert!(turbidity > 4.0 && (sun.length() - 1.0).abs() < 1e-5, "{sun} {turbidity}");
    let dome = bench.ui.scene().dome.clone().expect("dome");
    assert_eq!(dome.turbidity, turbidity);
    assert!((bench.ui.scene().sun.unwrap().irradiance[0] - turbidity).abs() < 1e-5);
    assert!(bench.brightness() > before + 1.0, "{} {before}", bench.brightness());
    // Another sun, the same air.
    let azimuth = bench.place("azimuth");
    bench.drag(azimuth - egui::vec2(60.0, 0.0), egui::vec2(30.0, 0.0));
    let (turned, same) = *bench.asked.borrow().skies.last().unwrap();
    assert!(turned != sun && same == turbidity);
    assert_eq!(bench.ui.scene().dome.as_ref().unwrap().sun, turned);
    // What is refused leaves the sky as it was, and says why.
    bench.drag(at(0.5), egui::vec2(60.0, 0.0));
    assert!(bench.ui.message().contains("refused") && bench.ui.scene().dome.as_ref().unwrap().turbidity <= 9.0);
}

/// Where vertices know their share of the sun, the window asks for the shares of a sun that was moved, draws the old ones
/// until the new ones are there, and then those.
#[test]
fn a_moved_sun_gets_new_shares() {
    let (mut window, toy) = two_leaves();
    let vertices = window.scene.meshes[0].positions.len();
    for (k, instance) in window.scene.instances.iter_mut().enumerate() {
        instance.first_share = Some((k * vertices) as u32);
    }
    window.scene.sun_shares = Some(std::sync::Arc::new(vec![255; 2 * vertices]));
    // Nothing else shines, in the picture or on the leaves.
    (window.scene.shadow_samples, window.scene.sky, window.scene.background) = (0, None, [0.0; 3]);
    let Some(mut bench) = bench_on((window, toy)) else { return };
    let first = bench.ui.scene().sun.unwrap().direction;
    assert!(bench.asked.borrow().suns.iter().all(|s| *s == first));
    let lit = bench.brightness();
    let azimuth = bench.place("azimuth");
    bench.drag(azimuth - egui::vec2(60.0, 0.0), egui::vec2(2.0, 0.0));
    let moved = bench.ui.scene().sun.unwrap().direction;
    assert!(moved != first && *bench.asked.borrow().suns.last().unwrap() == moved);
    assert!(bench.ui.scene().sun_shares.as_ref().unwrap().iter().all(|s| *s == 255), "the old shares are gone");
    // A map of another number of vertices is of another scene.
    bench.asked.borrow_mut().ready = Some(vec![0; 7]);
    bench.frame(vec![]);
    assert_eq!(bench.ui.scene().sun_shares.as_ref().unwrap().len(), 2 * vertices);
    bench.asked.borrow_mut().ready = Some(vec![0; 2 * vertices]);
    bench.frame(vec![]);
    assert!(bench.ui.scene().sun_shares.as_ref().unwrap().iter().all(|s| *s == 0));
    assert!(bench.brightness() < 0.5 * lit, "{} {lit}", bench.brightness());
    // What cannot be known is said, and the shares stay.
    bench.asked.borrow_mut().no_shares = Some("no shadows".into());
    bench.frame(vec![]);
    assert_eq!(bench.ui.message(), "no shadows");
    assert!(bench.ui.scene().sun_shares.as_ref().unwrap().iter().all(|s| *s == 0));
}

fn bench() -> Option<Bench> {
    bench_on(two_leaves())
}

fn bench_on((window, toy): (WindowScene, Toy)) -> Option<Bench> {
    let stage = match Stage::headless(&Options::default()) {
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
    // Twice: egui settles its layout in the first.
    bench.frame(vec![]);
    bench.frame(vec![]);
    Some(bench)
}

impl Bench {
    fn frame(&mut self, events: Vec<egui::Event>) {
        self.time += 0.05;
        let size = egui::vec2(PIXELS[0] as f32, PIXELS[1] as f32);
        let input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, size)),
            time: Some(self.time),
            focused: true,
            events,
            ..Default::default()
        };
        self.stage.frame(&mut self.ui, input, PIXELS).expect("frame");
    }

    fn pixels(&self) -> Vec<[u8; 4]> {
        self.stage.pixels().expect("pixels").2
    }

    fn place(&self, name: &str) -> egui::Pos2 {
        self.ui.landmark_rect(name).unwrap_or_else(|| panic!("no control named {name}")).center()
    }

    fn button(pos: egui::Pos2, pressed: bool) -> egui::Event {
        egui::Event::PointerButton { pos, button: egui::PointerButton::Primary, pressed, modifiers: Default::default() }
    }

    fn drag(&mut self, from: egui::Pos2, by: egui::Vec2) {
        self.frame(vec![egui::Event::PointerMoved(from)]);
        self.frame(vec![Self::button(from, true)]);
        self.frame(vec![egui::Event::PointerMoved(from + by)]);
        self.frame(vec![Self::button(from + by, false)]);
        self.frame(vec![]);
    }

    fn click(&mut self, name: &str) {
        let at = self.place(name);
        self.frame(vec![egui::Event::PointerMoved(at)]);
        self.frame(vec![Self::button(at, true)]);
        self.frame(vec![Self::button(at, false)]);
        self.frame(vec![]);
    }

    /// Mean green value within the picture.
    fn brightness(&self) -> f64 {
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

#[test]
fn everything_is_drawn_without_a_display() {
    let Some(bench) = bench() else { return };
    let pixels = bench.pixels();
    let colours: std::collections::HashSet<[u8; 4]> = pixels.iter().copied().collect();
    assert!(colours.len() > 200, "{} colours", colours.len());
    // Each of the three columns holds something.
    for (from, to) in [(0, 280), (300, 800), (830, 1090)] {
        let part: std::collections::HashSet<[u8; 4]> =
            pixels.chunks(PIXELS[0] as usize).flat_map(|row| row[from..to].iter().copied()).collect();
        assert!(part.len() > 20, "columns {from} to {to}: {} colours", part.len());
    }
    if let Ok(folder) = std::env::var("MESOPHYLL_PICTURES") {
        bench.stage.save_png(&std::path::Path::new(&folder).join("window.png")).expect("png");
    }
}

#[test]
fn a_thicker_leaf_goes_through_the_editor_and_dims() {
    let Some(mut bench) = bench() else { return };
    let before = bench.brightness();
    let fitted = bench.ui.scene().leaf(0).expect("a leaf").sides.front.interior.clone();
    let slider = bench.ui.landmark_rect("thickness").expect("slider");
    // The rail takes the slider's left part.
    let handle = egui::pos2(slider.left() + 55.0, slider.center().y);
    bench.drag(handle, egui::vec2(35.0, 0.0));
    let edit = bench.ui.edit(0);
    assert!(edit.thickness_mm > 0.21, "h {}", edit.thickness_mm);
    assert_eq!(bench.asked.borrow().recomputed.last(), Some(&(0, edit)), "the editor hears of the edit as it stands");
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").thickness_mm, edit.thickness_mm);
    assert!(bench.brightness() < before - 0.2, "{} against {before}", bench.brightness());
    bench.click("save");
    assert_eq!(bench.asked.borrow().saved, [edit]);
    assert!(bench.ui.message().contains("fits/edited"));
    bench.click("reset");
    assert_eq!(bench.ui.edit(0).thickness_mm, 0.2);
    let (Interior::Scalars(a), Interior::Scalars(b)) =
        (&fitted, &bench.ui.scene().leaf(0).expect("a leaf").sides.front.interior)
    else {
        panic!()
    };
    assert!(a == b && bench.brightness() == before, "as fitted, bit for bit");
}

#[test]
fn gloss_factors_scale_the_fitted_maps() {
    let Some(mut bench) = bench() else { return };
    let mut edit = bench.ui.edit(0);
    edit.sides.front.rho_s_scale = 2.0;
    edit.sides.front.m_scale = 0.5;
    bench.ui.set_edit(0, edit);
    bench.ui.set_edit(0, edit);
    let gloss = bench.ui.scene().leaf(0).expect("a leaf").sides.front.gloss.clone().expect("gloss");
    assert!((gloss[0][0] - 0.1).abs() < 1e-6 && (gloss[0][3] - 0.15).abs() < 1e-6, "applied once: {:?}", gloss[0]);
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").sides.back.gloss, None);
}

#[test]
fn translucency_maps_are_taken_off_and_put_back() {
    let (mut window, toy) = two_leaves();
    window.scene.sun = Some(sun(Vec3::new(-0.4, 0.3, -1.0)));
    // A tenth of a flat leaf's light: what shows must be seen to change.
    let coefficients = Coefficients::Factor(vec![[0.0836; 3]; 64]);
    let maps = Translucency { basis: Basis::Bent, coefficients };
    leaf(&mut window.scene, 0).sides.back.translucency = Some(maps.clone());
    let Some(mut bench) = bench_on((window, toy)) else { return };
    let (dim, dimmed) = (bench.brightness(), bench.pixels());
    bench.click("translucency");
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").sides.back.translucency, None);
    // How much of the picture the leaf takes depends on the window: what changed is what is judged.
    let brighter =
        dimmed.iter().zip(bench.pixels()).map(|(a, b)| f64::from(b[1]) - f64::from(a[1])).filter(|d| *d > 2.0);
    let (count, sum) = brighter.fold((0, 0.0), |(n, s), d| (n + 1, s + d));
    assert!(count > 300 && sum > 10.0 * f64::from(count), "{count} pixels brighter by {sum}");
    if let Ok(folder) = std::env::var("MESOPHYLL_PICTURES") {
        bench.stage.save_png(&std::path::Path::new(&folder).join("without-maps.png")).expect("png");
    }
    // Taken off twice is put back once; an edit in between leaves them alone.
    bench.ui.show_translucency(0, false);
    let edit = bench.ui.edit(0);
    bench.ui.set_edit(0, edit);
    bench.frame(vec![]);
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").sides.back.translucency, None);
    bench.ui.reset(0);
    bench.click("translucency");
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").sides.back.translucency, Some(maps));
    assert_eq!(bench.brightness(), dim, "as it was");
    // A window whose leaves have none has no such control; and nothing to put back.
    let Some(mut plain) = bench_on(two_leaves()) else { return };
    assert_eq!(plain.ui.landmark_rect("translucency"), None);
    plain.ui.show_translucency(0, true);
    plain.ui.show_translucency(0, false);
    plain.frame(vec![]);
    assert_eq!(plain.ui.landmark_rect("translucency"), None);
}

#[test]
fn a_refused_edit_is_said_and_undone() {
    let Some(mut bench) = bench() else { return };
    let mut edit = bench.ui.edit(0);
    edit.sides.front.sigma_s[0] = 250.0;
    bench.ui.set_edit(0, edit);
    assert!(bench.ui.message().contains("refused here"));
    assert_eq!(bench.ui.edit(0).sides.front.sigma_s[0], 10.0);
}

#[test]
fn the_sun_moves_and_shadows_follow() {
    let Some(mut bench) = bench() else { return };
    let (before, shadows) =
        (bench.ui.scene().sun.expect("sun").direction, bench.stage.renderer().stats().shadow_renders);
    let slider = bench.ui.landmark_rect("elevation").expect("slider");
    bench.drag(egui::pos2(slider.left() + 80.0, slider.center().y), egui::vec2(-20.0, 0.0));
    let after = bench.ui.scene().sun.expect("sun").direction;
    assert!(after.z < before.z && (after.length() - 1.0).abs() < 1e-5, "{before} to {after}");
    assert!(bench.stage.renderer().stats().shadow_renders > shadows);
}

#[test]
fn dragging_turns_and_the_wheel_zooms_but_a_still_picture_is_not_redrawn() {
    let Some(mut bench) = bench() else { return };
    let middle = bench.place("picture");
    let eye = bench.ui.camera().eye;
    bench.drag(middle, egui::vec2(60.0, 20.0));
    let turned = bench.ui.camera().eye;
    assert!(turned.distance(eye) > 5.0 && (turned.length() - eye.length()).abs() < 1e-2);
    bench.frame(vec![egui::Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: egui::vec2(0.0, 120.0),
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Unknown,
        modifiers: Default::default(),
    }]);
    for _ in 0..20 {
        bench.frame(vec![]);
    }
    assert!(bench.ui.camera().eye.length() < 0.95 * turned.length());
    let draws = bench.stage.renderer().stats().draws;
    bench.frame(vec![egui::Event::PointerMoved(middle + egui::vec2(3.0, 3.0))]);
    assert_eq!(bench.stage.renderer().stats().draws, draws);
}

#[test]
fn the_pointer_reads_texels_and_a_click_chooses_the_leaf() {
    let Some(mut bench) = bench() else { return };
    let rect = bench.ui.landmark_rect("picture").expect("picture");
    let camera = bench.ui.live_camera();
    // Where a point of the second leaf falls in the picture.
    let view = glam::camera::rh::view::look_at_mat4(camera.eye, camera.target, camera.up);
    let p = view.transform_point3(Vec3::new(18.0, 3.0, -0.02 * 36.0));
    let t = (camera.fov_y_deg.to_radians() / 2.0).tan();
    let at = rect.center() + egui::vec2(p.x / -p.z / t, -p.y / -p.z / t) * 0.5 * rect.height();
    assert!(rect.contains(at), "{at:?} in {rect:?}");
    bench.frame(vec![egui::Event::PointerMoved(at)]);
    bench.frame(vec![]);
    let (hit, rows) = bench.ui.under_pointer().expect("a leaf").clone();
    // x = −6 of ±10 mm, y = 3: column 1 of 8, row 2.
    assert_eq!((hit.material, hit.side, hit.texel), (1, Side::Front, [1, 2]));
    assert_eq!(rows[1], ("column".to_string(), "1".to_string()));
    bench.frame(vec![Bench::button(at, true)]);
    bench.frame(vec![Bench::button(at, false)]);
    let mut edit = bench.ui.edit(1);
    edit.thickness_mm = 0.3;
    bench.ui.set_edit(1, edit);
    assert_eq!(bench.asked.borrow().recomputed.last().map(|(leaf, _)| *leaf), Some(1));
}

#[test]
fn a_check_shows_its_verdict_until_the_scene_changes() {
    let Some(mut bench) = bench() else { return };
    let live = bench.pixels();
    bench.click("check");
    bench.frame(vec![]);
    assert_eq!(
        (bench.asked.borrow().checked, bench.ui.passed()),
        (1, Some(false)),
        "black is no reference for a lit leaf"
    );
    // Nothing of the panel is wider than the panel: what is, would be cut on both sides.
    let (panel, content) =
        (bench.ui.landmark_rect("right panel").unwrap(), bench.ui.landmark_rect("right panel's content").unwrap());
    assert!(content.width() <= panel.width() + 0.5, "{} in {}", content.width(), panel.width());
    for name in ["check", "live", "side by side", "flipped"] {
        let rect = bench.ui.landmark_rect(name).unwrap();
        assert!(rect.left() >= PIXELS[0] as f32 - 275.0 && rect.right() <= PIXELS[0] as f32, "{name}: {rect:?}");
    }
    let difference = live.iter().zip(&bench.pixels()).filter(|(a, b)| a != b).count();
    assert!(difference > 20_000, "three pictures in place of one: {difference} pixels");
    if let Ok(folder) = std::env::var("MESOPHYLL_PICTURES") {
        bench.stage.save_png(&std::path::Path::new(&folder).join("check.png")).expect("png");
    }
    bench.click("flipped");
    let first = bench.pixels();
    bench.time += 0.7;
    bench.frame(vec![]);
    assert!(first != bench.pixels(), "picture and reference take turns");
}

#[test]
fn back_texels_are_counted_in_the_backs_own_image() {
    let scene = scene_of(uniform_leaf());
    let hit = |eye: Vec3, x: f32| {
        let mut c = camera(eye, 100.0);
        c.fov_y_deg = 2.0 * (10.0f32 / 100.0).atan().to_degrees();
        pick(&scene, &c, 1.0, x, 0.3).expect("hit")
    };
    // Either side's own image runs to the right as its camera sees it.
    for (eye, side) in [(Vec3::Z, Side::Front), (-Vec3::Z, Side::Back)] {
        let h = hit(eye, 0.2);
        assert_eq!((h.side, h.texel), (side, [1, 2]));
    }
    let mut holed = scene.clone();
    leaf(&mut holed, 0).mask = Some(vec![0; 64]);
    assert_eq!(pick(&holed, &camera(Vec3::Z, 100.0), 1.0, 0.5, 0.5), None);
}

/// Runs an ignored test of this file in a process of its own: a process may open one window only.
fn child(mut command: std::process::Command, test: &str) -> (bool, String) {
    let out = command.args(["--exact", test, "--ignored", "--nocapture"]).output().expect("child");
    (out.status.success(), format!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr)))
}

#[test]
fn without_a_display_the_window_says_so() {
    let mut command = std::process::Command::new(std::env::current_exe().expect("path"));
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    let (passed, words) = child(command, "child_without_display");
    assert!(passed && words.contains("the window could not be opened: there is no display here"), "{words}");
    // No place in the source of a library, as it lay on the machine that built it.
    assert!(!words.contains(".rs") && !words.contains("os error"), "{words}");
}

#[test]
#[ignore = "run by without_a_display_the_window_says_so"]
fn child_without_display() {
    let (window, toy) = two_leaves();
    let error = open_window(window, Box::new(toy), &WindowOptions::default()).expect_err("no display");
    assert!(matches!(error, Error::Window(_)));
    println!("{error}");
}

#[test]
fn a_real_window_opens_draws_and_closes() {
    if bench().is_none() {
        return;
    }
    if !std::process::Command::new("xvfb-run").arg("--help").output().is_ok_and(|o| o.status.success()) {
        return skips::skip(skips::Need::Display, "no virtual display (xvfb-run)");
    }
    let mut command = std::process::Command::new("xvfb-run");
    command.args(["-a", "-s", "-screen 0 1100x720x24"]).arg(std::env::current_exe().expect("path"));
    let (passed, words) = child(command, "child_with_window");
    assert!(passed, "{words}");
}

#[test]
#[ignore = "run by a_real_window_opens_draws_and_closes"]
fn child_with_window() {
    let (window, toy) = two_leaves();
    let path = std::env::temp_dir().join(format!("mesophyll-window-{}.png", std::process::id()));
    let options =
        WindowOptions { size: [900, 600], frames: Some(3), screenshot: Some(path.clone()), ..Default::default() };
    open_window(window, Box::new(toy), &options).expect("window");
    let shot = image::open(&path).expect("screenshot").to_rgb8();
    std::fs::remove_file(&path).expect("removed");
    let colours: std::collections::HashSet<[u8; 3]> = shot.pixels().map(|p| p.0).collect();
    assert!(
        shot.width() >= 600 && colours.len() > 200,
        "{}x{}, {} colours",
        shot.width(),
        shot.height(),
        colours.len()
    );
}

#[test]
fn a_swaying_branch_plays_and_stops() {
    use mesophyll_viewer::scene::{Branch, Ride, Wind};
    let (mut window, toy) = two_leaves();
    let branch = Branch {
        root: Vec3::new(-12.0, 0.0, 0.0),
        t: Vec3::X,
        r: Vec3::Y,
        s: Vec3::Z,
        length: 48.0,
        alpha: 1.0,
        ln_alpha: 0.0,
        ell: 1.0,
        a: [2.0, -4.0 / 3.0, 1.0 / 3.0, 0.0],
        still: [0.0, 0.0],
        gain: 1.0,
        start: [0.1, 0.2],
        velocity: [0.5, 0.06],
    };
    let motion = (0..32 * 32).map(|k| [0.0, 0.3 * (std::f32::consts::TAU * (k % 32) as f32 / 32.0).sin()]).collect();
    window.scene.branches = vec![branch];
    window.scene.wind = Some(Wind { size: 32, motion, time_s: 0.0 });
    window.views.push(WindowView { name: "later".into(), camera: window.camera, time_s: Some(0.9) });
    window.scene.instances[1].ride = Some(Ride { branch: 0, at: Some(0.8) });
    let Some(mut bench) = bench_on((window, toy)) else { return };
    let time = |bench: &Bench| bench.ui.scene().wind.as_ref().map_or(f64::NAN, |w| w.time_s);
    let rect = bench.ui.landmark_rect("picture").expect("picture");
    let picture = |bench: &Bench| -> Vec<[u8; 4]> {
        let all = bench.pixels();
        (rect.top() as usize..rect.bottom() as usize)
            .flat_map(|y| all[y * PIXELS[0] as usize..][rect.left() as usize..rect.right() as usize].to_vec())
            .collect()
    };
    assert_eq!(time(&bench), 0.0);
    let still = picture(&bench);
    bench.click("play");
    for _ in 0..6 {
        bench.frame(vec![]);
    }
    assert!(time(&bench) > 0.1, "{}", time(&bench));
    assert_ne!(picture(&bench), still);
    bench.click("play");
    let stopped = time(&bench);
    bench.frame(vec![]);
    assert_eq!(time(&bench), stopped);
    // By hand: the slider's left end is the time the scene opened with.
    let slider = bench.ui.landmark_rect("time").expect("slider");
    let from = egui::pos2(slider.left() + 2.0, slider.center().y);
    bench.drag(from + egui::vec2(30.0, 0.0), egui::vec2(-60.0, 0.0));
    assert_eq!(time(&bench), 0.0); // A view of another time sets the clock, and stops it.
    let before = picture(&bench);
    bench.click("play");
    bench.click("view later");
    assert_eq!(time(&bench), 0.9);
    bench.frame(vec![]);
    assert_eq!(time(&bench), 0.9);
    assert_ne!(picture(&bench), before);
    bench.click("view front");
    assert_eq!(time(&bench), 0.9, "a view without a time of its own leaves the clock alone");
}

/// The corners of what a check's picture shows lie within the live picture, whatever the window's shape.
#[test]
fn the_live_picture_shows_all_that_a_view_shows() {
    let Some(bench) = bench() else { return };
    let (asked, shown) = (bench.ui.camera(), bench.ui.live_camera());
    let rect = bench.ui.landmark_rect("picture").expect("picture");
    let tan = |c: &Camera| (0.5 * c.fov_y_deg.to_radians()).tan();
    assert!(rect.width() / rect.height() < 64.0 / 48.0, "a window narrower than the check's picture");
    let (half_width, half_height) = (tan(&asked) * 64.0 / 48.0, tan(&asked));
    assert!(tan(&shown) * rect.width() / rect.height() >= 0.999 * half_width && tan(&shown) >= half_height);
    assert_eq!((asked.eye, asked.target), (shown.eye, shown.target));
}
