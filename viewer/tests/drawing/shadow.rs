//! Soft shadows agree with the true share of the sun's disk that is seen.

use crate::common::*;
use glam::{Mat4, Vec3};
use mesophyll_viewer::scene::{Instance, Material, Scene};
use std::f64::consts::PI;

const HEIGHT: f32 = 8.0;
const HALF: f32 = 5.0;

/// A receiver of ±10 mm, with a square of ±`HALF` mm at the height `HEIGHT` above it.
fn hovering(direction: Vec3, radius: f32, samples: u32) -> Scene {
    let mut scene = scene_of(uniform_leaf());
    let lift = Mat4::from_translation(Vec3::new(0.0, 0.0, HEIGHT)) * Mat4::from_scale(Vec3::splat(HALF / 10.0));
    scene.instances.push(Instance { mesh: 0, material: 0, transform: lift, ..Instance::default() });
    let mut s = sun(direction);
    s.radius = radius;
    scene.sun = Some(s);
    (scene.shadow_samples, scene.shadow_resolution) = (samples, 1024);
    scene
}

/// The drawn visibility and its point, for the receiver's pixels that the square does not hide.
fn drawn_visibility(scene: &Scene) -> Option<Vec<([f64; 3], f64)>> {
    let mut renderer = renderer()?;
    let camera = camera(Vec3::new(60.0, 12.0, 26.0), 66.0);
    let (width, height) = (96, 72);
    renderer.set_scene(scene).expect("scene");
    let picture = renderer.render(&camera, width, height).expect("picture");
    let sun = scene.sun.expect("sun");
    let full = f64::from(RHO_D[1]) * f64::from(sun.irradiance[1]) * f64::from(sun.direction.z) / PI;
    let eye = wide(camera.eye);
    let mut out = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let p = seen_point(&camera, width, height, x, y);
            let t = f64::from(HEIGHT) / eye[2];
            let above: [f64; 3] = std::array::from_fn(|i| p[i] + t * (eye[i] - p[i]));
            let hidden = above[0].abs().max(above[1].abs()) < f64::from(HALF) + 0.3;
            if p[0].abs().max(p[1].abs()) < 9.5 && !hidden {
                out.push((p, f64::from(picture.radiance(x, y)[1]) / full));
            }
        }
    }
    Some(out)
}

/// Share of the disk whose rays from `p` miss the square, by a fine polar grid over the disk.
fn seen_share(p: [f64; 3], direction: [f64; 3], radius: f64) -> f64 {
    let a = unit(cross(direction, [0.0, 1.0, 0.0]));
    let b = cross(direction, a);
    let n = 96;
    let mut seen = 0;
    for i in 0..n {
        for k in 0..n {
            let r = radius.tan() * ((i as f64 + 0.5) / n as f64).sqrt();
            let phi = 2.0 * PI * (k as f64 + 0.5) / n as f64;
            let d: [f64; 3] = std::array::from_fn(|c| direction[c] + r * (phi.cos() * a[c] + phi.sin() * b[c]));
            let s = (f64::from(HEIGHT) - p[2]) / d[2];
            let (x, y) = (p[0] + s * d[0], p[1] + s * d[1]);
            seen += usize::from(x.abs().max(y.abs()) > f64::from(HALF));
        }
    }
    seen as f64 / (n * n) as f64
}

#[test]
fn penumbra_of_an_edge_follows_the_disks_segment() {
    let radius = 0.15f32;
    let Some(points) = drawn_visibility(&hovering(Vec3::Z, radius, 64)) else { return };
    // At a straight edge, the visible part of the disk is a segment of a circle.
    let reach = f64::from(HEIGHT) * f64::from(radius).tan();
    let mut tested = 0;
    for (p, got) in points {
        let t = (p[0] - f64::from(HALF)) / reach;
        if p[1].abs() < f64::from(HALF) - reach && t.abs() < 1.3 && p[0] > 0.0 {
            let t = t.clamp(-1.0, 1.0);
            let want = 0.5 + (t * (1.0 - t * t).sqrt() + t.asin()) / PI;
            // 64 directions give steps of 1/64, and an error of a few of them.
            assert!((got - want).abs() < 0.045, "at {p:?}: drawn {got}, expected {want}");
            tested += 1;
        }
    }
    assert!(tested > 100, "{tested}");
}

#[test]
fn slanted_sun_and_corners_by_quadrature() {
    let direction = Vec3::new(0.25, -0.3, 1.0).normalize();
    let radius = 0.12f32;
    let Some(points) = drawn_visibility(&hovering(direction, radius, 64)) else { return };
    let (mut worst, mut sum) = (0.0f64, 0.0);
    for (p, got) in &points {
        let error = (got - seen_share(*p, wide(direction), f64::from(radius))).abs();
        worst = worst.max(error);
        sum += error;
    }
    let mean = sum / points.len() as f64;
    println!("visibility: worst error {worst:.4}, mean {mean:.5} over {} points", points.len());
    assert!(worst < 0.06 && mean < 0.005, "worst {worst}, mean {mean}");
    let lit = points.iter().filter(|(_, v)| *v > 0.99).count();
    let dark = points.iter().filter(|(_, v)| *v < 0.01).count();
    assert!(lit > 300 && dark > 50, "{lit} lit, {dark} dark");
}

#[test]
fn more_directions_come_closer() {
    let direction = Vec3::new(0.2, 0.1, 1.0).normalize();
    let mean_error = |n| {
        let points = drawn_visibility(&hovering(direction, 0.12, n))?;
        let error = |(p, got): &([f64; 3], f64)| (got - seen_share(*p, wide(direction), 0.12)).abs();
        Some(points.iter().map(error).sum::<f64>() / points.len() as f64)
    };
    let (Some(one), Some(eight), Some(many)) = (mean_error(1), mean_error(8), mean_error(48)) else { return };
    assert!(many < 0.6 * eight && eight < 0.6 * one, "{one}, {eight}, {many}");
}

#[test]
fn a_leaf_does_not_shadow_itself() {
    let Some(mut renderer) = renderer() else { return };
    for direction in [Vec3::Z, Vec3::new(1.0, 0.3, 0.5), Vec3::new(0.0, 1.0, 0.1), Vec3::new(0.3, 0.1, -0.4)] {
        let mut scene = scene_of(uniform_leaf());
        scene.sun = Some(sun(direction));
        scene.shadow_resolution = 256;
        let camera = camera(Vec3::new(0.4, -0.3, 1.0), 60.0);
        renderer.set_scene(&scene).expect("scene");
        let without = renderer.render(&camera, 48, 48).expect("picture");
        scene.shadow_samples = 4;
        renderer.set_scene(&scene).expect("scene");
        let with = renderer.render(&camera, 48, 48).expect("picture");
        for (a, b) in without.hdr.iter().zip(&with.hdr) {
            agree(&format!("sun {direction}"), *b, [a[0], a[1], a[2]].map(f64::from), 1e-5);
        }
    }
}

#[test]
fn holes_in_the_mask_let_the_sun_through() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = hovering(Vec3::Z, 0.001, 1);
    let mut caster = uniform_leaf();
    // The right half of this caster is off the leaf.
    caster.mask = Some((0..64).map(|i| u8::from(i % 8 < 4)).collect());
    scene.materials.push(Material::Leaf(caster));
    scene.instances[1].material = 1;
    renderer.set_scene(&scene).expect("scene");
    assert!(renderer.stats().pipelines.iter().any(|p| p == "shadow: masked"));
    let camera = camera(Vec3::new(60.0, 12.0, 26.0), 66.0);
    let picture = renderer.render(&camera, 96, 72).expect("picture");
    let mut seen = [0, 0];
    for y in 0..72 {
        for x in 0..96 {
            let p = seen_point(&camera, 96, 72, x, y);
            let inside = p[0].abs() < 4.5 && p[1].abs() < 4.5 && (p[0] - 0.0).abs() > 0.6;
            let above: [f64; 3] =
                std::array::from_fn(|i| p[i] + f64::from(HEIGHT) / wide(camera.eye)[2] * (wide(camera.eye)[i] - p[i]));
            if inside && above[0].abs().max(above[1].abs()) > 5.3 {
                let lit = picture.radiance(x, y)[1] > 0.0;
                assert_eq!(lit, p[0] > 0.0, "{p:?}");
                seen[usize::from(lit)] += 1;
            }
        }
    }
    assert!(seen[0] > 20 && seen[1] > 20, "{seen:?}");
}

#[test]
fn a_convex_leaf_does_not_shadow_itself_either() {
    let Some(mut renderer) = renderer() else { return };
    for direction in [Vec3::Z, Vec3::new(1.0, 0.3, 0.6), Vec3::new(-0.3, 1.0, 0.3)] {
        let mut scene = on_mesh(bent(10.0, 40, -0.03), uniform_leaf());
        scene.sun = Some(sun(direction));
        scene.shadow_resolution = 1024;
        let camera = camera(Vec3::new(0.4, -0.3, 1.0), 60.0);
        renderer.set_scene(&scene).expect("scene");
        let without = renderer.render(&camera, 64, 64).expect("picture");
        scene.shadow_samples = 4;
        renderer.set_scene(&scene).expect("scene");
        let with = renderer.render(&camera, 64, 64).expect("picture");
        let full = 2.5 * 0.12 / std::f32::consts::PI;
        for (a, b) in without.hdr.iter().zip(&with.hdr) {
            // Where the sunlight grazes the surface, facets and smooth normals give different terminators. Little light
            // is affected there.
            assert!(b[1] <= a[1] && (a[1] - b[1]).abs() < 0.02 * full, "sun {direction}: {} became {}", a[1], b[1]);
        }
    }
}
