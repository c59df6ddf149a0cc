//! Shadow maps that follow what the adapter poses: they are drawn for each picture, with no more texels than it shows.

use crate::common::*;
use glam::{Mat4, Quat, Vec3};
use mesophyll_viewer::scene::{
    AxisPiece, Instance, Material, OpaqueMaterial, PoseHierarchy, PoseLimb, Scene, SectionAnimation, SectionBinding,
    SectionMotion, SectionSeat, WindState,
};
use mesophyll_viewer::{Options, Picture, Renderer};
use std::sync::Arc;

/// A small leaf at the tip of a branch, which sways, above a large leaf that stands still.
fn scene() -> Scene {
    let mut scene = scene_of(uniform_leaf());
    let tip = Vec3::new(0.0, 0.0, 8.0);
    let transform = Mat4::from_scale_rotation_translation(Vec3::splat(0.3), Quat::IDENTITY, tip);
    let carried = Some(SectionBinding { first: 0, vertices: None });
    scene.instances.push(Instance { transform, carried, ..scene.instances[0] });
    scene.sun = Some(sun(Vec3::new(-0.4, 0.3, 1.0)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    (scene.shadow_samples, scene.shadow_resolution) = (2, 256);
    let length = 20.0;
    let poses = PoseHierarchy {
        limbs: vec![PoseLimb {
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
        pieces: vec![AxisPiece { begin: 0.0, place: Vec3::ZERO, way: Vec3::X }],
        seats: vec![SectionSeat { limb: 0, share: 1.0, piece: 0, from: tip, offset: Vec3::ZERO, axis: Vec3::X }],
        closed_form: false,
        amplitudes: Arc::new(|time| vec![[0.5 * time as f32, 0.0]]),
        turns: None,
    };
    scene.sections = Some(SectionAnimation {
        count: 1,
        of_vertices: Arc::new(Vec::new()),
        turn_normals: true,
        poses: Some(Arc::new(poses)),
        at: Arc::new(move |_| vec![SectionMotion { from: tip, to: tip, turn: Quat::IDENTITY }]),
    });
    scene.wind = Some(WindState { time_s: 0.0 });
    scene
}

/// From 100 mm, a pixel is several texels wide; from 20 mm it is narrower than one.
fn look(renderer: &mut Renderer, distance: f32) -> Picture {
    renderer.render(&camera(Vec3::new(0.5, -0.6, 0.9), distance), 64, 64).expect("picture")
}

/// How many pixels differ by more than 5 %.
fn differing(a: &Picture, b: &Picture) -> usize {
    a.hdr.iter().zip(&b.hdr).filter(|(p, q)| (p[1] - q[1]).abs() > 0.05 * p[1].max(q[1])).count()
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
            renderer.set_time(&WindState { time_s });
            look(&mut renderer, distance)
        };
        let [coarse, fine, unshaded] = [&scene, &full, &lit].map(|scene| draw(scene, 100.0));
        // The shadow is some hundred pixels, and only its edge is drawn otherwise.
        let (shaded, off) = (differing(&fine, &unshaded), differing(&coarse, &fine));
        assert!(shaded > 80 && off > 0 && 4 * off < shaded, "{off} of {shaded} pixels");
        // From near, all texels are used.
        assert!(draw(&scene, 20.0).hdr == draw(&full, 20.0).hdr, "{time_s} s");
    }
}

/// The same above a floor that is much larger than what casts shadows, and casts none.
fn above_floor() -> Scene {
    let mut scene = scene();
    let grey = Material::Opaque(OpaqueMaterial { name: "floor".into(), albedo: [0.3, 0.3, 0.3], pattern: None });
    let floor = scene.add(square(100.0), grey);
    scene.instances.push(Instance { transform: Mat4::from_translation(-Vec3::Z), floor: true, ..floor });
    scene
}

/// What lies beside coarse maps is in no shadow: neither where nothing was ever drawn into their texture, nor where
/// finer maps were.
#[test]
fn beside_the_maps_nothing_is_shaded() {
    let scene = above_floor();
    let picture = |scene: &Scene, distances: &[f32]| {
        let mut renderer = renderer()?;
        renderer.set_scene(scene).expect("scene");
        renderer.set_time(&WindState { time_s: 1.0 });
        let last = distances.iter().map(|d| look(&mut renderer, *d)).last();
        Some((last.expect("picture"), renderer.stats().shadow_side))
    };
    let Some((coarse, side)) = picture(&scene, &[100.0]) else { return };
    let Some((full, all)) = picture(&Scene { in_full: true, ..scene.clone() }, &[100.0]) else { return };
    let Some((lit, _)) = picture(&Scene { shadow_samples: 0, ..scene.clone() }, &[100.0]) else { return };
    let Some((later, _)) = picture(&scene, &[20.0, 100.0]) else { return };
    assert!(2 * side <= all, "{side} of {all} texels");
    let (shaded, off) = (differing(&full, &lit), differing(&coarse, &full));
    // Only edges of shadows are drawn otherwise. The floor is most of the 4,096 pixels.
    assert!(shaded > 80 && 2 * off < shaded, "{off} of {shaded} pixels");
    assert!(later.hdr == coarse.hdr);
}

/// A frame shows the pose of the time that was set last, whether it is posed at once or with the frame.
#[test]
fn a_frame_shows_the_time_that_was_set_last() {
    let scene = above_floor();
    let mut shown = Vec::new();
    for groups in [false, true] {
        let options = Options { groups: Some(groups), ..Options::default() };
        let Some(mut renderer) = renderer_with(&options) else { return };
        renderer.set_scene(&scene).expect("scene");
        let mut at = |times: &[f64]| {
            times.iter().for_each(|t| renderer.set_time(&WindState { time_s: *t }));
            (look(&mut renderer, 100.0), renderer.drawn_instances().expect("instances"))
        };
        // Without a time, that of the scene.
        shown.push([at(&[]), at(&[1.0]), at(&[3.0, 2.0]), at(&[])]);
    }
    let few = shown[0][0].0.hdr.len() / 100;
    for both in &shown {
        assert!(differing(&both[0].0, &both[1].0) > 4 * few && differing(&both[1].0, &both[2].0) > 4 * few);
        assert!(both[2].0.hdr == both[3].0.hdr);
    }
    for (alone, group) in shown[0].iter().zip(&shown[1]) {
        assert!(differing(&alone.0, &group.0) < few);
        assert_eq!(alone.1.len(), group.1.len());
        for (one, other) in alone.1.iter().zip(&group.1) {
            let same = [one.mesh, one.material, one.level] == [other.mesh, other.material, other.level];
            let near = one.rows.as_flattened().iter().zip(other.rows.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-4);
            assert!(same && near, "{one:?} {other:?}");
        }
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
