//! Undo and redo, presets, typed numbers, A and B, the picture in numbers, and screenshots with a name.

use crate::bench::{Bench, PIXELS, bench, bench_on, load, on_front, two_leaves};
use egui::{Event, Key, Modifiers, Rect};
use mesophyll_viewer::scene::Side;
use mesophyll_window::edit::{EditQuantity, EditTarget};

/// The picture's area, row by row.
fn picture(bench: &Bench) -> (Rect, Vec<Vec<[u8; 4]>>) {
    let rect = bench.ui.landmark_rect("picture").expect("picture");
    let all = bench.pixels();
    let row = |y: usize| all[y * PIXELS[0] as usize..][rect.left() as usize..rect.right() as usize].to_vec();
    (rect, (rect.top() as usize..rect.bottom() as usize).map(row).collect())
}

fn press(bench: &mut Bench, key: Key, modifiers: Modifiers) {
    bench.frame(vec![Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers }]);
    bench.frame(vec![]);
    bench.frame(vec![]);
}

/// The sun, as numbers.
fn sun(bench: &Bench) -> (glam::Vec3, [f32; 3], f32) {
    let sun = bench.ui.scene().sun.expect("sun");
    (sun.direction, sun.irradiance, sun.radius)
}

/// Moves the pointer off every control.
fn aside(bench: &mut Bench) {
    bench.frame(vec![Event::PointerMoved(egui::pos2(560.0, 5.0))]);
    bench.frame(vec![]);
    bench.frame(vec![]);
}

fn save(bench: &Bench, name: &str) {
    if let Ok(folder) = std::env::var("MESOPHYLL_PICTURES") {
        bench.stage.save_png(&std::path::Path::new(&folder).join(name)).expect("png");
    }
}

#[test]
fn every_edit_is_undone_and_done_again() {
    let Some(mut bench) = bench() else { return };
    aside(&mut bench);
    let (start, pixels) = (bench.leaf(), picture(&bench).1);
    let own = sun(&bench);
    // One drag over many frames is one step.
    let slider = bench.ui.landmark_rect("h").expect("slider");
    let handle = egui::pos2(slider.left() + 55.0, slider.center().y);
    bench.frame(vec![Event::PointerMoved(handle)]);
    bench.frame(vec![Bench::button(handle, true)]);
    for k in 1..=5 {
        bench.frame(vec![Event::PointerMoved(handle + egui::vec2(6.0 * k as f32, 0.0))]);
    }
    bench.frame(vec![Bench::button(handle + egui::vec2(30.0, 0.0), false)]);
    let thick = bench.leaf();
    assert!(bench.thickness() > 0.2);
    let elevation = bench.place("elevation");
    bench.drag(elevation - egui::vec2(60.0, 0.0), egui::vec2(-20.0, 0.0));
    let low = sun(&bench);
    assert_ne!(low.0, own.0);
    aside(&mut bench);
    let edited = picture(&bench).1;

    bench.click("undo");
    assert_eq!(sun(&bench), own, "the sun is as the scene has it, bit for bit");
    assert_eq!(bench.leaf(), thick);
    press(&mut bench, Key::Z, Modifiers::COMMAND);
    aside(&mut bench);
    assert_eq!(bench.leaf(), start);
    assert!(picture(&bench).1 == pixels, "the picture is as it was");
    press(&mut bench, Key::Z, Modifiers::COMMAND);
    assert_eq!(bench.leaf(), start, "there is nothing before the first state");
    press(&mut bench, Key::Z, Modifiers::COMMAND | Modifiers::SHIFT);
    assert_eq!(bench.leaf(), thick);
    bench.click("redo");
    aside(&mut bench);
    assert!(sun(&bench) == low && picture(&bench).1 == edited);
    // A new edit after an undo ends what could be done again.
    press(&mut bench, Key::Z, Modifiers::COMMAND);
    bench.ui.edit([on_front(EditQuantity::SigmaA(0), 3.0)]);
    bench.frame(vec![]);
    press(&mut bench, Key::Y, Modifiers::COMMAND);
    assert_eq!(sun(&bench), own);
    bench.click("undo");
    assert_eq!(bench.leaf(), thick);
}

#[test]
fn branches_are_undone_too() {
    use mesophyll_window::editor::{PlantInfo, PlantPart};
    let (window, toy) = two_leaves();
    let branches = vec![("trunk".into(), 0), ("1.0".into(), 1)];
    toy.asked.borrow_mut().plants = Some((vec![PlantInfo { name: "twig".into(), branches }], window.scene.clone()));
    let Some(mut bench) = bench_on((window, toy)) else { return };
    let up = |bench: &Bench| bench.ui.scene().instances[1].transform.w_axis.z;
    bench.ui.edit([load(PlantPart::Level(0), 3.0)]);
    bench.frame(vec![]);
    assert_eq!(up(&bench), 2.0);
    bench.ui.undo();
    assert!(up(&bench) == 0.0 && bench.branches().is_empty());
    bench.ui.redo();
    assert!(up(&bench) == 2.0 && bench.branches().iter().count() == 1);
}

#[test]
fn presets_are_edits() {
    let Some(mut bench) = bench() else { return };
    let (start, own) = (bench.leaf(), sun(&bench));
    bench.click("leaf preset");
    bench.click("leaf preset twice as thick");
    assert_eq!(bench.thickness(), 2.0 * 0.2);
    bench.click("leaf preset");
    save(&bench, "presets.png");
    bench.click("leaf preset matte");
    let matte = bench.leaf();
    let back = EditTarget::LeafSide(0, Side::Back);
    assert!(bench.thickness() == 0.2 && matte.get(back, EditQuantity::RhoS) == Some(0.0));
    bench.click("light preset");
    bench.click("light preset low sun");
    let low = sun(&bench).0;
    assert!((low.z - 10f32.to_radians().sin()).abs() < 1e-5, "{low}");
    let flat = |v: glam::Vec3| v.truncate().normalize();
    assert!(flat(low).distance(flat(own.0)) < 1e-4, "the sun stays in its azimuth");
    // Against the light: the sun is on the far side of what is looked at.
    bench.ui.preset_lights("against the light");
    let camera = bench.ui.camera();
    let ahead = flat(camera.target - camera.eye);
    assert!(flat(sun(&bench).0).distance(ahead) < 1e-4);
    bench.ui.preset_lights("sun alone");
    assert_eq!((bench.ui.scene().sky, sun(&bench)), (Some([0.0; 3]), own));
    bench.ui.preset_lights("no such preset");
    assert_eq!(bench.ui.scene().sky, Some([0.0; 3]));
    bench.ui.preset_lights("as opened");
    assert_eq!((bench.ui.scene().sky, sun(&bench)), (Some([0.4, 0.5, 0.6]), own));
    bench.ui.preset_leaf_edit(0, "as fitted");
    assert_eq!(bench.leaf(), start);
    bench.ui.undo();
    assert_eq!(bench.leaf(), matte);
}

/// A leaf whose reflection is stated has no σ and no thickness to change, but a gloss.
#[test]
fn a_stated_leaf_has_no_tissue_to_edit() {
    let (window, toy) = two_leaves();
    toy.asked.borrow_mut().stated = true;
    let Some(mut bench) = bench_on((window, toy)) else { return };
    let start = bench.leaf();
    for (name, there) in [("h", false), ("σa R", false), ("σs B", false), ("ρs ×", true), ("m ×", true)] {
        assert_eq!(bench.ui.landmark_rect(name).is_some(), there, "{name}");
    }
    bench.click("leaf preset");
    assert!(bench.ui.landmark_rect("leaf preset little pigment").is_none());
    bench.click("leaf preset polished");
    let sharper = on_front(EditQuantity::M, 0.5);
    assert_eq!(bench.ui.value(sharper.target, sharper.quantity), Some(0.5));
    bench.click("leaf preset");
    bench.click("leaf preset as stated");
    assert_eq!(bench.leaf(), start);
}

/// A click on a slider's number, digits, and Enter.
#[test]
fn numbers_are_typed() {
    let Some(mut bench) = bench() else { return };
    let slider = bench.ui.landmark_rect("h").expect("slider");
    let number = egui::pos2(slider.left() + 125.0, slider.center().y);
    bench.frame(vec![Event::PointerMoved(number)]);
    bench.frame(vec![Bench::button(number, true)]);
    bench.frame(vec![Bench::button(number, false)]);
    bench.frame(vec![]);
    press(&mut bench, Key::A, Modifiers::COMMAND);
    bench.frame(vec![Event::Text("0.345".into())]);
    // The keys of undo belong to the field now.
    press(&mut bench, Key::Enter, Modifiers::NONE);
    assert!((bench.thickness() - 0.345).abs() < 1e-6, "{}", bench.thickness());
    press(&mut bench, Key::Z, Modifiers::COMMAND);
    assert_eq!(bench.thickness(), 0.2);
}

#[test]
fn a_hint_says_the_unit() {
    let Some(mut bench) = bench() else { return };
    aside(&mut bench);
    let before = bench.pixels();
    let at = bench.place("h");
    bench.frame(vec![Event::PointerMoved(at)]);
    for _ in 0..30 {
        bench.frame(vec![]);
    }
    save(&bench, "hint.png");
    let changed = before.iter().zip(bench.pixels()).filter(|(a, b)| **a != *b).count();
    assert!(changed > 2000, "{changed}");
}

#[test]
fn a_and_b_are_parted_by_a_line() {
    let Some(mut bench) = bench() else { return };
    aside(&mut bench);
    let (start, a) = (bench.leaf(), picture(&bench).1);
    bench.click("keep");
    aside(&mut bench);
    bench.ui.preset_leaf_edit(0, "twice as thick");
    let wipe = bench.ui.landmark_rect("wipe").expect("wipe");
    // The line at the right end shows A alone, at the left end B alone.
    let ends = [wipe.left() + 6.0, wipe.left() + 134.0];
    let at = |bench: &mut Bench, x: f32| {
        let pos = egui::pos2(x, wipe.center().y);
        bench.frame(vec![Event::PointerMoved(pos)]);
        bench.frame(vec![Bench::button(pos, true)]);
        bench.frame(vec![Bench::button(pos, false)]);
        aside(bench);
        picture(bench)
    };
    let (_, only_b) = at(&mut bench, ends[0] - 4.0);
    let (_, only_a) = at(&mut bench, ends[1] + 4.0);
    let (rect, both) = at(&mut bench, wipe.left() + 70.0);
    save(&bench, "a-and-b.png");
    let (row, panel) = (bench.place("drop"), bench.ui.landmark_rect("right panel").unwrap());
    assert!(row.x + 30.0 < panel.left(), "the controls lie below the picture");
    let width = rect.width() as usize;
    // Letters stand in the upper rows, and the line has a few columns.
    let rows = || 40..both.len();
    let differ = |p: &[Vec<[u8; 4]>], q: &[Vec<[u8; 4]>], columns: std::ops::Range<usize>| {
        rows().map(|y| columns.clone().filter(|x| p[y][*x] != q[y][*x]).count()).sum::<usize>()
    };
    assert!(differ(&only_a, &only_b, 5..width - 5) > 5000, "A and B are not alike");
    assert_eq!(differ(&a, &only_a, 5..width - 5), 0, "A is as it was kept");
    let line = rows().filter_map(|y| (5..width - 5).find(|x| both[y][*x] == [0, 0, 0, 255])).max().expect("a line");
    assert!((0.4..0.6).contains(&(line as f32 / width as f32)), "{line} of {width}");
    assert_eq!(differ(&both, &only_a, 5..line - 5), 0);
    assert_eq!(differ(&both, &only_b, line + 5..width - 5), 0);
    assert!(differ(&both, &only_b, 5..line - 5) > 1000 && differ(&both, &only_a, line + 5..width - 5) > 1000);
    // The camera moves both. Undo knows nothing of the drawing of A.
    let b = bench.leaf();
    bench.drag(bench.place("picture") + egui::vec2(0.0, 80.0), egui::vec2(40.0, 10.0));
    aside(&mut bench);
    let (_, turned) = picture(&bench);
    assert_eq!(bench.leaf(), b);
    bench.click("swap");
    assert_eq!(bench.leaf(), start);
    aside(&mut bench);
    let (_, swapped) = picture(&bench);
    assert!(differ(&turned, &swapped, 5..line - 5) > 1000 && differ(&turned, &swapped, line + 5..width - 5) > 1000);
    bench.click("drop");
    aside(&mut bench);
    let (_, alone) = picture(&bench);
    assert_eq!(differ(&swapped, &alone, line + 5..width - 5), 0, "the right side was B");
    assert_eq!(differ(&turned, &alone, 5..line - 5), 0, "and the left side was A, from the new place");
    bench.ui.undo();
    assert_eq!(bench.leaf(), b);
}

/// In a narrow window, the controls of A and B take a second row, and none lies under the panel beside the picture.
#[test]
fn a_narrow_window_hides_no_control() {
    let Some(mut bench) = bench() else { return };
    bench.click("keep");
    let size = [860, 600];
    (0..3).for_each(|_| bench.frame_of(size, vec![]));
    save(&bench, "narrow.png");
    let panel = bench.ui.landmark_rect("right panel").expect("panel").left();
    let at = |name: &str| bench.ui.landmark_rect(name).unwrap_or_else(|| panic!("no control {name}"));
    for name in ["keep", "wipe", "swap", "drop"] {
        assert!(at(name).right() < panel, "{name}: {:?} reaches the panel at {panel}", at(name));
    }
    assert!(at("drop").top() > at("keep").top(), "a second row");
}

#[test]
fn a_check_is_wiped() {
    let Some(mut bench) = bench() else { return };
    bench.click("check");
    bench.frame(vec![]);
    bench.click("wiped");
    aside(&mut bench);
    save(&bench, "wiped.png");
    let (rect, rows) = picture(&bench);
    // The reference is black, and the picture of two leaves is not. Letters stand in the upper and the lower rows.
    let light = |from: f32, to: f32| {
        let columns = (rect.width() * from) as usize..(rect.width() * to) as usize;
        rows[150..rows.len() - 150].iter().map(|row| row[columns.clone()].iter().filter(|p| p[1] > 60).count()).sum()
    };
    let (left, right): (usize, usize) = (light(0.02, 0.48), light(0.52, 0.98));
    assert!(left > 2000 && right == 0, "{left} {right}");
}

#[test]
fn the_picture_in_numbers() {
    let Some(mut bench) = bench() else { return };
    aside(&mut bench);
    let (rect, plain) = picture(&bench);
    assert_eq!(bench.ui.means(), None, "nothing is read until somebody asks");
    bench.click("histogram");
    for _ in 0..3 {
        aside(&mut bench);
    }
    let means = bench.ui.means().expect("numbers");
    for (c, mean) in means.into_iter().enumerate() {
        let own = plain.iter().flatten().map(|p| f64::from(p[c])).sum::<f64>() / f64::from(rect.area());
        // Both are 8 bits; the interface's own texture may round differently.
        assert!((f64::from(mean) - own).abs() < 0.6, "{mean} {own}");
    }
    // A picture at rest is read once.
    let draws = bench.stage.renderer().stats().draws;
    aside(&mut bench);
    assert_eq!(bench.stage.renderer().stats().draws, draws);
    bench.click("false colour");
    for _ in 0..3 {
        aside(&mut bench);
    }
    save(&bench, "false-colour.png");
    let (_, coloured) = picture(&bench);
    let changed = plain.iter().flatten().zip(coloured.iter().flatten()).filter(|(a, b)| a != b).count();
    assert!(changed as f32 > 0.9 * rect.area(), "{changed}");
    // Lighter pixels are further along the scale, whose green rises all the way.
    let luminance = |p: &[u8; 4]| 0.2126 * f32::from(p[0]) + 0.7152 * f32::from(p[1]) + 0.0722 * f32::from(p[2]);
    let mut pairs: Vec<(f32, u8)> =
        plain.iter().flatten().zip(coloured.iter().flatten()).map(|(a, b)| (luminance(a), b[1])).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mean = |part: &[(f32, u8)]| part.iter().map(|p| f32::from(p.1)).sum::<f32>() / part.len() as f32;
    let tenth = pairs.len() / 10;
    assert!(mean(&pairs[..tenth]) + 60.0 < mean(&pairs[pairs.len() - tenth..]));
    // An edit makes other numbers.
    bench.ui.preset_leaf_edit(0, "twice as thick");
    for _ in 0..4 {
        aside(&mut bench);
    }
    assert!(bench.ui.means().expect("numbers")[1] < means[1]);
    bench.ui.show_false_colour(false);
}

#[test]
fn a_screenshot_gets_the_name_that_was_typed() {
    let (mut window, toy) = two_leaves();
    let folder = std::env::temp_dir().join(format!("mesophyll-shots-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("folder");
    window.screenshots = folder.clone();
    let Some(mut bench) = bench_on((window, toy)) else { return };
    bench.click("screenshot");
    bench.frame(vec![]);
    assert!(folder.join("bench-1.png").is_file(), "{}", bench.ui.message());
    bench.click("screenshot name");
    bench.frame(vec![Event::Text("../evening light".into())]);
    for _ in 0..2 {
        bench.click("screenshot");
        bench.frame(vec![]);
    }
    let mut names: Vec<String> =
        std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["---evening light-2.png", "---evening light.png", "bench-1.png"]);
    std::fs::remove_dir_all(&folder).expect("removed");
}

#[test]
fn an_environment_map_is_seen_behind_the_scene() {
    let (mut window, toy) = two_leaves();
    let (width, height) = (8, 4);
    let texels = std::sync::Arc::new(vec![[0.0, 3.0, 0.0]; 32]);
    window.scene.backdrop = Some(mesophyll_viewer::scene::Backdrop { width, height, texels, turn: 0.0 });
    let Some(mut bench) = bench_on((window, toy)) else { return };
    aside(&mut bench);
    // Radiance 3 is shown as 0.75, which sRGB encodes as 225.
    let corner = |bench: &Bench| picture(bench).1[60][10];
    assert_eq!(corner(&bench), [0, 225, 0, 255]);
    bench.click("backdrop");
    aside(&mut bench);
    let plain = corner(&bench);
    assert!(plain[0] == plain[1] && plain[1] < 60, "{plain:?}");
}
