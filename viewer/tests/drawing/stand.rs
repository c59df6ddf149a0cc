//! Plants that stand in many places and are stored once. They must look as the same instances one by one.

use crate::common::*;
use glam::{Mat4, Quat, Vec3};
use mesophyll_viewer::Picture;
use mesophyll_viewer::scene::{
    Camera, Instance, PlantStand, Scene, SectionAnimation, SectionBinding, SectionMotion, StandPlace, WindState,
};
use std::sync::Arc;

const PLACES: usize = 12;
/// Leaves of a plant, few enough for all of them to be drawn.
const LEAVES: usize = 20;

fn places() -> Vec<StandPlace> {
    let one = |k: usize| {
        let turn = Quat::from_rotation_z(0.7 * k as f32) * Quat::from_rotation_x(0.1);
        let at = Vec3::new(60.0 * (k % 4) as f32 - 90.0, 70.0 * (k / 4) as f32, 3.0 * k as f32);
        let transform = Mat4::from_scale_rotation_translation(Vec3::splat(0.6 + 0.05 * k as f32), turn, at);
        StandPlace { transform, pose: (k % 2) as u32 }
    };
    (0..PLACES).map(one).collect()
}

/// A leaf in its plant's frame.
fn leaf(k: usize) -> Mat4 {
    let turn = Quat::from_rotation_z(2.4 * k as f32) * Quat::from_rotation_y(0.3 + 0.1 * k as f32);
    Mat4::from_scale_rotation_translation(Vec3::splat(0.5), turn, turn * Vec3::X * 9.0 + 2.0 * k as f32 * Vec3::Z)
}

/// How section `k` of a pose moves in its plant's frame.
fn motion(pose: usize, k: usize, time: f32) -> SectionMotion {
    let from = leaf(k).w_axis.truncate();
    let angle = (0.2 + 0.3 * pose as f32) * (time + 0.2 * k as f32).sin();
    SectionMotion {
        from,
        to: from + Vec3::new(4.0 * angle, 1.0, 2.0 * pose as f32),
        turn: Quat::from_rotation_y(angle),
    }
}

/// The world's motion of a section of the plant at a place.
fn in_world(place: &StandPlace, own: SectionMotion) -> SectionMotion {
    let (_, turn, _) = place.transform.to_scale_rotation_translation();
    let at = |p: Vec3| place.transform.transform_point3(p);
    SectionMotion { from: at(own.from), to: at(own.to), turn: turn * own.turn * turn.inverse() }
}

/// The scene as a stand, or with all instances one by one. With `moves`, sections carry them.
fn scene(stand: bool, moves: bool) -> Scene {
    let mut scene = scene_of(uniform_leaf());
    scene.sun = Some(sun(Vec3::new(0.4, -0.5, 0.8)));
    (scene.shadow_samples, scene.shadow_resolution, scene.msaa) = (2, 512, 4);
    let one = scene.instances[0];
    let carried = |k: usize| moves.then_some(SectionBinding { first: k as u32, vertices: None });
    let places = places();
    let sections = |count: usize, at: Arc<dyn Fn(f64) -> Vec<SectionMotion> + Send + Sync>| SectionAnimation {
        count,
        of_vertices: Arc::default(),
        turn_normals: true,
        at,
        poses: None,
    };
    if stand {
        let of = |k: usize| Instance { transform: leaf(k), carried: carried(k), stand: Some(0), ..one };
        scene.instances = (0..LEAVES).map(of).collect();
        let own = if moves { LEAVES as u32 } else { 0 };
        scene.stands = vec![Arc::new(PlantStand { places, first: 0, sections: own, poses: 2 })];
        let both = |time: f64| (0..2 * LEAVES).map(|k| motion(k / LEAVES, k % LEAVES, time as f32)).collect();
        scene.sections = moves.then(|| sections(2 * LEAVES, Arc::new(both)));
    } else {
        let of = |k: usize| {
            let place = &places[k / LEAVES];
            Instance { transform: place.transform * leaf(k % LEAVES), carried: carried(k), ..one }
        };
        scene.instances = (0..PLACES * LEAVES).map(of).collect();
        let all = move |time: f64| {
            let one = |k: usize| {
                let place = &places[k / LEAVES];
                in_world(place, motion(place.pose as usize, k % LEAVES, time as f32))
            };
            (0..PLACES * LEAVES).map(one).collect()
        };
        scene.sections = moves.then(|| sections(PLACES * LEAVES, Arc::new(all)));
    }
    scene.wind = moves.then_some(WindState { time_s: 0.4 });
    // One by one, leaves that are many would be thinned.
    scene.in_full = true;
    scene
}

fn view() -> Camera {
    Camera { eye: Vec3::new(-40.0, -330.0, 150.0), target: Vec3::new(0.0, 60.0, 25.0), up: Vec3::Z, fov_y_deg: 24.0 }
}

/// The largest difference of radiance over its scale, and the share of pixels that differ by more than a hundredth.
fn apart(a: &Picture, b: &Picture) -> (f32, f64) {
    let differ = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
    let all: Vec<f32> = a.hdr.iter().zip(&b.hdr).map(differ).collect();
    let many = all.iter().filter(|d| **d > 0.01).count();
    (all.iter().copied().fold(0.0, f32::max), many as f64 / all.len() as f64)
}

#[test]
fn plants_of_a_stand_look_as_one_by_one() {
    let Some(mut renderer) = renderer() else { return };
    for (moves, shadows) in [(false, 0), (true, 0), (false, 2), (true, 2)] {
        let mut draw = |stand: bool, time: f64| {
            let mut scene = scene(stand, moves);
            scene.shadow_samples = shadows;
            renderer.set_scene(&scene).unwrap();
            if let Some(wind) = &mut scene.wind {
                wind.time_s = time;
                renderer.set_time(wind);
            }
            renderer.render(&view(), 320, 240).unwrap()
        };
        let (stand, alone) = (draw(true, 1.3), draw(false, 1.3));
        let covered = alone.hdr.iter().filter(|p| p[1] > 0.0).count();
        assert!(covered > 320 * 240 / 20, "{covered}");
        // Places are rounded differently. Shadow maps cover boxes around the plants, so their texels are larger, and
        // penumbras differ.
        let (_, share) = apart(&stand, &alone);
        let most = if shadows == 0 { 2e-4 } else { 1e-2 };
        assert!(share < most, "moves {moves}, shadows {shadows}: {share}");
        let mean = |p: &Picture| p.hdr.iter().map(|t| f64::from(t[1])).sum::<f64>();
        let most = if shadows == 0 { 1e-4 } else { 2e-2 };
        assert!((mean(&stand) / mean(&alone) - 1.0).abs() < most, "{} {}", mean(&stand), mean(&alone));
        if moves {
            let (_, share) = apart(&stand, &draw(true, 2.9));
            assert!(share > 0.02, "{share}");
        }
    }
}

/// 250 m from the origin places are rounded to a 64th of a millimetre, less than a fiftieth of a pixel here.
#[test]
fn plants_far_from_the_origin_look_as_one_by_one() {
    let Some(mut renderer) = renderer() else { return };
    let origin = 2.5e5 * Vec3::X;
    let place = |k: usize| {
        let at = origin + 60.0 * Vec3::new((k % 6) as f32 - 2.5, (k / 6) as f32 - 2.5, 0.0);
        StandPlace { transform: Mat4::from_rotation_translation(Quat::from_rotation_z(2.4 * k as f32), at), pose: 0 }
    };
    let leaf = |k: usize| {
        let turn = Quat::from_rotation_z(2.4 * k as f32) * Quat::from_rotation_y(0.2 + 0.01 * k as f32);
        Mat4::from_rotation_translation(turn, turn * Vec3::X * 12.0 + 0.25 * k as f32 * Vec3::Z)
    };
    let places: Vec<StandPlace> = (0..36).map(place).collect();
    let mut draw = |stand: bool| {
        let mut scene = scene_of(uniform_leaf());
        scene.meshes = vec![square(5.0)];
        (scene.sun, scene.sky, scene.msaa) = (Some(sun(Vec3::new(0.48, -0.6, 0.64))), Some([1.0; 3]), 4);
        let one = scene.instances[0];
        if stand {
            scene.instances = (0..40).map(|k| Instance { transform: leaf(k), stand: Some(0), ..one }).collect();
            scene.stands = vec![Arc::new(PlantStand { places: places.clone(), first: 0, sections: 0, poses: 1 })];
        } else {
            let all = places.iter().flat_map(|place| (0..40).map(|k| place.transform * leaf(k)));
            scene.instances = all.map(|transform| Instance { transform, ..one }).collect();
        }
        renderer.set_scene(&scene).unwrap();
        let target = origin + 40.0 * Vec3::Z;
        let eye = target - 300.0 * Vec3::new(0.1, 1.0, -0.2).normalize();
        renderer.render(&Camera { eye, target, up: Vec3::Z, fov_y_deg: 40.0 }, 320, 240).unwrap()
    };
    let (stand, alone) = (draw(true), draw(false));
    let covered = alone.hdr.iter().filter(|p| p[3] > 0.0).count();
    let (_, share) = apart(&stand, &alone);
    println!("{covered} pixels are covered, {share:.5} of all differ");
    assert!(covered > 5000 && share < 1e-3, "{covered} {share}");
}

/// Vectors of a plant that moves are those of the same leaves one by one.
#[test]
fn plants_of_a_stand_have_motion_vectors() {
    let Some(mut renderer) = renderer() else { return };
    let mut vectors = |stand: bool| {
        let scene = scene(stand, true);
        renderer.set_scene(&scene).unwrap();
        let before = WindState { time_s: -0.6 };
        renderer.motion(&scene, &view(), &view(), Some(&before), 160, 120).unwrap()
    };
    let (stand, alone) = (vectors(true), vectors(false));
    let both: Vec<([f32; 2], [f32; 2])> = stand.iter().zip(&alone).filter_map(|(a, b)| Some(((*a)?, (*b)?))).collect();
    assert!(both.len() > 900 && both.iter().any(|(a, _)| a[0].abs() > 0.5), "{}", both.len());
    let off = both.iter().filter(|(a, b)| (a[0] - b[0]).abs() > 0.02 || (a[1] - b[1]).abs() > 0.02).count();
    assert!(off * 100 < both.len(), "{off}");
}

/// What is outside the view is not drawn, and far away fewer leaves are.
#[test]
fn only_what_a_picture_needs_is_drawn() {
    let Some(mut renderer) = renderer() else { return };
    let many = |spacing: f32| {
        let mut scene = scene(true, false);
        scene.in_full = false;
        let one = scene.instances[0];
        let leaves = (0..400).map(|k| Instance { transform: leaf(k % 50), ..one });
        scene.instances = leaves.collect();
        let place = |k: usize| StandPlace {
            transform: Mat4::from_translation(Vec3::new(spacing * k as f32, 0.0, 0.0)),
            pose: 0,
        };
        scene.stands =
            vec![Arc::new(PlantStand { places: (0..9).map(place).collect(), first: 0, sections: 0, poses: 1 })];
        scene
    };
    let look = |eye: Vec3, target: Vec3| Camera { eye, target, up: Vec3::Z, fov_y_deg: 40.0 };
    let mut triangles = |scene: &Scene, camera: &Camera| {
        renderer.set_scene(scene).unwrap();
        renderer.render(camera, 160, 120).unwrap();
        renderer.stats().triangles
    };
    let scene = many(1e4);
    let near = look(Vec3::new(0.0, -150.0, 50.0), Vec3::new(0.0, 0.0, 50.0));
    assert_eq!(triangles(&scene, &near), 2 * 400);
    assert_eq!(triangles(&scene, &look(Vec3::new(0.0, -150.0, 50.0), Vec3::new(0.0, -300.0, 50.0))), 0);
    let far = look(Vec3::new(400.0, -3e4, 50.0), Vec3::new(400.0, 0.0, 50.0));
    let drawn = triangles(&many(100.0), &far);
    assert!(drawn > 0 && drawn < 2 * 400, "{drawn}");
}

#[test]
fn stands_that_contradict_themselves_are_refused() {
    let Some(mut renderer) = renderer() else { return };
    let changed = |change: &dyn Fn(&mut Scene, &mut PlantStand)| {
        let mut scene = scene(true, true);
        let mut stand = (*scene.stands[0]).clone();
        change(&mut scene, &mut stand);
        scene.stands = vec![Arc::new(stand)];
        scene
    };
    type Change<'a> = &'a dyn Fn(&mut Scene, &mut PlantStand);
    let cases: [(Change<'_>, &str); 5] = [
        (&|s, _| s.instances[3].stand = Some(1), "instance 3, stand"),
        (&|_, s| s.places[2].pose = 2, "stand 0, place 2, pose"),
        (&|_, s| s.poses = 3, "stand 0, poses"),
        (&|_, s| s.places[4].transform.x_axis.x = f32::NAN, "stand 0, place 4, transform"),
        (&|s, _| s.instances[5].carried = Some(SectionBinding { first: 30, vertices: None }), "instance 5, section"),
    ];
    for (change, expected) in cases {
        let error = renderer.set_scene(&changed(change)).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
}
