//! An environment map behind a scene: which texel is seen in which direction, and that it lights nothing.

use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::Error;
use mesophyll_viewer::scene::{Backdrop, Camera, SkyDome, Sun};
use std::f64::consts::PI;
use std::sync::Arc;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 32;

/// Radiance that tells every direction apart: its colours are 2 + x, 2 + y and 2 + z.
fn backdrop() -> Backdrop {
    let texel = |k: u32| {
        let azimuth = (0.5 - (f64::from(k % WIDTH) + 0.5) / f64::from(WIDTH)) * 2.0 * PI;
        let zenith = (f64::from(k / WIDTH) + 0.5) / f64::from(HEIGHT) * PI;
        let d = [zenith.sin() * azimuth.cos(), zenith.sin() * azimuth.sin(), zenith.cos()];
        d.map(|v| (2.0 + v) as f32)
    };
    Backdrop { width: WIDTH, height: HEIGHT, texels: Arc::new((0..WIDTH * HEIGHT).map(texel).collect()), turn: 0.0 }
}

#[test]
fn every_direction_shows_its_own_radiance() {
    let Some(mut renderer) = renderer() else { return };
    for (msaa, turn) in [(1, 0.0f32), (4, 0.0), (1, 0.25), (1, -0.6)] {
        let mut scene = scene_of(uniform_leaf());
        (scene.msaa, scene.backdrop) = (msaa, Some(Backdrop { turn, ..backdrop() }));
        let (sin, cos) = (2.0 * PI * f64::from(turn)).sin_cos();
        renderer.set_scene(&scene).expect("scene");
        // Away from the leaf, all around, also across the seam at -x and near both poles.
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
                // What the map has there before it is turned from +x towards +y.
                let d = [cos * d[0] + sin * d[1], cos * d[1] - sin * d[0], d[2]];
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

/// A dome whose look is a picture: its strength counts, the sun's disk stands before it, and a model ends at the
/// horizon.
#[test]
fn a_dome_can_look_like_a_picture() {
    let Some(mut renderer) = renderer() else { return };
    let towards = Vec3::new(0.0, 0.8, 0.6);
    let mut scene = scene_of(uniform_leaf());
    scene.sun = Some(Sun { irradiance: [0.3, 0.2, 0.1], radius: 0.1, ..sun(towards) });
    let eye = Vec3::new(0.0, 0.0, 500.0);
    let mut look = |turbidity: f32, ahead: Vec3| {
        scene.dome = Some(SkyDome {
            harmonics: vec![[1.0; 3]],
            picture: Some(backdrop()),
            perez: [[0.0; 5]; 3],
            scale: [0.0; 3],
            ground: Some([0.02, 0.03, 0.04]),
            sun: towards,
            strength: 0.5,
            turbidity,
        });
        renderer.set_scene(&scene).expect("scene");
        let camera = Camera { eye, target: eye + ahead, up: Vec3::new(0.1, 0.3, 1.0), fov_y_deg: 2.0 };
        let picture = renderer.render(&camera, 9, 9).expect("picture");
        picture.radiance(4, 4)
    };
    let close = |seen: [f32; 4], want: [f64; 3]| {
        assert!(
            (0..3).all(|c| (f64::from(seen[c]) - want[c]).abs() < 4e-3 * want[c].max(1.0)),
            "{seen:?}, not {want:?}"
        );
    };
    let disk = [0.3, 0.2, 0.1].map(|e: f64| e / (PI * 0.1f64.sin().powi(2)));
    close(look(0.0, towards), [1.0 + disk[0], 1.4 + disk[1], 1.3 + disk[2]]);
    close(look(0.0, Vec3::new(0.8, 0.0, -0.6)), [1.4, 1.0, 0.7]);
    close(look(3.0, Vec3::new(0.8, 0.0, -0.6)), [0.01, 0.015, 0.02]);
    close(look(3.0, Vec3::new(0.8, 0.0, 0.6)), [1.4, 1.0, 1.3]);
}

#[test]
fn wrong_maps_are_refused() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    for (wrong, said) in [
        (Backdrop { width: 63, ..backdrop() }, "2048 texels"),
        (Backdrop { texels: Arc::new(vec![[f32::NAN; 3]; 2048]), ..backdrop() }, "NaN"),
        (Backdrop { width: 0, height: 0, texels: Arc::default(), turn: 0.0 }, "backdrop"),
    ] {
        scene.backdrop = Some(wrong);
        let error = renderer.set_scene(&scene).expect_err("refused");
        assert!(
            matches!(error, Error::Scene { .. } | Error::Size { .. }) && error.to_string().contains(said),
            "{error}"
        );
    }
}
