//! A plant of a stand from near to far: coverage and light beside a picture of all of its leaves with far smaller
//! pixels.

use crate::common::*;
use glam::{Mat4, Quat, Vec3};
use mesophyll_viewer::Renderer;
use mesophyll_viewer::scene::{Camera, Instance, PlantStand, Scene, StandPlace};
use std::sync::Arc;

const SHOOTS: usize = 120;
const ON_A_SHOOT: usize = 25;
/// Angle of a pixel (rad).
const PIXEL: f32 = 8.8e-4;
/// The radius of a ball around the plant (mm).
const REACH: f32 = 1500.0;

/// Numbers from 0 to 1 that are evenly spread.
fn spread(k: usize, j: usize) -> f32 {
    const BY: [f64; 5] = [0.819_172_5, 0.671_043_6, 0.549_700_5, 0.450_330_0, 0.368_917_2];
    ((k as f64 + 0.5) * BY[j]).fract() as f32
}

/// A crown of shoots with leaves of 40 mm, most of which face up, with a gap on one side.
fn plant() -> Scene {
    let mut scene = scene_of(uniform_leaf());
    scene.meshes = vec![square(20.0)];
    let one = scene.instances[0];
    let leaf = |k: usize| {
        let shoot = k / ON_A_SHOOT;
        let (z, a) = (2.0 * spread(shoot, 0) - 1.0, 0.85 * std::f32::consts::TAU * spread(shoot, 1));
        let flat = (1.0 - z * z).sqrt();
        let out = Vec3::new(flat * a.cos(), flat * a.sin(), z);
        let root = out * (0.35 + 0.5 * spread(shoot, 2)) * Vec3::new(900.0, 900.0, 1200.0);
        let along = (k % ON_A_SHOOT) as f32 / ON_A_SHOOT as f32;
        let around = Vec3::new(spread(k, 2) - 0.5, spread(k, 3) - 0.5, spread(k, 4) - 0.5);
        let place = root + 320.0 * along * out + 90.0 * around;
        let turned = Quat::from_rotation_z(std::f32::consts::TAU * spread(k, 3))
            * Quat::from_rotation_y(1.3 * spread(k, 4).sqrt())
            * Quat::from_rotation_z(0.8);
        Instance { transform: Mat4::from_rotation_translation(turned, place), stand: Some(0), ..one }
    };
    scene.instances = (0..SHOOTS * ON_A_SHOOT).map(leaf).collect();
    (scene.shadow_samples, scene.shadow_resolution, scene.msaa) = (1, 2048, 4);
    scene
}

/// Flux and area (mm²) that pictures of this many pixels show, whose pixels have this width: the mean over cameras that
/// are beside each other by parts of a pixel.
fn shown(renderer: &mut Renderer, view: Vec3, distance: f32, (side, pixel, shifts): (u32, f32, usize)) -> [f64; 2] {
    let plain = camera(view, distance);
    let right = view.cross(Vec3::Z).normalize_or(Vec3::X);
    let fov_y_deg = 2.0 * (0.5 * side as f32 * pixel / distance).atan().to_degrees();
    let mut sums = [0.0; 2];
    for k in 0..shifts {
        let beside = pixel * ((spread(k, 0) - 0.5) * right + (spread(k, 1) - 0.5) * right.cross(view));
        let camera = Camera { eye: plain.eye + beside, target: plain.target + beside, fov_y_deg, ..plain };
        let picture = renderer.render(&camera, side, side).expect("picture");
        for (sum, c) in sums.iter_mut().zip([1, 3]) {
            *sum += picture.hdr.iter().map(|p| f64::from(p[c])).sum::<f64>();
        }
    }
    sums.map(|sum| sum * f64::from(pixel).powi(2) / shifts as f64)
}

fn at([azimuth, elevation]: [f32; 2]) -> Vec3 {
    let (a, e) = (azimuth.to_radians(), elevation.to_radians());
    Vec3::new(a.cos() * e.cos(), a.sin() * e.cos(), e.sin())
}

/// The errors of a far plant of area and of flux under each of the suns, and the number of leaves that are drawn.
fn errors(renderer: &mut Renderer, view: Vec3, metres: f32) -> ([[f64; 2]; 3], f64) {
    let distance = 1e3 * metres;
    let pixel = PIXEL * distance;
    let across = 2.0 * REACH / pixel;
    let shifts = (200.0 / across).powi(2).clamp(1.0, 144.0) as usize;
    let ways = [(across.ceil() as u32 + 8, pixel, shifts), (360, 2.0 * REACH / 360.0, 1)];
    let mut leaves = 0.0;
    let [far, fine] = [0, 1].map(|way: usize| {
        let mut scene = plant();
        scene.in_full = way == 1;
        scene.sun = Some(sun(at(SUNS[0])));
        let place = StandPlace { transform: Mat4::IDENTITY, pose: 0 };
        scene.stands = vec![Arc::new(PlantStand { places: vec![place], first: 0, sections: 0, poses: 1 })];
        renderer.set_scene(&scene).expect("scene");
        SUNS.map(|light| {
            scene.sun = Some(sun(at(light)));
            renderer.set_lights(&scene).expect("lights");
            let sums = shown(renderer, view, distance, ways[way]);
            if way == 0 {
                leaves = 0.5 * renderer.stats().triangles as f64;
            }
            sums
        })
    });
    ([0, 1, 2].map(|k| [1, 0].map(|c| far[k][c] / fine[k][c] - 1.0)), leaves)
}

/// Views from beside, from behind that and from above, and suns before, behind and high above.
const VIEWS: [[f32; 2]; 3] = [[10.0, 8.0], [190.0, 8.0], [100.0, 50.0]];
const SUNS: [[f32; 2]; 3] = [[40.0, 35.0], [210.0, 35.0], [60.0, 75.0]];

/// Prints and holds the errors from some views. What a leaf in a random direction shows has a standard deviation of .58
/// of its mean, so leaves that were chosen by chance would scatter by `chance`, and their bias would come to that.
fn hold(renderer: &mut Renderer, metres: f32, views: &[[f32; 2]]) {
    let (mut squares, mut count, mut chance) = ([0.0; 2], 0.0, 0.0);
    for view in views {
        let (found, leaves) = errors(renderer, at(*view), metres);
        chance = 0.58 / leaves.sqrt();
        let text = found.map(|e| format!("{:+5.1}", 100.0 * e[1])).join(" | ");
        println!("{metres} m from {view:?}, {leaves:.0} leaves: coverage {:+.1} %, light {text}", 100.0 * found[0][0]);
        found.iter().for_each(|e| (0..2).for_each(|c| squares[c] += e[c] * e[c]));
        count += 3.0;
    }
    let [area, light] = squares.map(|sum| (sum / count).sqrt());
    let text = format!("{metres} m: coverage is off by {:.1} %, light by {:.1} %", 100.0 * area, 100.0 * light);
    println!("{text} (chance: {:.1} %)", 100.0 * chance);
    assert!(area < 0.5 * chance + 0.01 && light < chance + 0.03, "{text}");
}

/// A plant of 14 pixels.
#[test]
fn far_plants_cover_and_send_what_all_of_their_leaves_do() {
    let Some(mut renderer) = renderer() else { return };
    hold(&mut renderer, 240.0, &VIEWS);
}

/// From 400 to less than two pixels. It is run by name.
#[test]
#[ignore = "takes minutes"]
fn far_plants_from_near_to_far() {
    let Some(mut renderer) = renderer() else { return };
    for metres in [8.0, 30.0, 60.0, 120.0, 240.0, 480.0, 2000.0] {
        hold(&mut renderer, metres, &VIEWS);
    }
}
