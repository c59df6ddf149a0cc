//! Sections in the renderer. They are uploaded and compiled only where they carry something, and time moves them.

use crate::common::*;
use glam::{Quat, Vec3};
use mesophyll_viewer::scene::{
    Material, OpaqueMaterial, PoseHierarchy, Scene, SectionAnimation, SectionBinding, SectionMotion, WindState,
};
use mesophyll_viewer::{Picture, Renderer};
use std::sync::Arc;

fn scene(still: f32) -> Scene {
    let mut scene = scene_of(uniform_leaf());
    scene.meshes[0] = bent(10.0, 12, -0.01);
    scene.sun = Some(sun(Vec3::new(-0.4, 0.3, 1.0)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    scene.shadow_samples = 2;
    scene.sections = Some(swinging(&scene.meshes[0], still));
    scene.instances[0].carried = Some(SectionBinding { first: 0, vertices: Some(0) });
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
fn nothing_is_carried_nothing_bends() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene(0.3);
    scene.instances[0].carried = None;
    scene.wind = Some(WindState { time_s: 0.5 });
    let still = draw(&mut renderer, &scene);
    assert_eq!(renderer.stats().pipelines, ["shadow: opaque", "main: sun, shadow 2, sky", "tonemap"]);
    for part in ["sections", "rides"] {
        assert!(!renderer.stats().uploaded(part), "{part}");
    }
    scene.sections = None;
    scene.wind = None;
    let other = draw(&mut renderer, &scene);
    assert!(still.hdr == other.hdr && still.ldr == other.ldr);
}

#[test]
fn sections_that_move_nothing_change_nothing_and_others_do() {
    let Some(mut renderer) = renderer() else { return };
    let bent = draw(&mut renderer, &scene(0.3));
    assert_eq!(renderer.stats().pipelines, ["shadow: opaque, bend", "main: sun, shadow 2, sky, sections", "tonemap"]);
    assert!(renderer.stats().uploaded("sections"));
    let level = draw(&mut renderer, &scene(0.0));
    let mut without = scene(0.0);
    without.instances[0].carried = None;
    let without = draw(&mut renderer, &without);
    // At rest, sections move vertices only by rounding errors, so a pixel at an edge may change.
    let differing =
        level.hdr.iter().zip(&without.hdr).filter(|(a, b)| a.iter().zip(*b).any(|(x, y)| (x - y).abs() > 1e-3)).count();
    assert!(differing <= 8, "{differing} pixels");
    let moved = bent.hdr.iter().zip(&without.hdr).filter(|(a, b)| a != b).count();
    assert!(moved > 200, "{moved} pixels");
}

#[test]
fn time_moves_sections_and_their_shadows_and_back() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene(0.1);
    scene.wind = Some(WindState { time_s: 0.0 });
    let first = draw(&mut renderer, &scene);
    let shadows = renderer.stats().shadow_renders;
    renderer.set_time(&WindState { time_s: 4.0 });
    let second = look(&mut renderer);
    assert_ne!(first.ldr, second.ldr);
    assert_eq!(renderer.stats().shadow_renders, shadows + 1);
    renderer.set_time(&WindState { time_s: 0.0 });
    assert_eq!(look(&mut renderer).hdr, first.hdr);
    // A scene that is set at the later time gives the same picture as the scene that was moved there.
    scene.wind = Some(WindState { time_s: 4.0 });
    assert_eq!(draw(&mut renderer, &scene).hdr, second.hdr);
}

/// One motion can be stated by any point. The adapter counts from the points that the scene had when it was set.
#[test]
fn a_section_may_state_its_motion_by_another_point_at_each_time() {
    let Some(mut renderer) = renderer() else { return };
    let count = scene(0.0).meshes[0].positions.len();
    let one = |time: f64| {
        let turn = Quat::from_rotation_z(0.1 * time as f32);
        let from = Vec3::new(3.0, -2.0, 1.0) * time as f32;
        SectionMotion { from, to: Vec3::new(1.0, 2.0, 0.5) * time as f32 + turn * from, turn }
    };
    for vertices in [None, Some(0)] {
        let mut scene = scene(0.0);
        scene.sections = Some(SectionAnimation {
            count: 1,
            of_vertices: Arc::new(vec![0; count]),
            turn_normals: true,
            poses: None,
            at: Arc::new(move |time| vec![one(time)]),
        });
        scene.instances[0].carried = Some(SectionBinding { first: 0, vertices });
        scene.wind = Some(WindState { time_s: 0.0 });
        let first = draw(&mut renderer, &scene);
        renderer.set_time(&WindState { time_s: 4.0 });
        let moved = look(&mut renderer);
        scene.wind = Some(WindState { time_s: 4.0 });
        let there = draw(&mut renderer, &scene);
        let off =
            |a: &Picture, b: &Picture| a.hdr.iter().zip(&b.hdr).filter(|(a, b)| (a[1] - b[1]).abs() > 2e-3).count();
        assert!(off(&moved, &first) > 100, "{} pixels moved", off(&moved, &first));
        assert!(off(&moved, &there) <= 8, "{vertices:?}: {} pixels", off(&moved, &there));
    }
}

#[test]
fn sections_without_a_seat_each_are_refused() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene(0.3);
    let count = scene.sections.as_ref().map_or(0, |s| s.count);
    let poses = PoseHierarchy {
        limbs: Vec::new(),
        pieces: Vec::new(),
        seats: Vec::new(),
        closed_form: false,
        amplitudes: Arc::new(|_| Vec::new()),
        turns: None,
    };
    if let Some(sections) = &mut scene.sections {
        sections.poses = Some(Arc::new(poses));
    }
    let said = renderer.set_scene(&scene).expect_err("no seats").to_string();
    assert!(said.contains("seats") && said.contains(&format!("{count}, one for each section")), "{said}");
}

/// In simplified motion, positions are the same, and the light on them is that of a surface that has not turned.
#[test]
fn surfaces_that_do_not_turn_are_lit_as_at_rest() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    let matte = Material::Opaque(OpaqueMaterial { name: "matte".into(), albedo: [0.4, 0.5, 0.6], pattern: None });
    scene.materials[0] = matte;
    (scene.sun, scene.shadow_samples) = (Some(sun(Vec3::Z)), 0);
    let turn = Quat::from_rotation_y(0.6);
    let sections = |turn_normals| SectionAnimation {
        count: 1,
        of_vertices: Arc::new(Vec::new()),
        turn_normals,
        poses: None,
        at: Arc::new(move |_| vec![SectionMotion { from: Vec3::ZERO, to: Vec3::ZERO, turn }]),
    };
    let middle = |picture: &Picture| picture.hdr[20 * 48 + 24][1];
    let rest = middle(&draw(&mut renderer, &scene));
    scene.instances[0].carried = Some(SectionBinding { first: 0, vertices: None });
    scene.sections = Some(sections(true));
    let turned = draw(&mut renderer, &scene);
    scene.sections = Some(sections(false));
    let simplified = draw(&mut renderer, &scene);
    assert!(renderer.stats().pipelines.iter().any(|p| p.contains("sections without turns")));
    // The sun stands over the surface at rest, so that its light falls with the cosine of the turn.
    let (full, simple) = (middle(&turned) / rest, middle(&simplified) / rest);
    assert!((full - 0.6f32.cos()).abs() < 2e-3 && (simple - 1.0).abs() < 2e-3, "{full} {simple}");
    // Both cover the same pixels.
    assert!(turned.hdr.iter().zip(&simplified.hdr).all(|(a, b)| (a[3] > 0.5) == (b[3] > 0.5)));
}

/// Vertices that the shader moves lie where the same rigid motions put them in double precision.
#[test]
fn vertices_follow_their_sections() {
    let Some(mut renderer) = renderer() else { return };
    let scene = scene(0.4);
    renderer.set_scene(&scene).expect("scene");
    let found = renderer.bent_vertices(&scene, 0).expect("vertices");
    let sections = scene.sections.as_ref().expect("sections");
    let (now, mesh) = ((sections.at)(0.0), &scene.meshes[0]);
    for (k, got) in found.iter().enumerate() {
        let section = &now[sections.of_vertices[k] as usize];
        let turn = section.turn.as_dquat();
        let want = section.to.as_dvec3() + turn * (mesh.positions[k] - section.from).as_dvec3();
        assert!(got[0].as_dvec3().distance(want) < 1e-5, "{k}: {got:?}, expected {want}");
        assert!(got[1].as_dvec3().distance(turn * mesh.normals[k].as_dvec3()) < 1e-6, "{k}");
    }
}

#[test]
fn contradictions_are_named() {
    let Some(mut renderer) = renderer() else { return };
    let mut said = |change: &dyn Fn(&mut Scene)| {
        let mut scene = scene(0.1);
        scene.wind = Some(WindState { time_s: 0.0 });
        change(&mut scene);
        renderer.set_scene(&scene).expect_err("a contradiction").to_string()
    };
    let carried = |first, vertices| Some(SectionBinding { first, vertices });
    assert!(said(&|s| s.instances[0].carried = carried(300, None)).contains("instance 0, section"));
    assert!(said(&|s| s.instances[0].carried = carried(0, Some(1))).contains("instance 0, section"));
    assert!(said(&|s| s.sections = None).contains("instance 0, section"));
    assert!(said(&|s| s.wind = Some(WindState { time_s: f64::NAN })).contains("expected a finite time"));
    let short = |s: &mut Scene| s.sections.as_mut().expect("sections").of_vertices = Arc::new(vec![0; 3]);
    assert!(said(&short).contains("instance 0, section"));
}
