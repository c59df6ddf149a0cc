//! Levels of detail: fewer triangles where a leaf is small, with the same picture.

use crate::common::*;
use glam::{Mat4, Vec3};
use mesophyll_viewer::scene::{DetailLevel, Instance, Scene};

const CELLS: u32 = 16;
/// The sheet is hollow towards the back, so a chord runs below the sheet, into its shadow.
const BEND: f32 = -0.01;

/// Every fourth vertex of the bent sheet. Between two of them, z = bend·x² differs from the chord of 5 mm by
/// |bend|·2.5².
fn coarse() -> DetailLevel {
    let at = |i: u32, j: u32| 4 * (j * (CELLS + 1) + i);
    let mut indices = Vec::new();
    for j in 0..CELLS / 4 {
        for i in 0..CELLS / 4 {
            indices.extend([at(i, j), at(i, j + 1), at(i + 1, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]);
        }
    }
    DetailLevel { indices, error: BEND.abs() * 2.5 * 2.5, outline_only: false }
}

/// Height of the eye on the z axis.
const EYE: f32 = 200.0;

/// Sheets side by side at these distances from the eye, lit from the front with shadows.
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
    // 64 pixels over 20°: the level's error of 0.0625 mm is half a pixel at 23 mm from the sheet's ball (radius 14 mm).
    for (distances, want) in
        [(vec![30.0], full), (vec![45.0], full / 16), (vec![150.0, 30.0, 120.0], full + 2 * full / 16)]
    {
        renderer.set_scene(&sheets(&distances, true)).expect("scene");
        renderer.render(&camera, 96, 64).expect("picture");
        assert_eq!(renderer.stats().triangles, want, "{distances:?}");
        // A larger picture needs the mesh itself again.
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
            // A shadow of the sheet on itself would take at least a quarter of the light. A normal that is interpolated
            // over 5 mm is wrong by at most 0.1 rad · (1/4)².
            assert!((a - b).abs() < 0.02 * b, "({x}, {y}): {a} {b}");
        }
    }
    assert!(seen > 300, "{seen}");
}
