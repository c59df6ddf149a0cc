//! Edits of leaves: what the editor is asked, and what the picture shows.

use crate::bench::{bench, bench_on, load, on_front, thick, two_leaves};
use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::scene::{CoefficientMaps, Interior, Translucency, TranslucencyBasis};
use mesophyll_window::edit::EditQuantity;
use mesophyll_window::editor::{PlantInfo, PlantPart};

#[test]
fn a_thicker_leaf_goes_through_the_editor_and_dims() {
    let Some(mut bench) = bench() else { return };
    let before = bench.brightness();
    let fitted = bench.ui.scene().leaf(0).expect("a leaf").sides.front.interior.clone();
    let slider = bench.ui.landmark_rect("h").expect("slider");
    // The slider's rail is its left part.
    let handle = egui::pos2(slider.left() + 55.0, slider.center().y);
    bench.drag(handle, egui::vec2(35.0, 0.0));
    let (edits, h) = (bench.leaf(), bench.thickness());
    assert!(h > 0.21, "h {h}");
    assert_eq!(
        bench.asked.borrow().recomputed.last(),
        Some(&(0, edits.clone())),
        "the editor hears of the edit as it stands"
    );
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").thickness_mm, h as f32);
    assert!(bench.brightness() < before - 0.2, "{} against {before}", bench.brightness());
    bench.click("save");
    assert_eq!(bench.asked.borrow().saved, [edits]);
    assert!(bench.ui.message().contains("fits/edited"));
    bench.click("reset");
    assert_eq!(bench.thickness(), 0.2);
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
    bench.ui.edit([on_front(EditQuantity::RhoS, 3.0), on_front(EditQuantity::M, 0.7)]);
    bench.ui.edit([on_front(EditQuantity::RhoS, 2.0), on_front(EditQuantity::M, 0.5)]);
    let gloss = bench.ui.scene().leaf(0).expect("a leaf").sides.front.gloss.clone().expect("gloss");
    assert!((gloss[0][0] - 0.1).abs() < 1e-6 && (gloss[0][3] - 0.15).abs() < 1e-6, "applied once: {:?}", gloss[0]);
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").sides.back.gloss, None);
}

#[test]
fn translucency_maps_are_taken_off_and_put_back() {
    let (mut window, toy) = two_leaves();
    window.scene.sun = Some(sun(Vec3::new(-0.4, 0.3, -1.0)));
    // A tenth of a flat leaf's light, so that the effect of the maps is visible.
    let coefficients = CoefficientMaps::Factor(vec![[0.0836; 3]; 64]);
    let maps = Translucency { basis: TranslucencyBasis::Bent, coefficients };
    leaf(&mut window.scene, 0).sides.back.translucency = Some(maps.clone());
    let Some(mut bench) = bench_on((window, toy)) else { return };
    let (dim, dimmed) = (bench.brightness(), bench.pixels());
    bench.click("translucency");
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").sides.back.translucency, None);
    // The leaf's share of the picture depends on the window, so only pixels that changed are judged.
    let brighter =
        dimmed.iter().zip(bench.pixels()).map(|(a, b)| f64::from(b[1]) - f64::from(a[1])).filter(|d| *d > 2.0);
    let (count, sum) = brighter.fold((0, 0.0), |(n, s), d| (n + 1, s + d));
    assert!(count > 300 && sum > 10.0 * f64::from(count), "{count} pixels brighter by {sum}");
    if let Ok(folder) = std::env::var("MESOPHYLL_PICTURES") {
        bench.stage.save_png(&std::path::Path::new(&folder).join("without-maps.png")).expect("png");
    }
    // Maps that are taken off twice are put back once. An edit between does not change them.
    bench.ui.show_translucency(0, false);
    bench.ui.edit([thick(0, 0.3)]);
    bench.frame(vec![]);
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").sides.back.translucency, None);
    bench.ui.reset(0);
    bench.click("translucency");
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").sides.back.translucency, Some(maps));
    assert_eq!(bench.brightness(), dim, "as it was");
    // A window whose leaves have no maps has no such control, and nothing to put back.
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
    let refused = on_front(EditQuantity::SigmaS(0), 250.0);
    bench.ui.edit([refused]);
    assert!(bench.ui.message().contains("refused here"));
    assert_eq!(bench.ui.value(refused.target, refused.quantity), Some(10.0));
}

#[test]
fn branches_are_edited_by_level_and_by_name_and_saved() {
    let (window, toy) = two_leaves();
    let branches = vec![("trunk".into(), 0), ("1.0".into(), 1), ("1.1".into(), 1)];
    toy.asked.borrow_mut().plants = Some((vec![PlantInfo { name: "twig".into(), branches }], window.scene.clone()));
    let Some(mut bench) = bench_on((window, toy)) else { return };
    let before = bench.pixels();
    // A leaf's own edit outlives an edit of branches.
    bench.ui.edit([thick(0, 0.3)]);
    let slider = bench.ui.landmark_rect("load ×").expect("slider");
    let handle = egui::pos2(slider.left() + 16.0, slider.center().y);
    bench.drag(handle, egui::vec2(30.0, 0.0));
    let edits = bench.branches();
    let edit = load(PlantPart::Level(0), 1.0);
    assert!(edits.iter().count() == 1 && edits.factor(edit.target, edit.quantity) > 2.0, "{edits:?}");
    // The plants are posed once, when the pointer lets go.
    assert_eq!(bench.asked.borrow().bent, [edits]);
    assert!(bench.ui.scene().instances[1].transform.w_axis.z > 1.0 && bench.pixels() != before);
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").thickness_mm, 0.3);
    // One branch, by its name; a name that no branch has is told.
    for (name, found) in [("oak", false), ("1.1", true)] {
        let field = bench.place("branch name");
        bench.click("branch name");
        let select = egui::Event::Key {
            key: egui::Key::A,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers: egui::Modifiers::COMMAND,
        };
        bench.frame(vec![select]);
        bench.frame(vec![egui::Event::Text(name.into())]);
        // A click beside the field ends the typing.
        let aside = field + egui::vec2(0.0, 400.0);
        bench.frame(vec![egui::Event::PointerMoved(aside)]);
        bench.frame(vec![crate::bench::Bench::button(aside, true)]);
        bench.frame(vec![crate::bench::Bench::button(aside, false)]);
        assert_eq!(bench.ui.message().contains("no branch \"oak\""), !found, "{}", bench.ui.message());
    }
    bench.drag(handle, egui::vec2(30.0, 0.0));
    let edit = load(PlantPart::Branch(2), 1.0);
    assert!(bench.branches().get(edit.target, edit.quantity).is_some(), "{:?}", bench.branches());
    // A refusal is told, and nothing changes.
    let kept = bench.branches();
    bench.ui.edit([load(PlantPart::Level(1), 10.0)]);
    assert!(bench.ui.message() == "its tip goes too far" && bench.branches() == kept);
    bench.frame(vec![]);
    bench.click("save plant");
    assert_eq!(bench.asked.borrow().saved_plants, [0]);
    assert!(bench.ui.message().contains("plants/twig-edit-1.glb"));
    bench.click("reset plant");
    assert!(bench.branches().is_empty());
    assert_eq!(bench.ui.scene().instances[1].transform.w_axis.z, 0.0);
    assert_eq!(bench.ui.scene().leaf(0).expect("a leaf").thickness_mm, 0.3);
}
