//! Far plants have fewer and larger leaves, and nothing outside the view is drawn. The picture stays the same and costs
//! less.

use crate::common::*;
use glam::{Mat4, Quat, Vec3};
use mesophyll_viewer::scene::{Instance, Scene};
use mesophyll_viewer::{Picture, Renderer};

const LEAVES: usize = 4000;

/// Numbers from 0 to 1 that are evenly spread.
fn spread(k: usize, j: u32) -> f32 {
    ((k as f64 + 0.5) * [0.819_172_5, 0.671_043_6, 0.549_700_5, 0.450_330_0, 0.368_917_2][j as usize]).fract() as f32
}

/// A crown of leaves of 20 mm in a ball of 600 mm, in all directions, under sun and sky with shadows. `kinds` is the
/// number of meshes that the leaves are divided among; a small number of leaves of one mesh is never thinned.
fn crown(kinds: usize, first: usize) -> Scene {
    let mut scene = scene_of(uniform_leaf());
    scene.meshes = vec![square(10.0); kinds];
    let one = |number: usize| {
        let k = first + number;
        let (z, a, r) = (2.0 * spread(k, 0) - 1.0, std::f32::consts::TAU * spread(k, 1), spread(k, 2).cbrt());
        let flat = (1.0 - z * z).sqrt();
        let place = 600.0 * r * Vec3::new(flat * a.cos(), flat * a.sin(), z);
        let (tilt, turn) = ((2.0 * spread(k, 3) - 1.0).acos(), std::f32::consts::TAU * spread(k, 4));
        let turned = Quat::from_rotation_z(turn) * Quat::from_rotation_y(tilt);
        let transform = Mat4::from_rotation_translation(turned, place);
        Instance { mesh: number % kinds, material: 0, transform, ..Instance::default() }
    };
    scene.instances = (0..LEAVES).map(one).collect();
    scene.sun = Some(sun(Vec3::new(0.5, -0.6, 0.8)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    (scene.shadow_samples, scene.shadow_resolution, scene.msaa) = (4, 2048, 4);
    scene
}

/// Mean radiance and coverage of a picture, its triangles, and the time to draw it again (ms, the least of three).
fn shown(renderer: &mut Renderer, distance: f32) -> ([f64; 2], u64, f64) {
    let camera = camera(Vec3::new(0.4, -1.0, 0.2), distance);
    let picture: Picture = renderer.render(&camera, 400, 400).expect("picture");
    let mean = |of: fn(&[f32; 4]) -> f32| picture.hdr.iter().map(|p| f64::from(of(p))).sum::<f64>() / 16e4;
    let clock = |_| {
        let clock = std::time::Instant::now();
        renderer.draw(&camera, 400, 400).expect("picture");
        clock.elapsed().as_secs_f64() * 1e3
    };
    let ms = (0..3).map(clock).fold(f64::INFINITY, f64::min);
    ([mean(|p| p[1]), mean(|p| p[3])], renderer.stats().triangles, ms)
}

#[test]
fn far_leaves_are_fewer_and_the_crown_is_as_bright_and_as_dense() {
    let Some(mut renderer) = renderer() else { return };
    let mut before = u64::MAX;
    for (distance, most) in [(8e3, 1.0), (3e4, 0.55), (6e4, 0.14), (1.2e5, 1.0 / 12.0)] {
        // The mean over two crowns.
        let mut of = |kinds: usize| {
            let each: Vec<_> = (0..2)
                .map(|k| {
                    renderer.set_scene(&crown(kinds, 5000 * k)).expect("scene");
                    shown(&mut renderer, distance)
                })
                .collect();
            let mean = [0, 1].map(|c| each.iter().map(|(m, ..)| m[c]).sum::<f64>() / 2.0);
            (mean, each[0].1, each.iter().map(|e| e.2).fold(f64::INFINITY, f64::min))
        };
        let (full, all, whole_ms) = of(100);
        let (thin, drawn, ms) = of(1);
        assert_eq!(all, 2 * LEAVES as u64);
        let leaves = drawn as f64 / 2.0;
        // A leaf in a random direction shows half of its area, with a standard deviation of .29.
        let scatter = 0.58 / (2.0 * leaves).sqrt();
        let off = [0, 1].map(|c| thin[c] / full[c] - 1.0);
        println!(
            "{:3} m: {leaves} leaves, radiance {:+.1} %, coverage {:+.1} % (chance {:.1} %), {ms:.1} ms of \
             {whole_ms:.1} in one draw a hundredth",
            distance / 1e3,
            100.0 * off[0],
            100.0 * off[1],
            100.0 * scatter
        );
        assert!(leaves <= most * LEAVES as f64 * 1.05 && drawn < before, "{distance}: {leaves}");
        // However far away, none is much larger than it is.
        assert!(leaves >= 0.95 / 12.0 * LEAVES as f64, "{distance}: {leaves}");
        assert!(off.iter().all(|o| o.abs() < 3.0 * scatter + 0.01), "{distance}: {off:?}");
        before = drawn;
    }
}

/// A leaf's origin is where its stalk ends. The same leaves with their origins 25 mm beside them give the same picture,
/// in the picture and in coarse shadow maps: leaves that are drawn larger stay where they are.
#[test]
fn it_does_not_matter_where_a_leaf_has_its_origin() {
    let Some(mut renderer) = renderer() else { return };
    for resolution in [2048, 24] {
        let mut of = |beside: Vec3| {
            let mut scene = crown(1, 0);
            scene.shadow_resolution = resolution;
            scene.meshes[0].positions.iter_mut().for_each(|p| *p += beside);
            for instance in &mut scene.instances {
                instance.transform *= Mat4::from_translation(-beside);
            }
            renderer.set_scene(&scene).expect("scene");
            shown(&mut renderer, 6e4).0
        };
        let (middle, beside) = (of(Vec3::ZERO), of(25.0 * Vec3::X));
        for (a, b) in middle.into_iter().zip(beside) {
            assert!((a / b - 1.0).abs() < 2e-3, "{resolution}: {middle:?} {beside:?}");
        }
    }
}

/// In shadow maps whose texels are larger than leaves, fewer and larger leaves cast as much shadow.
#[test]
fn leaves_smaller_than_texels_are_fewer_in_shadow_maps_and_shade_as_much() {
    let Some(mut renderer) = renderer() else { return };
    let mut of = |kinds: usize, resolution: u32| {
        let (mut sum, mut leaves) = (0.0, 0);
        for k in 0..2 {
            let mut scene = crown(kinds, 5000 * k);
            (scene.shadow_resolution, scene.sky, scene.msaa) = (resolution, None, 1);
            renderer.set_scene(&scene).expect("scene");
            let picture = renderer.render(&camera(Vec3::new(0.4, -1.0, 0.2), 4e3), 200, 200).expect("picture");
            sum += picture.hdr.iter().map(|p| f64::from(p[1])).sum::<f64>() / 2.0;
            leaves = renderer.stats().shadow_triangles / 2;
        }
        (sum, leaves)
    };
    // The maps are as wide as the crown, 1.2 m, and a rim of two texels on each side.
    let resolution = 24;
    let wide = 2.0 * 10.0 * std::f64::consts::SQRT_2 / (1200.0 / f64::from(resolution - 4));
    let (full, all) = of(100, resolution);
    let (thin, few) = of(1, resolution);
    let wanted = LEAVES as f64 * (wide / 1.5).powi(2);
    // Light that passes a crown is as random as the shadows of the leaves.
    let scatter = 0.58 / (2.0 * few as f64).sqrt();
    println!("{few} leaves ({wanted:.0} expected) cast the light {:+.1} %", 100.0 * (thin / full - 1.0));
    assert_eq!(all, LEAVES as u64);
    assert!((few as f64 / wanted - 1.0).abs() < 0.15, "{few} {wanted}");
    assert!((thin / full - 1.0).abs() < 3.0 * scatter + 0.01, "{full} {thin}");
}

#[test]
fn what_is_outside_the_view_is_not_drawn_but_casts_its_shadow() {
    let Some(mut renderer) = renderer() else { return };
    // A leaf in view, a leaf behind the camera that shades it, and many leaves outside the view.
    let mut scene = scene_of(uniform_leaf());
    let at = |p: Vec3| Instance { transform: Mat4::from_translation(p), ..scene.instances[0] };
    let mut instances = vec![at(Vec3::ZERO), at(Vec3::new(0.0, 0.0, 400.0))];
    let plain = instances.clone();
    instances.extend((0..40).map(|k| at(Vec3::new(300.0 + 25.0 * k as f32, 0.0, 0.0))));
    scene.sun = Some(sun(Vec3::Z));
    (scene.shadow_samples, scene.shadow_resolution) = (4, 2048);
    let camera = camera(Vec3::new(0.3, 0.0, 1.0), 200.0);
    let mut draw = |instances: &[Instance]| {
        scene.instances = instances.to_vec();
        renderer.set_scene(&scene).expect("scene");
        let picture = renderer.render(&camera, 64, 64).expect("picture");
        (picture, renderer.stats().triangles)
    };
    let (alone, lit) = draw(&plain[..1]);
    let (shaded, one) = draw(&plain);
    let (crowded, same) = draw(&instances);
    assert_eq!((lit, one, same), (2, 2, 2));
    let middle = |p: &Picture| p.radiance(32, 32)[1];
    assert!(middle(&shaded) < 0.1 * middle(&alone) && middle(&crowded) < 0.1 * middle(&alone));
    assert_eq!(alone.radiance(32, 32)[3], 1.0);
}
