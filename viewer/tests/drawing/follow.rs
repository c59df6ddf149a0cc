//! Shadow maps that follow what the adapter poses: they are drawn for each picture, with no more texels than it shows.

use crate::common::*;
use glam::{Mat4, Quat, Vec3};
use mesophyll_viewer::scene::{Carried, Instance, Limb, Piece, Poses, Scene, Seat, Section, Sections, Wind};
use mesophyll_viewer::{Picture, Renderer};
use std::sync::Arc;

/// A small leaf at the tip of a branch, which sways, above a large leaf that stands still.
fn scene() -> Scene {
    let mut scene = scene_of(uniform_leaf());
    let tip = Vec3::new(0.0, 0.0, 8.0);
    let transform = Mat4::from_scale_rotation_translation(Vec3::splat(0.3), Quat::IDENTITY, tip);
    let carried = Some(Carried { first: 0, vertices: None });
    scene.instances.push(Instance { transform, carried, ..scene.instances[0] });
    scene.sun = Some(sun(Vec3::new(-0.4, 0.3, 1.0)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    (scene.shadow_samples, scene.shadow_resolution) = (2, 256);
    let length = 20.0;
    let poses = Poses {
        limbs: vec![Limb {
            root: tip - length * Vec3::X,
            axes: [Vec3::X, Vec3::Y],
            length,
            taper: [0.5, 0.5f32.ln(), 2.0 * 2f32.ln()],
            coefficients: [0.5, -0.1, 0.02, 0.0],
            parent: None,
            at: (0.0, 0),
            offset: Vec3::ZERO,
            pieces: [0, 1],
        }],
        pieces: vec![Piece { begin: 0.0, place: Vec3::ZERO, way: Vec3::X }],
        seats: vec![Seat { limb: 0, share: 1.0, piece: 0, from: tip, offset: Vec3::ZERO, axis: Vec3::X }],
        closed_form: false,
        amplitudes: Arc::new(|time| vec![[0.5 * time as f32, 0.0]]),
        turns: None,
    };
    scene.sections = Some(Sections {
        count: 1,
        of_vertices: Arc::new(Vec::new()),
        turn_normals: true,
        poses: Some(Arc::new(poses)),
        at: Arc::new(move |_| vec![Section { from: tip, to: tip, turn: Quat::IDENTITY }]),
    });
    scene.wind = Some(Wind { time_s: 0.0 });
    scene
}

/// From 100 mm, a pixel is several texels wide; from 20 mm it is narrower than one.
fn look(renderer: &mut Renderer, distance: f32) -> Picture {
    renderer.render(&camera(Vec3::new(0.5, -0.6, 0.9), distance), 64, 64).expect("picture")
}

#[test]
fn far_pictures_have_coarser_maps_with_the_same_shadows() {
    let Some(mut renderer) = renderer() else { return };
    let scene = scene();
    let lit = Scene { shadow_samples: 0, ..scene.clone() };
    let full = Scene { in_full: true, ..scene.clone() };
    for time_s in [0.0, 1.0] {
        let mut draw = |scene: &Scene, distance: f32| {
            renderer.set_scene(scene).expect("scene");
            renderer.set_time(&Wind { time_s });
            look(&mut renderer, distance)
        };
        let [coarse, fine, unshaded] = [&scene, &full, &lit].map(|scene| draw(scene, 100.0));
        let differing = |a: &Picture, b: &Picture| {
            a.hdr.iter().zip(&b.hdr).filter(|(p, q)| (p[1] - q[1]).abs() > 0.05 * p[1].max(q[1])).count()
        };
        // The shadow is some hundred pixels, and only its edge is drawn otherwise.
        let (shaded, off) = (differing(&fine, &unshaded), differing(&coarse, &fine));
        assert!(shaded > 80 && off > 0 && 4 * off < shaded, "{off} of {shaded} pixels");
        // From near, all texels are used.
        assert!(draw(&scene, 20.0).hdr == draw(&full, 20.0).hdr, "{time_s} s");
    }
}

#[test]
fn a_picture_does_not_depend_on_what_was_drawn_before() {
    let Some(mut renderer) = renderer() else { return };
    renderer.set_scene(&scene()).expect("scene");
    let far = look(&mut renderer, 100.0);
    let side = renderer.stats().shadow_side;
    let near = look(&mut renderer, 20.0);
    assert_eq!(renderer.stats().shadow_side, scene().shadow_resolution);
    assert!(2 * side <= scene().shadow_resolution, "{side} texels from far");
    let drawn = renderer.stats().shadow_renders;
    // The maps are drawn again where the picture needs other ones, and only there.
    assert!(look(&mut renderer, 100.0).hdr == far.hdr && look(&mut renderer, 100.0).hdr == far.hdr);
    assert_eq!(renderer.stats().shadow_renders, drawn + 1);
    assert!(look(&mut renderer, 20.0).hdr == near.hdr);
    assert_eq!(renderer.stats().shadow_renders, drawn + 2);
}
