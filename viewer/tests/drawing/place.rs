//! Leaves that sections carry as wholes: compute passes move each once, instead of each of its vertices in each pass.

use crate::common::*;
use glam::{DMat3, DMat4, Mat4, Quat, Vec3};
use mesophyll_viewer::scene::{Instance, Scene, SectionAnimation, SectionBinding, SectionMotion, WindState};
use mesophyll_viewer::{Options, Picture};
use std::sync::Arc;

/// The motions of `count` sections. Each turns about a point of its own.
fn motions(count: usize, time: f64) -> Vec<SectionMotion> {
    let one = |k: usize| {
        let k = k as f32;
        let axis = Vec3::new((1.3 * k).sin(), (2.1 * k).cos(), 0.4).normalize();
        let from = Vec3::new(7.0 * k - 20.0, 3.0, -2.0);
        let turn = Quat::from_axis_angle(axis, 0.7 * (0.9 * k + time as f32).sin());
        SectionMotion { from, to: from + Vec3::new(0.5, 2.0, 1.0) * (time as f32 + 0.2 * k).cos(), turn }
    };
    (0..count).map(one).collect()
}

/// Bent leaves above and beside each other that shade each other; the last one stands still.
fn scene(time: f64) -> Scene {
    let mut scene = on_mesh(bent(6.0, 6, 0.02), uniform_leaf());
    let at = |k: usize| {
        let turn = Quat::from_rotation_y(0.4 * k as f32) * Quat::from_rotation_z(0.9 * k as f32);
        let place = Vec3::new(9.0 * (k % 4) as f32 - 14.0, 9.0 * (k / 4) as f32 - 5.0, 3.0 * (k % 3) as f32);
        let carried = (k < 7).then_some(SectionBinding { first: k as u32, vertices: None });
        let transform = Mat4::from_scale_rotation_translation(Vec3::splat(1.0 + 0.05 * k as f32), turn, place);
        Instance { transform, carried, ..scene.instances[0] }
    };
    scene.instances = (0..8).map(at).collect();
    scene.sun = Some(sun(Vec3::new(0.3, 0.2, 1.0)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    (scene.shadow_samples, scene.msaa) = (2, 4);
    scene.sections = Some(SectionAnimation {
        count: 7,
        of_vertices: Arc::new(Vec::new()),
        turn_normals: true,
        poses: None,
        at: Arc::new(|time| motions(7, time)),
    });
    scene.wind = Some(WindState { time_s: time });
    scene
}

/// The same leaves, moved in double precision and then handed over as leaves that stand still.
fn moved(time: f64) -> Scene {
    let mut scene = scene(time);
    let sections = motions(7, time);
    for instance in &mut scene.instances {
        let Some(by) = instance.carried.take() else { continue };
        let section = &sections[by.first as usize];
        let turn = section.turn.as_dquat();
        let (rest, from, to) = (instance.transform.as_dmat4(), section.from.as_dvec3(), section.to.as_dvec3());
        let rows = DMat3::from_quat(turn) * DMat3::from_mat4(rest);
        let place = to + turn * (rest.w_axis.truncate() - from);
        instance.transform = (DMat4::from_translation(place) * DMat4::from_mat3(rows)).as_mat4();
    }
    (scene.sections, scene.wind) = (None, None);
    scene
}

/// Largest and mean difference of two pictures (green).
fn apart(a: &Picture, b: &Picture) -> (f32, f32) {
    let each: Vec<f32> = a.hdr.iter().zip(&b.hdr).map(|(a, b)| (a[1] - b[1]).abs()).collect();
    (each.iter().fold(0.0, |m, d| d.max(m)), each.iter().sum::<f32>() / each.len() as f32)
}

#[test]
fn leaves_that_move_as_wholes_look_as_leaves_that_were_moved() {
    let Some(mut renderer) = renderer() else { return };
    let Some(mut plain) = renderer_with(&Options { plain: true, ..Options::default() }) else { return };
    let camera = camera(Vec3::new(0.2, -0.5, 1.0), 150.0);
    renderer.set_scene(&scene(0.0)).expect("scene");
    plain.set_scene(&scene(0.0)).expect("scene");
    let named = |of: &[String], part: &str| of.iter().any(|p| p.contains(part));
    let (with, without) = (renderer.stats().pipelines.clone(), plain.stats().pipelines.clone());
    assert!(named(&with, "place") && !named(&with, "sections") && !named(&with, "bend"), "{with:?}");
    assert!(!named(&without, "place") && named(&without, "sections") && named(&without, "bend"), "{without:?}");
    let first = renderer.render(&camera, 96, 72).expect("picture");
    let wind = WindState { time_s: 1.3 };
    renderer.set_time(&wind);
    plain.set_time(&wind);
    let once = renderer.render(&camera, 96, 72).expect("picture");
    let each = plain.render(&camera, 96, 72).expect("picture");
    plain.set_scene(&moved(1.3)).expect("scene");
    let truth = plain.render(&camera, 96, 72).expect("picture");
    let off = |other: &Picture, most: f32| {
        once.hdr.iter().zip(&other.hdr).filter(|(a, b)| (a[1] - b[1]).abs() > most).count()
    };
    assert!(off(&first, 0.02) > 200, "{} pixels moved", off(&first, 0.02));
    let covered = once.hdr.iter().filter(|p| p[3] > 0.5).count();
    assert!(covered > 300, "{covered} pixels covered");
    // Rounding may decide otherwise at one of the four samples of a pixel's edge or in one of the texels that a shadow
    // map's filter reads. No more than that, and in few pixels.
    for (name, other) in [("vertex by vertex", &each), ("double precision", &truth)] {
        let (most, mean) = apart(&once, other);
        println!("{name}: largest difference {most:.2e}, mean {mean:.2e}");
        let off = off(other, 2e-3);
        assert!(mean < 1e-3 && off < 20, "{name}: {mean} {off}");
    }
}
