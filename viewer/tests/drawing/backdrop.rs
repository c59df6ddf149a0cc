//! An environment map behind a scene: which texel is seen in which direction, and that it lights nothing.

use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::Error;
use mesophyll_viewer::scene::{Backdrop, Camera};
use std::f64::consts::PI;
use std::sync::Arc;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 32;

/// Radiance that tells every direction apart: its colours are 2 + x, 2 + y and 2 + z.
fn backdrop() -> Backdrop {
    let texel = |k: u32| {
        let azimuth = (f64::from(k % WIDTH) + 0.5) / f64::from(WIDTH) * 2.0 * PI;
        let zenith = (f64::from(k / WIDTH) + 0.5) / f64::from(HEIGHT) * PI;
        let d = [zenith.sin() * azimuth.cos(), zenith.sin() * azimuth.sin(), zenith.cos()];
        d.map(|v| (2.0 + v) as f32)
    };
    Backdrop { width: WIDTH, height: HEIGHT, texels: Arc::new((0..WIDTH * HEIGHT).map(texel).collect()) }
}

#[test]
fn every_direction_shows_its_own_radiance() {
    let Some(mut renderer) = renderer() else { return };
    for msaa in [1, 4] {
        let mut scene = scene_of(uniform_leaf());
        (scene.msaa, scene.backdrop) = (msaa, Some(backdrop()));
        renderer.set_scene(&scene).expect("scene");
        // Away from the leaf, all around, also across the seam at +x and near both poles.
        for ahead in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::new(0.1, 0.05, 1.0), Vec3::new(1.0, -0.01, -0.4)] {
            let eye = Vec3::new(0.0, 0.0, 500.0);
            let camera = Camera { eye, target: eye + ahead, up: Vec3::new(0.0, 0.3, 1.0), fov_y_deg: 60.0 };
            let picture = renderer.render(&camera, 24, 18).expect("picture");
            let (forward, half) = (unit(wide(ahead)), (30f64.to_radians()).tan());
            let right = unit(cross(forward, wide(camera.up)));
            let down = cross(forward, right);
            for (x, y) in [(0, 0), (12, 9), (23, 4), (5, 17)] {
                let (s, t) = ((f64::from(x) + 0.5 - 12.0) / 9.0 * half, (f64::from(y) + 0.5 - 9.0) / 9.0 * half);
                let d = unit([0, 1, 2].map(|c| forward[c] + s * right[c] + t * down[c]));
                let seen = picture.radiance(x, y);
                for c in 0..3 {
                    // Linear interpolation of sines over steps of 5.6° is off by at most 2 · (0.098)²/8.
                    let (found, want) = (f64::from(seen[c]), 2.0 + d[c]);
                    assert!((found - want).abs() < 4e-3, "{ahead} pixel {x}, {y} colour {c}: {found}, not {want}");
                }
                assert_eq!(seen[3], 0.0, "it covers nothing");
            }
        }
    }
}

#[test]
fn it_lights_nothing_and_can_be_hidden() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    scene.sun = Some(sun(Vec3::new(-0.4, 0.3, 1.0)));
    let camera = camera(Vec3::new(0.3, -0.5, 1.0), 100.0);
    renderer.set_scene(&scene).expect("scene");
    let plain = renderer.render(&camera, 40, 30).expect("picture");
    scene.backdrop = Some(backdrop());
    renderer.set_scene(&scene).expect("scene");
    let behind = renderer.render(&camera, 40, 30).expect("picture");
    let (mut leaf, mut beyond) = (0, 0);
    for (a, b) in plain.hdr.iter().zip(&behind.hdr) {
        if a[3] == 1.0 {
            assert_eq!(a, b, "the leaf is lit as without it");
            leaf += 1;
        } else if a[3] == 0.0 {
            assert!(b[0] > 0.9, "{b:?}");
            beyond += 1;
        }
    }
    assert!(leaf > 50 && beyond > 50, "{leaf} {beyond}");
    renderer.show_backdrop(false);
    assert!(renderer.render(&camera, 40, 30).expect("picture").hdr == plain.hdr);
}

#[test]
fn wrong_maps_are_refused() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    for (wrong, said) in [
        (Backdrop { width: 63, ..backdrop() }, "2048 texels"),
        (Backdrop { texels: Arc::new(vec![[f32::NAN; 3]; 2048]), ..backdrop() }, "NaN"),
        (Backdrop { width: 0, height: 0, texels: Arc::default() }, "backdrop"),
    ] {
        scene.backdrop = Some(wrong);
        let error = renderer.set_scene(&scene).expect_err("refused");
        assert!(
            matches!(error, Error::Scene { .. } | Error::Size { .. }) && error.to_string().contains(said),
            "{error}"
        );
    }
}
