//! Branches in the renderer. They are uploaded and compiled only where something rides on one, and time moves them.

mod common;

use common::*;
use glam::Vec3;
use mesophyll_viewer::scene::{Ride, Scene, Wind};
use mesophyll_viewer::{Picture, Renderer};

fn wind(time_s: f64) -> Wind {
    let size = 32;
    let wave = |k: u32| (std::f32::consts::TAU * k as f32 / size as f32).sin();
    Wind {
        size,
        motion: (0..size * size).map(|k| [0.2 * wave(k % size), 0.3 * wave(k / size + 3 * (k % size))]).collect(),
        time_s,
    }
}

fn scene(amplitude: f32, gain: f32) -> Scene {
    let mut scene = scene_of(uniform_leaf());
    scene.meshes[0] = bent(10.0, 12, -0.01);
    scene.sun = Some(sun(Vec3::new(-0.4, 0.3, 1.0)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    scene.shadow_samples = 2;
    scene.branches = vec![cantilever(amplitude, gain)];
    scene.instances[0].ride = Some(Ride { branch: 0, at: None });
    scene
}

fn draw(renderer: &mut Renderer, scene: &Scene) -> Picture {
    renderer.set_scene(scene).expect("scene");
    look(renderer)
}

fn look(renderer: &mut Renderer) -> Picture {
    renderer.render(&camera(Vec3::new(0.5, -0.6, 0.9), 90.0), 48, 40).expect("picture")
}

#[test]
fn nothing_rides_nothing_bends() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene(0.3, 0.0);
    scene.instances[0].ride = None;
    scene.wind = Some(wind(0.5));
    let still = draw(&mut renderer, &scene);
    assert_eq!(renderer.stats().pipelines, ["shadow: opaque", "main: sun, shadow 2, sky", "tonemap"]);
    for part in ["branches", "motion", "rides"] {
        assert!(!renderer.stats().uploaded(part), "{part}");
    }
    scene.branches[0].still = [0.2, 0.1];
    scene.wind = None;
    let other = draw(&mut renderer, &scene);
    assert!(still.hdr == other.hdr && still.ldr == other.ldr);
}

#[test]
fn a_branch_without_load_is_drawn_as_it_stands_and_one_with_load_is_not() {
    let Some(mut renderer) = renderer() else { return };
    let bent = draw(&mut renderer, &scene(0.3, 0.0));
    assert_eq!(renderer.stats().pipelines, ["shadow: opaque, bend", "main: sun, shadow 2, sky, bend", "tonemap"]);
    assert!(renderer.stats().uploaded("branches") && !renderer.stats().uploaded("motion"));
    let level = draw(&mut renderer, &scene(0.0, 0.0));
    let mut without = scene(0.0, 0.0);
    without.instances[0].ride = None;
    let without = draw(&mut renderer, &without);
    // At rest, the bend moves vertices only by rounding errors, so a pixel at an edge may change.
    let differing =
        level.hdr.iter().zip(&without.hdr).filter(|(a, b)| a.iter().zip(*b).any(|(x, y)| (x - y).abs() > 1e-3)).count();
    assert!(differing <= 8, "{differing} pixels");
    let moved = bent.hdr.iter().zip(&without.hdr).filter(|(a, b)| a != b).count();
    assert!(moved > 200, "{moved} pixels");
}

#[test]
fn time_moves_branches_and_their_shadows_and_back() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene(0.1, 1.0);
    scene.wind = Some(wind(0.0));
    let first = draw(&mut renderer, &scene);
    assert_eq!(renderer.stats().pipelines, ["shadow: opaque, bend", "main: sun, shadow 2, sky, sway", "tonemap"]);
    let shadows = renderer.stats().shadow_renders;
    renderer.set_time(&wind(4.0));
    let second = look(&mut renderer);
    assert_ne!(first.ldr, second.ldr);
    assert_eq!(renderer.stats().shadow_renders, shadows + 1);
    renderer.set_time(&wind(0.0));
    assert_eq!(look(&mut renderer).hdr, first.hdr);
    // A scene that is set at the later time gives the same picture as the scene that was moved there.
    scene.wind = Some(wind(4.0));
    assert_eq!(draw(&mut renderer, &scene).hdr, second.hdr);
}

#[test]
fn contradictions_are_named() {
    let Some(mut renderer) = renderer() else { return };
    let mut said = |change: &dyn Fn(&mut Scene)| {
        let mut scene = scene(0.1, 1.0);
        scene.wind = Some(wind(0.0));
        change(&mut scene);
        renderer.set_scene(&scene).expect_err("a contradiction").to_string()
    };
    assert!(said(&|s| s.instances[0].ride = Some(Ride { branch: 3, at: None })).contains("instance 0, branch"));
    assert!(said(&|s| s.instances[0].ride = Some(Ride { branch: 0, at: Some(1.5) })).contains("place on its branch"));
    assert!(said(&|s| s.branches[0].r = Vec3::X).contains("orthonormal"));
    assert!(said(&|s| s.branches[0].still[0] = f32::NAN).contains("finite"));
    assert!(said(&|s| s.branches = vec![s.branches[0]; 200]).contains("at most 128"));
    assert!(said(&|s| s.wind = s.wind.take().map(|w| Wind { size: 31, ..w })).contains("motion texture"));
}
