//! Motion vectors agree with triangles that are projected twice in double precision.

use crate::common::*;
use glam::{DQuat, DVec3, Quat, Vec3};
use mesophyll_viewer::Renderer;
use mesophyll_viewer::scene::{Camera, Scene, SectionAnimation, SectionBinding, SectionMotion, WindState};
use std::sync::Arc;

const SIZE: [u32; 2] = [64, 48];

/// The axes of a pinhole camera: right, up and ahead. The first two are divided by the tangent of half the picture's
/// angle.
fn axes(camera: &Camera) -> [DVec3; 3] {
    let ahead = (camera.target - camera.eye).as_dvec3().normalize();
    let right = ahead.cross(camera.up.as_dvec3()).normalize();
    let tangent = (0.5 * f64::from(camera.fov_y_deg).to_radians()).tan();
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    [right / (tangent * aspect), right.cross(ahead) / tangent, ahead]
}

/// The place of a point in the picture, in pixels from the top left corner.
fn seen(camera: &Camera, point: DVec3) -> [f64; 2] {
    let [right, up, ahead] = axes(camera);
    let d = point - camera.eye.as_dvec3();
    let depth = d.dot(ahead);
    let [w, h] = SIZE.map(f64::from);
    [0.5 * w * (1.0 + d.dot(right) / depth), 0.5 * h * (1.0 - d.dot(up) / depth)]
}

/// The vector of a pixel, from the triangle that its centre hits first and the earlier place of the same point on it.
/// Also returns the smallest barycentric coordinate there, which tells how near an edge is.
fn expected(
    corners: &[[DVec3; 2]],
    triangles: &[u32],
    cameras: [&Camera; 2],
    pixel: [u32; 2],
) -> Option<([f64; 2], f64)> {
    let [right, up, ahead] = axes(cameras[0]);
    let at = [0, 1].map(|k: usize| f64::from(pixel[k]) + 0.5);
    let [w, h] = SIZE.map(f64::from);
    let (x, y) = (2.0 * at[0] / w - 1.0, 1.0 - 2.0 * at[1] / h);
    let direction = ahead + x * right / right.length_squared() + y * up / up.length_squared();
    let eye = cameras[0].eye.as_dvec3();
    let mut best: Option<(f64, DVec3, f64)> = None;
    for t in triangles.as_chunks::<3>().0 {
        let [a, b, c] = t.map(|k| corners[k as usize]);
        let system = glam::DMat3::from_cols(b[0] - a[0], c[0] - a[0], -direction);
        let s = system.inverse() * (eye - a[0]);
        let least = s.x.min(s.y).min(1.0 - s.x - s.y);
        if least >= 0.0 && s.z > 0.0 && best.is_none_or(|(z, ..)| s.z < z) {
            best = Some((s.z, a[1] + s.x * (b[1] - a[1]) + s.y * (c[1] - a[1]), least));
        }
    }
    let (_, before, least) = best?;
    let before = seen(cameras[1], before);
    Some(([0, 1].map(|k| at[k] - before[k]), least))
}

/// Draws the vectors and compares them with triangles whose corners are known at both times. Returns the longest
/// vector.
fn compare(
    renderer: &mut Renderer,
    scene: &Scene,
    before: Option<&WindState>,
    corners: &[[DVec3; 2]],
    cameras: [&Camera; 2],
) -> f64 {
    let [width, height] = SIZE;
    let found = renderer.motion(scene, cameras[0], cameras[1], before, width, height).expect("vectors");
    // In single precision, a place in a picture of 64 pixels that is computed twice is accurate to about 1e-5 of a
    // pixel.
    let most = held(renderer, 1e-5) * 100.0;
    let (mut covered, mut longest) = (0, 0.0f64);
    for y in 0..height {
        for x in 0..width {
            let got = found[(y * width + x) as usize];
            match expected(corners, &scene.meshes[0].indices, cameras, [x, y]) {
                Some((want, least)) if least > 1e-3 => {
                    let got = got.unwrap_or_else(|| panic!("nothing at {x} {y}"));
                    let off = [0, 1].map(|k| (f64::from(got[k]) - want[k]).abs()).into_iter().fold(0.0, f64::max);
                    assert!(off < most, "{x} {y}: {got:?}, expected {want:?}");
                    (covered, longest) = (covered + 1, longest.max(want[0].hypot(want[1])));
                }
                Some(_) => {}
                // On a shared edge, rounding may choose either triangle; at the rim it may choose none.
                None => assert!(got.is_none() || corners.len() > 4, "something at {x} {y}"),
            }
        }
    }
    assert!(covered > 400, "{covered} pixels");
    longest
}

fn time(time_s: f64) -> WindState {
    WindState { time_s }
}

#[test]
fn a_carried_leaf_has_the_vectors_of_its_rigid_motion_and_of_the_camera() {
    let Some(mut renderer) = renderer() else { return };
    let axis = DVec3::new(0.3, 1.0, -0.2).normalize();
    let turn = move |t: f64| DQuat::from_axis_angle(axis, 0.5 * t);
    let to = |t: f64| DVec3::new(2.0 * t, -1.0 + t, 3.0 * t * t);
    let mut scene = scene_of(uniform_leaf());
    scene.meshes[0] = square(10.0);
    scene.instances[0].carried = Some(SectionBinding { first: 0, vertices: None });
    scene.sections = Some(SectionAnimation {
        count: 1,
        of_vertices: Arc::new(Vec::new()),
        turn_normals: true,
        poses: None,
        at: Arc::new(move |t| {
            let q = turn(t);
            let turn = Quat::from_xyzw(q.x as f32, q.y as f32, q.z as f32, q.w as f32);
            vec![SectionMotion { from: Vec3::ZERO, to: to(t).as_vec3(), turn }]
        }),
    });
    scene.wind = Some(time(1.0));
    renderer.set_scene(&scene).expect("scene");
    let (now, earlier) = (camera(Vec3::new(0.5, -0.6, 0.9), 60.0), camera(Vec3::new(0.3, -0.7, 1.0), 70.0));
    renderer.render(&now, SIZE[0], SIZE[1]).expect("picture");
    assert!(renderer.stats().pipelines.iter().all(|p| !p.starts_with("motion")), "made though nobody asked");
    let corners: Vec<[DVec3; 2]> =
        scene.meshes[0].positions.iter().map(|p| [1.0, 0.7].map(|t| to(t) + turn(t) * p.as_dvec3())).collect();
    let longest = compare(&mut renderer, &scene, Some(&time(0.7)), &corners, [&now, &earlier]);
    assert!(longest > 5.0, "{longest}");
    assert!(renderer.stats().pipelines.iter().any(|p| p == "motion, bend"), "{:?}", renderer.stats().pipelines);
    // The pass is used again for other times. With a still camera and equal times nothing moves.
    let same: Vec<[DVec3; 2]> = corners.iter().map(|[p, _]| [*p; 2]).collect();
    assert_eq!(compare(&mut renderer, &scene, Some(&time(1.0)), &same, [&now, &now]).max(1e-9), 1e-9);
}

#[test]
fn a_mesh_that_bends_has_the_vectors_of_its_vertices() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    scene.meshes[0] = bent(10.0, 12, -0.01);
    scene.sections = Some(swinging(&scene.meshes[0], 0.1));
    scene.instances[0].carried = Some(SectionBinding { first: 0, vertices: Some(0) });
    scene.wind = Some(time(4.0));
    renderer.set_scene(&scene).expect("scene");
    let mut at = |t: f64| {
        renderer.set_time(&time(t));
        renderer.bent_vertices(&scene, 0).expect("vertices")
    };
    // The time of the picture is the one that was set last.
    let (before, now) = (at(3.0), at(4.0));
    let corners: Vec<[DVec3; 2]> = now.iter().zip(&before).map(|(n, b)| [n[0].as_dvec3(), b[0].as_dvec3()]).collect();
    let look = camera(Vec3::new(0.5, -0.6, 0.9), 60.0);
    let longest = compare(&mut renderer, &scene, Some(&time(3.0)), &corners, [&look, &look]);
    assert!(longest > 1.0, "{longest}");
}
