//! Mapped normals are compared with Lambert's law. They turn with the instance, and normals in the tangent frame also
//! with a bent mesh.

use super::{alone, blade, camera, leaf, sun, uniform};
use glam::{DMat4, DQuat, DVec3};
use mesophyll::transport::lobe::Lobe;
use mesophyll::transport::{NormalFrame, NormalMap, Options, render};
use std::f64::consts::PI;

/// A constant mapped normal on a turned, scaled flat blade follows Lambert's law about the turned normal.
#[test]
fn mapped_normals_turn_with_the_instance() {
    let n = DVec3::new(0.3, -0.2, 0.9).normalize();
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.3, 0.8);
    let l = DVec3::new(0.3, 0.2, 1.0).normalize();
    for (frame, from_back) in [
        (NormalFrame::Blade, false),
        (NormalFrame::Tangent, false),
        (NormalFrame::Blade, true),
        (NormalFrame::Tangent, true),
    ] {
        let mut side = uniform([0.4; 3], [0.2; 3], None);
        side.normal = Some(NormalMap { frame, values: vec![[n.x as f32, n.y as f32, n.z as f32]] });
        let mut world = alone(leaf(blade(300.0, 300.0, 3, 0.0), side.clone(), side, Lobe::Beckmann), sun(l, 0.0), None);
        let flip = if from_back { DQuat::from_rotation_y(PI) } else { DQuat::IDENTITY };
        world.instances[0].transform =
            DMat4::from_scale_rotation_translation(DVec3::splat(1.7), turn * flip, DVec3::ZERO);
        let picture = render(&world, &camera(DVec3::new(5.0, 8.0, 90.0), 3.0), 4, 3, &Options::default()).unwrap();
        // From behind, the image's own frame (x right, y up, z out) is that of the leaf turned over, so the expectation
        // is the same.
        let expected = 3.0 * 0.4 / PI * (turn * n).dot(l);
        for p in &picture.hdr {
            assert!(
                (f64::from(p[0]) / expected - 1.0).abs() < 1e-6,
                "{frame:?} back {from_back}: {} against {expected}",
                p[0]
            );
        }
        // With light from behind, the far side's normal counts.
        world.sun = sun(-l, 0.0);
        let lit = render(&world, &camera(DVec3::new(5.0, 8.0, 90.0), 3.0), 4, 3, &Options::default()).unwrap();
        let far = turn * DVec3::new(-n.x, n.y, -n.z);
        let expected = 3.0 * 0.2 / PI * far.dot(-l);
        assert!((f64::from(lit.hdr[0][0]) / expected - 1.0).abs() < 1e-6, "{frame:?} far side");
    }
}

/// On a bent blade the tangent frame follows the mesh, and the blade's frame does not.
#[test]
fn tangent_normals_follow_a_bent_mesh() {
    let n = DVec3::new(0.25, 0.1, 0.95).normalize();
    let l = DVec3::new(0.2, 0.1, 1.0).normalize();
    let (w, bend) = (100.0, 12.0);
    let mesh = blade(w, 100.0, 256, bend);
    for frame in [NormalFrame::Blade, NormalFrame::Tangent] {
        let mut side = uniform([0.5; 3], [0.0; 3], None);
        side.normal = Some(NormalMap { frame, values: vec![[n.x as f32, n.y as f32, n.z as f32]] });
        let world = alone(leaf(mesh.clone(), side.clone(), side, Lobe::Beckmann), sun(l, 0.0), None);
        // For a camera far away, pixels are almost proportional to x.
        let view = camera(DVec3::Z * 1e5, 0.05);
        let picture = render(&world, &view, 31, 21, &Options::default()).unwrap();
        let pixel = 2.0 * 0.025f64.to_radians().tan() / 21.0 * 1e5;
        for i in 8..23 {
            let x = (i as f64 - 15.0) * pixel;
            let slope = 8.0 * bend * x / (w * w);
            let (t, up) = (DVec3::new(1.0, 0.0, slope).normalize(), DVec3::new(-slope, 0.0, 1.0).normalize());
            let normal = if frame == NormalFrame::Blade { n } else { t * n.x + DVec3::Y * n.y + up * n.z };
            let expected = 3.0 * 0.5 / PI * normal.dot(l);
            let found = f64::from(picture.hdr[10 * 31 + i][0]);
            assert!((found / expected - 1.0).abs() < 2e-3, "{frame:?} at {x}: {found} against {expected}");
        }
    }
}
