//! The picture: what is drawn, what is under the pointer, the camera and the check.

use crate::bench::{Bench, PIXELS, bench, thick};
use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::picking::pick;
use mesophyll_viewer::scene::{Camera, Side};

#[test]
fn everything_is_drawn_without_a_display() {
    let Some(bench) = bench() else { return };
    let pixels = bench.pixels();
    let colours: std::collections::HashSet<[u8; 4]> = pixels.iter().copied().collect();
    assert!(colours.len() > 200, "{} colours", colours.len());
    // The picture and the two panels beside it show something.
    let rect = bench.ui.landmark_rect("picture").expect("picture");
    let (left, right) = (rect.left() as usize, rect.right() as usize);
    for (from, to) in [(0, left), (left, right), (right, PIXELS[0] as usize)] {
        let part: std::collections::HashSet<[u8; 4]> =
            pixels.chunks(PIXELS[0] as usize).flat_map(|row| row[from..to].iter().copied()).collect();
        assert!(part.len() > 20, "columns {from} to {to}: {} colours", part.len());
    }
    if let Ok(folder) = std::env::var("MESOPHYLL_PICTURES") {
        bench.stage.save_png(&std::path::Path::new(&folder).join("window.png")).expect("png");
    }
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
    // The place of a point of the second leaf in the picture.
    let view = glam::camera::rh::view::look_at_mat4(camera.eye, camera.target, camera.up);
    let p = view.transform_point3(Vec3::new(18.0, 3.0, -0.02 * 36.0));
    let t = (camera.fov_y_deg.to_radians() / 2.0).tan();
    let at = rect.center() + egui::vec2(p.x / -p.z / t, -p.y / -p.z / t) * 0.5 * rect.height();
    assert!(rect.contains(at), "{at:?} in {rect:?}");
    bench.frame(vec![egui::Event::PointerMoved(at)]);
    bench.frame(vec![]);
    let (hit, rows) = bench.ui.under_pointer().expect("a leaf").clone();
    // The point is at x = −6 of ±10 mm and y = 3, which is column 1 of 8 and row 2.
    assert_eq!((hit.material, hit.side, hit.texel), (1, Side::Front, [1, 2]));
    assert_eq!(rows[1], ("column".to_string(), "1".to_string()));
    bench.frame(vec![Bench::button(at, true)]);
    bench.frame(vec![Bench::button(at, false)]);
    bench.ui.edit([thick(1, 0.3)]);
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
    // The content must not be wider than the panel, because it would be cut on both sides.
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
    // The image of either side runs to the right as that side's camera sees it.
    for (eye, side) in [(Vec3::Z, Side::Front), (-Vec3::Z, Side::Back)] {
        let h = hit(eye, 0.2);
        assert_eq!((h.side, h.texel), (side, [1, 2]));
    }
    let mut holed = scene.clone();
    leaf(&mut holed, 0).mask = Some(vec![0; 64]);
    assert_eq!(pick(&holed, &camera(Vec3::Z, 100.0), 1.0, 0.5, 0.5), None);
}

/// The corners of a check's picture lie within the live picture, for any shape of the window.
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
