//! The adapter chooses what a picture shows, at which level and at which size, as the CPU does; of what moves it culls
//! what is outside the picture.

use crate::common::*;
use glam::{DVec3, Mat4, Quat, Vec3};
use mesophyll_viewer::scene::{
    Camera, DetailLevel, Instance, Scene, SectionAnimation, SectionBinding, SectionMotion, WindState,
};
use mesophyll_viewer::{Options, Renderer};
use std::sync::Arc;

const CELLS: u32 = 4;

/// `count` small sheets with a coarser level, in a ball of 300 mm.
fn crown(count: usize) -> Scene {
    let mut mesh = bent(10.0, CELLS as usize, 0.01);
    // The corners of the sheet, and how far its middle is from their plane.
    let (a, b) = (CELLS, CELLS * (CELLS + 1));
    mesh.details = vec![DetailLevel { indices: vec![0, b, a, a, b, b + CELLS], error: 1.0, outline_only: false }];
    let mut scene = on_mesh(mesh, uniform_leaf());
    let at = |k: usize| {
        let random = |j: f64| ((k as f64 + 0.5) * j).fract() as f32 - 0.5;
        let place = 600.0 * Vec3::new(random(0.819_172_5), random(0.671_043_6), random(0.549_700_5));
        let turn = Quat::from_rotation_z(7.0 * random(0.450_33)) * Quat::from_rotation_y(7.0 * random(0.368_917_2));
        let transform = Mat4::from_scale_rotation_translation(Vec3::splat(1.2 + 0.4 * random(0.3)), turn, place);
        Instance { transform, ..scene.instances[0] }
    };
    scene.instances = (0..count).map(at).collect();
    scene.sun = Some(sun(Vec3::new(0.3, 0.2, 1.0)));
    (scene.shadow_samples, scene.msaa) = (1, 4);
    scene
}

/// A renderer whose adapter chooses, and one whose CPU does; `None` where no adapter chooses.
fn both() -> Option<[Renderer; 2]> {
    let mut by_adapter = renderer()?;
    by_adapter.set_scene(&crown(64)).expect("scene");
    if !by_adapter.stats().pipelines.iter().any(|p| p == "choose") {
        skips::skip(skips::Need::Adapter, "no adapter that chooses");
        return None;
    }
    Some([by_adapter, renderer_with(&Options { plain: true, ..Options::default() })?])
}

/// Cameras that see all, a part with both levels, and fewer and larger sheets.
fn cameras() -> [Camera; 4] {
    let of = |eye: Vec3, target: Vec3, fov: f32| Camera { eye, target, up: Vec3::Z, fov_y_deg: fov };
    [
        of(Vec3::new(0.0, -2500.0, 100.0), Vec3::ZERO, 20.0),
        of(Vec3::new(40.0, -420.0, 0.0), Vec3::new(60.0, 0.0, 30.0), 24.0),
        of(Vec3::new(0.0, -9e3, 2e3), Vec3::ZERO, 20.0),
        of(Vec3::new(0.0, 900.0, 0.0), Vec3::new(0.0, 2000.0, 0.0), 20.0),
    ]
}

#[test]
fn a_still_crown_is_chosen_as_the_cpu_does_and_looks_the_same() {
    let Some([mut adapter, mut cpu]) = both() else { return };
    // More than one work group, and not whole ones.
    let scene = crown(700);
    adapter.set_scene(&scene).expect("scene");
    cpu.set_scene(&scene).expect("scene");
    let (mut levels, mut fewer) = ([0; 2], 0);
    for camera in cameras() {
        let one = adapter.render(&camera, 96, 72).expect("picture");
        let other = cpu.render(&camera, 96, 72).expect("picture");
        let [got, want] = [&adapter, &cpu].map(|r| r.drawn_instances().expect("instances"));
        assert_eq!(got.len(), want.len());
        for (got, want) in got.iter().zip(&want) {
            assert_eq!([got.mesh, got.material, got.level], [want.mesh, want.material, want.level]);
            let (a, b) = (got.rows.as_flattened(), want.rows.as_flattened());
            // A leaf that is about to be left out is small: the difference of two numbers, whose rounding then counts.
            let rounded = if on_gpu(&adapter) { 1e-4 } else { 2e-6 };
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= rounded * b.abs()), "{a:?} {b:?}");
            levels[got.level] += 1;
        }
        fewer += usize::from(!got.is_empty() && got.len() < 500);
        assert_eq!(adapter.stats().triangles, cpu.stats().triangles);
        // Where rows are rounded otherwise, a sample at an edge may fall on its other side.
        let off = one.hdr.iter().zip(&other.hdr).filter(|(a, b)| (0..4).any(|c| (a[c] - b[c]).abs() > 1e-3)).count();
        let same = one.hdr == other.hdr && one.ldr == other.ldr;
        assert!(same || on_gpu(&adapter) && off < one.hdr.len() / 100, "{off} pixels differ");
        // Once more, and in the order in which they were: the same bytes.
        assert!(adapter.render(&camera, 96, 72).expect("picture").hdr == one.hdr);
        assert!(adapter.drawn_instances().expect("instances") == got);
    }
    assert!(levels.iter().all(|n| *n > 15) && fewer >= 2, "{levels:?} {fewer}");
}

/// Each sheet turns about the z axis, by its own speed.
fn motion(k: usize, time: f64) -> SectionMotion {
    let turn = Quat::from_rotation_z((time * (0.4 + 0.01 * (k % 31) as f64)) as f32);
    SectionMotion { from: Vec3::ZERO, to: Vec3::new(0.0, 0.0, 40.0 * (time as f32).sin()), turn }
}

#[test]
fn what_moves_is_culled_where_it_is() {
    let Some([mut adapter, mut cpu]) = both() else { return };
    // So few are never left out.
    let count = 60;
    let mut scene = crown(count);
    for (k, instance) in scene.instances.iter_mut().enumerate() {
        instance.carried = Some(SectionBinding { first: k as u32, vertices: None });
    }
    scene.sections = Some(SectionAnimation {
        count,
        of_vertices: Arc::new(Vec::new()),
        turn_normals: true,
        poses: None,
        at: Arc::new(move |time| (0..count).map(|k| motion(k, time)).collect()),
    });
    scene.wind = Some(WindState { time_s: 0.0 });
    let centre = scene.meshes[0]
        .positions
        .iter()
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p.as_dvec3()), high.max(p.as_dvec3())]);
    let centre = 0.5 * (centre[0] + centre[1]);
    let radius = scene.meshes[0].positions.iter().map(|p| p.as_dvec3().distance(centre)).fold(0.0, f64::max);
    let (mut culled, mut tested) = (0, 0);
    // In full detail, pictures can be compared: at different levels, leaves look slightly different.
    for (time, in_full) in [(0.0, true), (2.0, true), (2.0, false), (5.0, false)] {
        scene.in_full = in_full;
        adapter.set_scene(&scene).expect("scene");
        cpu.set_scene(&scene).expect("scene");
        adapter.set_time(&WindState { time_s: time });
        cpu.set_time(&WindState { time_s: time });
        for camera in cameras() {
            let one = adapter.render(&camera, 96, 72).expect("picture");
            let other = cpu.render(&camera, 96, 72).expect("picture");
            // The CPU culls no leaf that moves.
            let off = one.hdr.iter().zip(&other.hdr).filter(|(a, b)| (a[1] - b[1]).abs() > 2e-3).count();
            assert!(!in_full || off <= 8, "{off} pixels");
            let drawn = adapter.drawn_instances().expect("instances");
            let (eye, target) = (camera.eye.as_dvec3(), camera.target.as_dvec3());
            let ahead = (target - eye).normalize();
            let right = ahead.cross(DVec3::Z).normalize();
            let half = (0.5 * f64::from(camera.fov_y_deg).to_radians()).tan();
            for (k, instance) in scene.instances.iter().enumerate() {
                let section = motion(k, time);
                let rest = instance.transform.as_dmat4();
                let moved = |p: DVec3| section.to.as_dvec3() + section.turn.as_dquat() * rest.transform_point3(p);
                let (origin, at) = (moved(DVec3::ZERO), moved(centre));
                let r = radius * rest.x_axis.truncate().length();
                let to = at - eye;
                // Distances to the planes through the eye and the picture's sides.
                let beyond = |axis: DVec3, half: f64| (to.dot(axis).abs() - half * to.dot(ahead)) / half.hypot(1.0);
                let out = beyond(right, half * 96.0 / 72.0).max(beyond(right.cross(ahead), half)).max(-to.dot(ahead));
                let found = drawn
                    .iter()
                    .find(|i| DVec3::from_array(i.rows.map(|row| f64::from(row[3]))).distance(origin) < 1e-2);
                if (out - r).abs() > 1e-2 {
                    assert_eq!(found.is_some(), out < r, "{time} s, sheet {k}");
                    culled += usize::from(found.is_none());
                    tested += 1;
                }
                // Half a pixel, at the nearest place of the ball.
                let allowed = 0.5 * 2.0 * half / 72.0 * (to.length() - r);
                let error = rest.x_axis.truncate().length();
                if let Some(drawn) = found.filter(|_| !in_full && (allowed / error - 1.0).abs() > 1e-4) {
                    assert_eq!(drawn.level == 1, error <= allowed, "{time} s, sheet {k}");
                }
            }
        }
    }
    assert!(culled > 100 && tested - culled > 100, "{culled} of {tested}");
}
