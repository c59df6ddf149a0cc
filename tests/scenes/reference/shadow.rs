//! The sun's disk is half hidden: the visible share, and the penumbra.

use super::{SUN, alone, blade, camera, leaf, sun, uniform};
use glam::{DMat4, DQuat, DVec3};
use mesophyll::transport::CameraRays;
use mesophyll::transport::lobe::Lobe;
use mesophyll::transport::{Options, ReferencePlacement, ReferenceRenderer, ReferenceWorld, render};
use std::f64::consts::PI;

/// Share of a unit disk that lies on the side x > d.
fn segment(d: f64) -> f64 {
    let d = d.clamp(-1.0, 1.0);
    (d.acos() - d * (1.0 - d * d).sqrt()) / PI
}

/// A card lit from straight above, and a wide blade at `height` that hides the half-space x < 0.
fn half_hidden(height: f64, radius: f64) -> ReferenceWorld {
    let side = || uniform([0.5; 3], [0.0; 3], None);
    let mut world = alone(leaf(blade(1.0, 1.0, 1, 0.0), side(), side(), Lobe::Beckmann), sun(DVec3::Z, radius), None);
    let place = |at: DVec3| ReferencePlacement {
        leaf: 0,
        transform: DMat4::from_scale_rotation_translation(DVec3::splat(2000.0), DQuat::IDENTITY, at),
    };
    world.instances = vec![place(DVec3::ZERO), place(DVec3::new(-1000.0, 0.0, height))];
    world
}

#[test]
fn a_half_hidden_sun_shows_a_circular_segment() {
    for radius in [SUN, 0.1] {
        let world = half_hidden(100.0, radius);
        let renderer = ReferenceRenderer::new(&world).unwrap();
        let reach = 100.0 * f64::tan(radius);
        for d in [-1.2, -0.9, -0.5, -0.1, 0.0, 0.3, 0.8, 1.1] {
            // From a point at x = d·reach, the edge cuts the disk at −d.
            let found = renderer.sun_visibility(DVec3::new(d * reach, 3.0, 0.0), 4096, 5).unwrap();
            assert!((found - segment(-d)).abs() < 2e-3, "{radius} {d}: {found} against {}", segment(-d));
        }
    }
}

#[test]
fn a_penumbra_has_the_right_profile_and_is_marked() {
    let (height, radius) = (100.0, 0.05);
    let world = half_hidden(height, radius);
    let (width, rows) = (80, 8);
    // From below the occluder, looking straight down.
    let view = camera(DVec3::new(0.0, 0.0, 50.0), 2.0);
    let options = Options { samples_per_pixel: 64, sun_samples: 16, ..Options::default() };
    let picture = render(&world, &view, width, rows, &options).unwrap();
    let lens = CameraRays::new(&view, width, rows).unwrap();
    let full = [3.0, 2.5, 2.0].map(|e| e * 0.5 / PI);
    let (mut marked, mut squares) = (0, 0.0f64);
    for k in 0..width * rows {
        let ray = lens.ray((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
        let x = ray.direction.x / -ray.direction.z * 50.0;
        let d = x / (height * radius.tan());
        for (found, full) in picture.hdr[k].iter().zip(full) {
            let share = f64::from(*found) / full;
            let error = share - segment(-d);
            assert!(error.abs() < 0.02, "x = {x}: {share} against {}", segment(-d));
            squares += error * error / (3 * width * rows) as f64;
        }
        let pixel = 50.0 * (2.0 / rows as f64).to_radians() / (height * radius.tan());
        if d.abs() < 1.0 - pixel {
            assert!(picture.penumbra[k], "unmarked at d = {d}");
            marked += 1;
        } else if d.abs() > 1.0 + 3.0 * pixel {
            assert!(!picture.penumbra[k], "marked at d = {d}");
        }
        assert!(picture.interior[k]);
    }
    assert!(marked > 100);
    // 1024 samples without stratification would scatter by √(¼/1024) = .016 at V = ½.
    assert!(squares.sqrt() < 0.008, "{}", squares.sqrt());
}
