//! Light that arrives between and by way of other surfaces. The picture shows operator times light at the anchors, and
//! bilinear means between them. It is computed when the light changes and at no other time.

use crate::common::*;
use glam::Vec3;
use mesophyll_viewer::scene::{AnchorGrid, Camera, Material, OpaqueMaterial, RadianceTransfer, Scene};
use std::f32::consts::PI;

/// The anchors of the square on a grid. Vertices are in the order of `square`, u along x and v along y.
fn anchors(grid: [u32; 2], rows: u32) -> AnchorGrid {
    let [x, y] = grid.map(|n| n as f32 - 1.0);
    let places = [(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)].map(|(a, b)| Vec3::new(0.0, a, b));
    AnchorGrid { grid, places: places.to_vec(), rows, levels: 1 }
}

/// A flat leaf with a transfer in its own light: the front gets the irradiance `front`, and the back `back`, at each
/// anchor.
fn lit_by(grid: [u32; 2], light: impl Fn(u32, u32) -> [f32; 2]) -> Scene {
    let mut scene = scene_of(uniform_leaf());
    scene.meshes[0].anchors = Some(anchors(grid, 6));
    let mut entries = Vec::new();
    for j in 0..grid[1] {
        for i in 0..grid[0] {
            let [front, back] = light(i, j);
            // The vector is along z. Red is twice as much as green, and blue is 0.
            for z in [0.0, 0.0, front, 0.0, 0.0, -back] {
                entries.push([2.0 * z, z, 0.0, 0.0]);
            }
        }
    }
    scene.transfer = Some(RadianceTransfer { bands: None, gloss_bands: 3, scale: 1.0, entries });
    scene
}

/// The operator of a leaf that stands alone: straight light in closed form.
fn alone(bands: usize) -> Vec<[f32; 4]> {
    let columns = bands * bands;
    let mut entries = vec![[0.0; 4]; (6 + columns) * columns];
    let mut put = |row: usize, column: usize, v: f32| entries[row * columns + column][3] = v;
    // ∫ ω Y₀₀ over a hemisphere is π √(1/4π) n.
    put(2, 0, PI * (1.0 / (4.0 * PI)).sqrt());
    put(5, 0, -PI * (1.0 / (4.0 * PI)).sqrt());
    (0..columns).for_each(|k| put(6 + k, k, 1.0));
    entries
}

#[test]
fn a_leaf_alone_is_lit_as_by_a_constant_sky() {
    let Some(mut renderer) = renderer() else { return };
    for bands in [1, 3, 5] {
        let mut leaf = uniform_leaf();
        leaf.sides.front.gloss = Some(vec![[0.08, 0.06, 0.05, 0.3]; 64]);
        let mut scene = scene_of(leaf);
        scene.sky = Some([0.4, 0.5, 0.6]);
        let view = camera(Vec3::new(0.3, -0.5, 1.0), 80.0);
        renderer.set_scene(&scene).unwrap();
        let constant = renderer.render(&view, 48, 32).unwrap().hdr;
        scene.meshes[0].anchors = Some(anchors([1, 1], 6 + (bands * bands) as u32));
        scene.transfer =
            Some(RadianceTransfer { bands: Some(bands), gloss_bands: bands, scale: 1.0, entries: alone(bands) });
        renderer.set_scene(&scene).unwrap();
        let arrived = renderer.render(&view, 48, 32).unwrap().hdr;
        let mut compared = 0;
        for (a, b) in arrived.iter().zip(&constant).filter(|(_, b)| b[3] == 1.0) {
            // Half floats have eleven bits.
            agree(&format!("{bands} bands"), *a, [b[0], b[1], b[2]].map(f64::from), held(&renderer, 2e-3));
            compared += 1;
        }
        assert!(compared > 200, "{compared}");
    }
}

/// The radiance is ρd/π·E_front + ρt/π·E_back, with E interpolated bilinearly between the anchors around the point.
#[test]
fn light_is_interpolated_between_anchors() {
    let Some(mut renderer) = renderer() else { return };
    let light = |i: u32, j: u32| [1.0 + i as f32 + 0.5 * (i * j) as f32, 0.5 + j as f32];
    let scene = lit_by([4, 3], light);
    renderer.set_scene(&scene).unwrap();
    for (from, rho_d, rho_t, near) in [(1.0, RHO_D, BACK_T, 0), (-1.0, BACK_D, RHO_T, 1)] {
        let (view, size) = (camera(Vec3::new(0.1, -0.2, from), 70.0), [60, 40]);
        let picture = renderer.render(&view, size[0], size[1]).unwrap();
        let mut compared = 0;
        for k in (0..size[0] * size[1]).step_by(7) {
            let (x, y) = (k % size[0], k / size[0]);
            let p = seen_point(&view, size[0], size[1], x, y);
            if p[0].abs() > 9.0 || p[1].abs() > 9.0 {
                continue;
            }
            let at = [(p[0] + 10.0) / 20.0 * 3.0, (p[1] + 10.0) / 20.0 * 2.0];
            let (i, j) = (at[0].floor(), at[1].floor());
            let mut mean = [0.0; 2];
            for (di, dj) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let weight = (1.0 - (at[0] - i - di).abs()) * (1.0 - (at[1] - j - dj).abs());
                let of = light((i + di) as u32, (j + dj) as u32);
                (0..2).for_each(|s| mean[s] += weight * f64::from(of[s]));
            }
            let green =
                (f64::from(rho_d[1]) * mean[near] + f64::from(rho_t[1]) * mean[1 - near]) / std::f64::consts::PI;
            let red = (f64::from(rho_d[0]) * mean[near] + f64::from(rho_t[0]) * mean[1 - near]) / std::f64::consts::PI;
            agree("interpolated", picture.hdr[k as usize], [2.0 * red, green, 0.0], held(&renderer, 2e-3));
            compared += 1;
        }
        assert!(compared > 100, "{compared}");
    }
}

/// Sunlight arrives by way of other surfaces only, as harmonics. Light of the sky also arrives straight.
#[test]
fn sun_and_sky_take_their_own_ways() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = scene_of(uniform_leaf());
    scene.meshes[0].anchors = Some(anchors([1, 1], 6));
    let columns = 4;
    let mut entries = vec![[0.0; 4]; 6 * columns];
    entries[2 * columns] = [0.5, 0.25, 0.125, 1.0];
    // Y₁₀ of the light, by way of other surfaces.
    entries[2 * columns + 2] = [0.25, 0.5, 1.0, 0.0];
    scene.transfer = Some(RadianceTransfer { bands: Some(2), gloss_bands: 2, scale: 1.0, entries });
    scene.sky = Some([0.2, 0.3, 0.4]);
    // The sun is below, so it does not shine on the side that is seen, and with ρt = 0 nothing is transmitted.
    let mut lamp = sun(Vec3::new(0.6, 0.0, -0.8));
    lamp.irradiance = [2.0, 1.0, 0.5];
    scene.sun = Some(lamp);
    leaf(&mut scene, 0).sides.back = mesophyll_viewer::scene::SideMaps::black();
    renderer.set_scene(&scene).unwrap();
    let seen = renderer.render(&camera(Vec3::Z, 60.0), 9, 9).unwrap().hdr[40];
    let (y00, y10) = ((1.0 / (4.0 * PI)).sqrt(), (3.0 / (4.0 * PI)).sqrt() * -0.8);
    let want: [f64; 3] = std::array::from_fn(|c| {
        let (sky, sun) = ([0.2, 0.3, 0.4][c] * (4.0 * PI).sqrt(), [2.0, 1.0, 0.5][c]);
        let (even, tilted) = ([0.5, 0.25, 0.125][c], [0.25, 0.5, 1.0][c]);
        let e = sky * (1.0 + even) + sun * (even * y00 + tilted * y10);
        f64::from(RHO_D[c] * e / PI)
    });
    agree("sun and sky", seen, want, held(&renderer, 2e-3));
}

#[test]
fn it_is_worked_out_when_the_light_changes_and_only_then() {
    let Some(mut renderer) = renderer() else { return };
    let view = camera(Vec3::Z, 60.0);
    let mut scene = scene_of(uniform_leaf());
    scene.sky = Some([0.4, 0.5, 0.6]);
    renderer.set_scene(&scene).unwrap();
    renderer.render(&view, 9, 9).unwrap();
    let stats = renderer.stats();
    assert!(stats.transfers == 0 && !stats.uploaded("transfer") && !stats.pipelines.contains(&"transfer".into()));
    scene.meshes[0].anchors = Some(anchors([1, 1], 6));
    scene.transfer =
        Some(RadianceTransfer { bands: Some(1), gloss_bands: 1, scale: 1.0, entries: vec![[0.0, 0.0, 0.0, 1.0]; 6] });
    renderer.set_scene(&scene).unwrap();
    (0..3).for_each(|_| drop(renderer.render(&view, 9, 9).unwrap()));
    assert_eq!((renderer.stats().transfers, renderer.stats().uploaded("transfer")), (1, true));
    let before = renderer.render(&view, 9, 9).unwrap().hdr[40];
    scene.sky = Some([0.8, 0.5, 0.6]);
    renderer.set_lights(&scene).unwrap();
    let after = renderer.render(&view, 9, 9).unwrap().hdr[40];
    assert_eq!(renderer.stats().transfers, 2);
    scene.exposure = 2.0;
    renderer.set_lights(&scene).unwrap();
    assert_eq!(renderer.stats().transfers, 2, "an exposure is no light");
    assert!((after[0] / before[0] - 2.0).abs() < 1e-5 && after[1] == before[1], "{before:?} {after:?}");
}

/// Wood gets its light at its vertices, on its outside.
#[test]
fn wood_is_lit_at_its_vertices() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = Scene { exposure: 1.0, msaa: 1, shadow_resolution: 64, ..Scene::default() };
    let mut mesh = square(10.0);
    let places = (0..4).map(|k| Vec3::new(k as f32, 0.0, 0.0)).collect();
    mesh.anchors = Some(AnchorGrid { grid: [1, 1], places, rows: 1, levels: 1 });
    let wood = scene
        .add(mesh, Material::Opaque(OpaqueMaterial { name: "bark".into(), albedo: [0.3, 0.2, 0.1], pattern: None }));
    scene.instances.push(wood);
    // Light grows from the left to the right.
    let entries = [0.5, 1.5, 1.5, 0.5].into_iter().map(|e| [e, e, e, 0.0]).collect();
    scene.transfer = Some(RadianceTransfer { bands: None, gloss_bands: 1, scale: 2.0, entries });
    renderer.set_scene(&scene).unwrap();
    let view = camera(Vec3::Z, 60.0);
    let picture = renderer.render(&view, 41, 41).unwrap();
    for x in [5, 20, 33] {
        let p = seen_point(&view, 41, 41, x, 20);
        let e = 2.0 + p[0] / 10.0;
        let want = [0.3, 0.2, 0.1].map(|a| a * e / std::f64::consts::PI);
        agree("wood", picture.hdr[(20 * 41 + x) as usize], want, held(&renderer, 2e-3));
    }
    let behind = renderer.render(&camera(-Vec3::Z, 60.0), 9, 9).unwrap().hdr[40];
    assert_eq!(behind[..3], [0.0; 3]);
}

#[test]
fn a_transfer_that_contradicts_its_scene_is_refused() {
    let Some(mut renderer) = renderer() else { return };
    let good = || lit_by([2, 2], |_, _| [1.0, 1.0]);
    assert!(renderer.set_scene(&good()).is_ok());
    let mut refused = |what: &str, change: &dyn Fn(&mut Scene)| {
        let mut scene = good();
        change(&mut scene);
        let told = renderer.set_scene(&scene).expect_err(what).to_string();
        assert!(told.contains(what), "{told}");
    };
    refused("anchors", &|s| s.meshes[0].anchors = None);
    refused("anchors", &|s| s.instances[0].first_row = 1);
    refused("anchors", &|s| s.meshes[0].anchors.as_mut().unwrap().rows = 3);
    refused("entries", &|s| s.transfer.as_mut().unwrap().entries.clear());
    refused("bands", &|s| s.transfer.as_mut().unwrap().bands = Some(8));
}

/// From near, the finest anchors are used, and from far the coarsest. Between, the picture changes without a step. An
/// instance that stores only coarse anchors uses them at all distances.
#[test]
fn far_leaves_are_lit_by_coarser_anchors() {
    let Some(mut renderer) = renderer() else { return };
    // Two by two anchors give the front 1 each. The single anchor that represents them gives 3, which is not physical
    // but shows which level is used.
    let levels = |first_level: u32| {
        let mut scene = lit_by([2, 2], |_, _| [1.0, 0.0]);
        let Some(transfer) = &mut scene.transfer else { unreachable!() };
        transfer.entries.extend([0.0, 0.0, 3.0, 0.0, 0.0, 0.0].map(|z| [2.0 * z, z, 0.0, 0.0]));
        if first_level == 1 {
            transfer.entries.drain(..4 * 6);
        }
        scene.meshes[0].anchors.as_mut().unwrap().levels = 2;
        scene.instances[0].first_level = first_level;
        scene
    };
    let unit = f64::from(RHO_D[1]) / f64::from(PI);
    let mut seen = |scene: &Scene, fov: f32| {
        renderer.set_scene(scene).unwrap();
        let view = Camera { fov_y_deg: fov, ..camera(Vec3::Z, 400.0) };
        // The square of 20 mm is in the middle of the picture. 128 pixels are as wide as the field of view.
        let picture = renderer.render(&view, 128, 128).unwrap();
        f64::from(picture.hdr[64 * 128 + 64][1]) / unit
    };
    // The field of view (degrees) in which two anchors, which are 20 mm apart, have this distance in pixels.
    let apart = |pixels: f32| 2.0 * (20.0 / 400.0 * 128.0 / pixels / 2.0).atan().to_degrees();
    assert!((seen(&levels(0), apart(12.0)) - 1.0).abs() < 0.01);
    assert!((seen(&levels(0), apart(1.5)) - 3.0).abs() < 0.02);
    assert!((seen(&levels(1), apart(12.0)) - 3.0).abs() < 0.02);
    // The coarse level has the share log2(4 / pixels).
    let mut before = 1.0;
    for pixels in [3.6, 3.2, 2.8, 2.4, 2.1] {
        let (found, expected) = (seen(&levels(0), apart(pixels)), 1.0 + 2.0 * (4.0 / f64::from(pixels)).log2());
        assert!((found - expected).abs() < 0.05 && found > before, "{pixels} {found} {expected}");
        before = found;
    }
}
