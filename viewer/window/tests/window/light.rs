//! Changes of sun, sky and wind by hand.

use crate::bench::{Bench, PIXELS, bench, bench_on, even_dome, two_leaves};
use glam::{Quat, Vec3};
use mesophyll_viewer::scene::{SectionAnimation, SectionBinding, SectionMotion, WindState};
use mesophyll_window::WindowView;
use std::sync::Arc;

#[test]
fn sun_and_turbidity_ask_for_another_sky() {
    let (mut window, toy) = two_leaves();
    window.scene.sky = None;
    window.scene.dome = Some(even_dome(Vec3::new(-0.4, 0.3, 1.0).normalize(), 3.0));
    let Some(mut bench) = bench_on((window, toy)) else { return };
    assert!(bench.asked.borrow().skies.is_empty(), "a sky was asked for before anything was touched");
    let before = bench.brightness();
    let rect = bench.ui.landmark_rect("turbidity").expect("no turbidity slider");
    // The rail is the left part of the control, and its left end is the lowest turbidity.
    let at = |share: f32| egui::pos2(rect.left() + 5.0 + share * 100.0, rect.center().y);
    bench.drag(at(0.2), egui::vec2(40.0, 0.0));
    let (sun, turbidity) = *bench.asked.borrow().skies.last().expect("no sky was asked for");
    assert!(turbidity > 4.0 && (sun.length() - 1.0).abs() < 1e-5, "{sun} {turbidity}");
    let dome = bench.ui.scene().dome.clone().expect("dome");
    assert_eq!(dome.turbidity, turbidity);
    assert!((bench.ui.scene().sun.unwrap().irradiance[0] - turbidity).abs() < 1e-5);
    assert!(bench.brightness() > before + 1.0, "{} {before}", bench.brightness());
    // The sun changes, and the turbidity stays.
    let azimuth = bench.place("azimuth");
    bench.drag(azimuth - egui::vec2(60.0, 0.0), egui::vec2(30.0, 0.0));
    let (turned, same) = *bench.asked.borrow().skies.last().unwrap();
    assert!(turned != sun && same == turbidity);
    assert_eq!(bench.ui.scene().dome.as_ref().unwrap().sun, turned);
    // A refusal leaves the sky unchanged, and the message says why.
    bench.drag(at(0.5), egui::vec2(60.0, 0.0));
    assert!(bench.ui.message().contains("refused") && bench.ui.scene().dome.as_ref().unwrap().turbidity <= 9.0);
}

/// Where vertices have shares of the sun, the window asks for the shares of a sun that was moved. It draws the old ones
/// until the new ones are ready.
#[test]
fn a_moved_sun_gets_new_shares() {
    let (mut window, toy) = two_leaves();
    let vertices = window.scene.meshes[0].positions.len();
    for (k, instance) in window.scene.instances.iter_mut().enumerate() {
        instance.first_share = Some((k * vertices) as u32);
    }
    window.scene.sun_shares = Some(std::sync::Arc::new(vec![255; 2 * vertices]));
    // There is no other light, neither in the picture nor on the leaves.
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
    // A map with another number of vertices belongs to another scene.
    bench.asked.borrow_mut().ready = Some(vec![0; 7]);
    bench.frame(vec![]);
    assert_eq!(bench.ui.scene().sun_shares.as_ref().unwrap().len(), 2 * vertices);
    bench.asked.borrow_mut().ready = Some(vec![0; 2 * vertices]);
    bench.frame(vec![]);
    assert!(bench.ui.scene().sun_shares.as_ref().unwrap().iter().all(|s| *s == 0));
    assert!(bench.brightness() < 0.5 * lit, "{} {lit}", bench.brightness());
    // An error is shown, and the shares stay.
    bench.asked.borrow_mut().no_shares = Some("no shadows".into());
    bench.frame(vec![]);
    assert_eq!(bench.ui.message(), "no shadows");
    assert!(bench.ui.scene().sun_shares.as_ref().unwrap().iter().all(|s| *s == 0));
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
fn a_swaying_leaf_plays_and_stops() {
    let (mut window, toy) = two_leaves();
    window.scene.sections = Some(SectionAnimation {
        count: 1,
        of_vertices: Arc::new(Vec::new()),
        turn_normals: true,
        poses: None,
        at: Arc::new(|time| {
            let to = Vec3::Z * (9.0 * (0.5 * std::f64::consts::TAU * time).sin()) as f32;
            vec![SectionMotion { from: Vec3::ZERO, to, turn: Quat::IDENTITY }]
        }),
    });
    window.scene.wind = Some(WindState { time_s: 0.0 });
    window.views.push(WindowView { name: "later".into(), camera: window.camera, time_s: Some(0.9) });
    window.scene.instances[1].carried = Some(SectionBinding { first: 0, vertices: None });
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
    // By hand: the slider's left end is the time at which the scene was opened.
    let slider = bench.ui.landmark_rect("time").expect("slider");
    let from = egui::pos2(slider.left() + 2.0, slider.center().y);
    bench.drag(from + egui::vec2(30.0, 0.0), egui::vec2(-60.0, 0.0));
    assert_eq!(time(&bench), 0.0);
    // A view with another time sets the clock and stops it.
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
