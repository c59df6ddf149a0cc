//! Levels of detail: fewer triangles where a leaf is small, the same picture.

mod common;

use common::*;
use glam::{Mat4, Vec3};
use mesophyll_viewer::scene::{Detail, Instance, Scene};

const CELLS: u32 = 16;
/// Hollow towards the back: a chord runs below the sheet, into its shadow.
const BEND: f32 = -0.01;

/// Every fourth vertex of the bent sheet: z = bend·x² leaves a chord of 5 mm by |bend|·2.5².
fn coarse() -> Detail {
    let at = |i: u32, j: u32| 4 * (j * (CELLS + 1) + i);
    let mut indices = Vec::new();
    for j in 0..CELLS / 4 {
        for i in 0..CELLS / 4 {
            indices.extend([at(i, j), at(i, j + 1), at(i + 1, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]);
        }
    }
    Detail { indices, error: BEND.abs() * 2.5 * 2.5 }
}

/// Sheets at these distances from an eye on the z axis at `EYE`, side by side; lit from the front with shadows.
const EYE: f32 = 200.0;

fn sheets(distances: &[f32], detail: bool) -> Scene {
    let mut mesh = bent(10.0, CELLS as usize, BEND);
    if detail {
        mesh.details = vec![coarse()];
    }
    let mut scene = on_mesh(mesh, uniform_leaf());
    scene.instances = distances
        .iter()
        .enumerate()
        .map(|(k, d)| {
            let x = 0.11 * d * (k as f32 - 0.5 * (distances.len() - 1) as f32);
            Instance {
                mesh: 0,
                material: 0,
                transform: Mat4::from_translation(Vec3::new(x, 0.0, EYE - d)),
                ..Instance::default()
            }
        })
        .collect();
    scene.sun = Some(sun(Vec3::new(0.3, 0.2, 1.0)));
    (scene.shadow_samples, scene.shadow_resolution) = (4, 4096);
    scene
}

#[test]
fn a_far_leaf_takes_the_coarse_triangles_and_a_near_one_the_mesh() {
    let Some(mut renderer) = renderer() else { return };
    let camera = camera(Vec3::Z, EYE);
    let full = u64::from(2 * CELLS * CELLS);
    // 64 pixels over 20°: half a pixel is the level's 0.0625 mm at 23 mm from the sheet's ball (radius 14 mm).
    for (distances, want) in
        [(vec![30.0], full), (vec![45.0], full / 16), (vec![150.0, 30.0, 120.0], full + 2 * full / 16)]
    {
        renderer.set_scene(&sheets(&distances, true)).expect("scene");
        renderer.render(&camera, 96, 64).expect("picture");
        assert_eq!(renderer.stats().triangles, want, "{distances:?}");
        // A larger picture asks for the mesh again.
        renderer.render(&camera, 960, 640).expect("picture");
        let near = distances.iter().filter(|d| **d < 200.0).count() as u64;
        assert_eq!(renderer.stats().triangles, near * full, "{distances:?}");
    }
}

#[test]
fn levels_do_not_shade_each_other_and_show_the_same_picture() {
    let Some(mut renderer) = renderer() else { return };
    let camera = camera(Vec3::Z, EYE);
    let distances = [160.0, 40.0, 120.0];
    let mut drawn = |detail: bool| {
        renderer.set_scene(&sheets(&distances, detail)).expect("scene");
        renderer.render(&camera, 96, 64).expect("picture")
    };
    let (with, without) = (drawn(true), drawn(false));
    let mut seen = 0;
    for y in 1..63 {
        for x in 1..95 {
            let around =
                |p: &mesophyll_viewer::Picture| (0..9).all(|k| p.radiance(x + k % 3 - 1, y + k / 3 - 1)[3] > 0.0);
            if !(around(&with) && around(&without)) {
                continue;
            }
            seen += 1;
            let (a, b) = (with.radiance(x, y)[1], without.radiance(x, y)[1]);
            // Its own shadow on a sheet would take a quarter at least; a normal interpolated over 5 mm is 0.1 rad ·
            // (1/4)² off at most.
            assert!((a - b).abs() < 0.02 * b, "({x}, {y}): {a} {b}");
        }
    }
    assert!(seen > 300, "{seen}");
}
