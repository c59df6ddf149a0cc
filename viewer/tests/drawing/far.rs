//! Plants that stand in many places, from near to far: mean radiance, coverage and shadow beside a picture of all their
//! leaves with far smaller pixels.

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

fn standing(scene: &mut Scene, places: Vec<Vec3>) {
    let place = |p: Vec3| StandPlace { transform: Mat4::from_translation(p), pose: 0 };
    let places = places.into_iter().map(place).collect();
    scene.stands = vec![Arc::new(PlantStand { places, first: 0, sections: 0, poses: 1 })];
}

/// Flux and area (mm²) that a picture of this many pixels shows, whose pixels have this width.
fn shown(renderer: &mut Renderer, direction: Vec3, distance: f32, side: u32, pixel: f32) -> [f64; 2] {
    let camera = camera(direction, distance);
    let fov_y_deg = 2.0 * (0.5 * side as f32 * pixel / distance).atan().to_degrees();
    let picture = renderer.render(&Camera { fov_y_deg, ..camera }, side, side).expect("picture");
    let sum = |c: usize| picture.hdr.iter().map(|p| f64::from(p[c])).sum::<f64>() * f64::from(pixel).powi(2);
    [sum(1), sum(3)]
}

fn at(azimuth: f32, elevation: f32) -> Vec3 {
    let (a, e) = (azimuth.to_radians(), elevation.to_radians());
    Vec3::new(a.cos() * e.cos(), a.sin() * e.cos(), e.sin())
}

/// The errors of far plants under each of the suns: of area, of flux over area beside full detail with the same maps,
/// and of flux beside full detail with fine maps. With them comes the number of leaves of a plant.
fn errors(renderer: &mut Renderer, view: Vec3, lights: [Vec3; 3], metres: f32) -> ([[f64; 3]; 3], f64) {
    let distance = 1e3 * metres;
    let pixel = PIXEL * distance;
    let across = (2.0 * REACH / pixel).max(1.0);
    let grid = (64.0 / across).ceil().clamp(1.0, 48.0) as i32;
    let spacing = 2.618 * REACH * 2.0 / 1.4;
    let right = view.cross(Vec3::Z).normalize_or(Vec3::X);
    let up = right.cross(view);
    let place = |i: i32, j: i32| {
        let [x, y] = [i, j].map(|k| spacing * (k as f32 - 0.5 * (grid - 1) as f32));
        x * right + y * up
    };
    let all: Vec<Vec3> = (0..grid).flat_map(|i| (0..grid).map(move |j| (i, j))).map(|(i, j)| place(i, j)).collect();
    let side = ((grid as f32 * spacing + REACH) / pixel).ceil() as u32 + 8;
    let (many, last) = (all.len() as f64, grid - 1);
    let ends = if grid == 1 { vec![] } else { vec![place(0, 0), place(last, 0), place(0, last), place(last, last)] };
    let ways = [all, [vec![Vec3::ZERO], ends].concat(), vec![Vec3::ZERO]];
    let mut leaves = 0.0;
    let found = [0, 1, 2].map(|way: usize| {
        let mut scene = plant();
        scene.sun = Some(sun(lights[0]));
        scene.in_full = way > 0;
        standing(&mut scene, ways[way].clone());
        renderer.set_scene(&scene).expect("scene");
        lights.map(|light| {
            scene.sun = Some(sun(light));
            renderer.set_lights(&scene).expect("lights");
            match way {
                0 => {
                    let sums = shown(renderer, view, distance, side, pixel);
                    leaves = 0.5 * renderer.stats().triangles as f64 / many;
                    sums.map(|sum| sum / many)
                }
                _ => shown(renderer, view, distance, 360, 2.0 * REACH / 360.0),
            }
        })
    });
    let errors = [0, 1, 2].map(|k| {
        let [far, same, fine] = found.map(|way| way[k]);
        [far[1] / same[1] - 1.0, far[0] / far[1] / (same[0] / same[1]) - 1.0, far[0] / fine[0] - 1.0]
    });
    (errors, leaves)
}

/// Views from beside, from behind that and from above, and suns before, behind and high above.
const VIEWS: [[f32; 2]; 3] = [[10.0, 8.0], [190.0, 8.0], [100.0, 50.0]];
const SUNS: [[f32; 2]; 3] = [[40.0, 35.0], [210.0, 35.0], [60.0, 75.0]];

/// Prints and holds the errors from some views. What a leaf in a random direction shows has a standard deviation of .58
/// of its mean, so leaves that were chosen by chance would scatter by `chance`, and their bias would come to that.
fn hold(renderer: &mut Renderer, metres: f32, views: &[[f32; 2]]) {
    let lights = SUNS.map(|[azimuth, elevation]| at(azimuth, elevation));
    let (mut squares, mut count, mut chance) = (0.0, 0.0, 0.0);
    for [azimuth, elevation] in views {
        let (found, leaves) = errors(renderer, at(*azimuth, *elevation), lights, metres);
        chance = 0.58 / leaves.sqrt();
        let text = found.map(|e| format!("{:+5.1} {:+5.1}", 100.0 * e[1], 100.0 * e[2])).join(" | ");
        let covered = found[0][0];
        println!("{metres} m from {azimuth}, {leaves:.0} leaves: coverage {:+.1} %, light {text}", 100.0 * covered);
        assert!(covered.abs() < chance + 0.02, "{metres} m from {azimuth}: {found:?}");
        squares += found.iter().map(|e| e[2] * e[2]).sum::<f64>();
        count += 3.0;
    }
    let off = (squares / count).sqrt();
    println!("{metres} m: light is off by {:.1} % (chance: {:.1} %)", 100.0 * off, 100.0 * chance);
    assert!(off < 2.0 * chance + 0.04, "{metres} m: {off}");
}

/// Plants of 12 pixels.
#[test]
fn far_plants_cover_and_send_what_all_of_their_leaves_do() {
    let Some(mut renderer) = renderer() else { return };
    hold(&mut renderer, 240.0, &VIEWS[..2]);
}

/// From 200 to less than two pixels. It takes minutes and is run by name.
#[test]
#[ignore = "takes minutes"]
fn far_plants_from_near_to_far() {
    let Some(mut renderer) = renderer() else { return };
    for metres in [240.0, 60.0, 30.0, 120.0, 480.0, 2000.0] {
        hold(&mut renderer, metres, &VIEWS);
    }
}
