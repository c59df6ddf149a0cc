//! What a scene does not need is neither created nor uploaded, and cannot change its picture.

mod common;

use common::*;
use glam::{Mat4, Vec3};
use mesophyll_viewer::scene::{Instance, Interior, Leaf, Scene};
use mesophyll_viewer::{Picture, Renderer};

/// A leaf with everything: gloss and normals on both sides.
fn full_leaf() -> Leaf {
    let mut leaf = uniform_leaf();
    for side in [&mut leaf.front, &mut leaf.back] {
        side.gloss = Some((0..64).map(|i| [0.05, 0.05, 0.05, 0.2 + 0.002 * i as f32]).collect());
        side.normal =
            Some((0..64).map(|i| Vec3::new(0.02 * (i % 5) as f32, 0.03, 1.0).normalize().to_array()).collect());
    }
    leaf
}

fn lit(leaf: Leaf) -> Scene {
    let mut scene = scene_of(leaf);
    scene.sun = Some(sun(Vec3::new(-0.4, 0.3, 1.0)));
    scene.sky = Some([0.4, 0.5, 0.6]);
    scene.shadow_samples = 3;
    scene
}

fn draw(renderer: &mut Renderer, scene: &Scene) -> Picture {
    renderer.set_scene(scene).expect("scene");
    renderer.render(&camera(Vec3::new(0.5, 0.1, 1.0), 55.0), 40, 40).expect("picture")
}

fn names(renderer: &Renderer) -> Vec<&str> {
    renderer.stats().uploads.iter().map(|u| u.name.as_str()).collect()
}

#[test]
fn everything_when_everything_is_there() {
    let Some(mut renderer) = renderer() else { return };
    draw(&mut renderer, &lit(full_leaf()));
    let stats = renderer.stats();
    assert_eq!(
        stats.pipelines,
        ["shadow: opaque", "main: sun, shadow 3, sky, front gloss normal, back gloss normal, beckmann", "tonemap"]
    );
    for part in
        ["front gloss", "back gloss", "front normal", "back normal", "front gamma_delta", "albedo table", "tangents"]
    {
        assert!(stats.uploaded(part), "{part} missing");
    }
    assert_eq!((stats.shadow_renders, stats.draws), (1, 5));
}

#[test]
fn without_a_sun_no_shadow_and_no_normal_where_nothing_shines() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(full_leaf());
    scene.sun = None;
    scene.leaves[0].back.gloss = None;
    draw(&mut renderer, &scene);
    assert_eq!(renderer.stats().pipelines, ["main: sky, front gloss normal, beckmann", "tonemap"]);
    assert_eq!(renderer.stats().shadow_renders, 0);
    assert!(
        !renderer.stats().uploaded("back normal") && !renderer.stats().uploaded("back gloss"),
        "{:?}",
        names(&renderer)
    );
}

#[test]
fn without_a_sky_no_albedo_table_and_without_gloss_no_lobe() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(full_leaf());
    scene.sky = None;
    draw(&mut renderer, &scene);
    assert!(!renderer.stats().uploaded("albedo"), "{:?}", names(&renderer));
    scene.leaves[0].front.gloss = None;
    // A gloss map without gloss in it is a matte side too.
    scene.leaves[0].back.gloss = Some(vec![[0.0, 0.0, 0.0, 0.3]; 64]);
    scene.leaves[0].front.normal = None;
    scene.leaves[0].back.normal = None;
    scene.shadow_samples = 0;
    draw(&mut renderer, &scene);
    assert_eq!(renderer.stats().pipelines, ["main: sun", "tonemap"]);
    assert!(!renderer.stats().uploaded("gloss") && !renderer.stats().uploaded("tangents"), "{:?}", names(&renderer));
}

#[test]
fn in_the_dark_no_map_at_all() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(full_leaf());
    (scene.sun, scene.sky) = (None, None);
    let picture = draw(&mut renderer, &scene);
    assert_eq!(picture.radiance(20, 20), [0.0, 0.0, 0.0, 1.0]);
    assert_eq!(
        names(&renderer),
        ["positions", "normals", "uvs", "indices", "instances"].map(|n| format!("leaf 0 {n}"))
    );
}

#[test]
fn a_leaf_that_stands_nowhere_is_not_uploaded() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(uniform_leaf());
    scene.leaves.push(full_leaf());
    draw(&mut renderer, &scene);
    assert!(!renderer.stats().uploaded("leaf 1"), "{:?}", names(&renderer));
    assert_eq!(renderer.stats().pipelines, ["shadow: opaque", "main: sun, shadow 3, sky", "tonemap"]);
}

#[test]
fn upload_sizes_are_the_maps_sizes() {
    let Some(mut renderer) = renderer() else { return };
    draw(&mut renderer, &lit(full_leaf()));
    // 8×8 and its mips: 64 + 16 + 4 + 1 texels of four channels, 4 or 2 bytes each.
    let gloss = renderer.stats().uploads.iter().find(|u| u.name == "leaf 0 front gloss").expect("gloss");
    assert!(gloss.bytes == 85 * 16 || gloss.bytes == 85 * 8, "{}", gloss.bytes);
}

/// Draws `scene`, then with `change`, and says whether the bytes differ.
fn changes(renderer: &mut Renderer, scene: &Scene, change: impl Fn(&mut Scene)) -> bool {
    let before = draw(renderer, scene);
    let mut other = scene.clone();
    change(&mut other);
    let after = draw(renderer, &other);
    before.hdr != after.hdr || before.ldr != after.ldr
}

#[test]
fn unneeded_maps_cannot_change_the_picture_and_needed_ones_do() {
    let Some(mut renderer) = renderer() else { return };
    let full = lit(full_leaf());
    let tilt = |s: &mut Scene| s.leaves[0].front.normal = Some(vec![[0.6, 0.0, 0.8]; 64]);
    let shine = |s: &mut Scene| s.leaves[0].front.gloss = Some(vec![[0.2, 0.2, 0.2, 0.3]; 64]);
    let thicken = |s: &mut Scene| s.leaves[0].front.gamma_delta.fill([1.0, 1.0, 1.0, 0.05]);
    let tangent = |s: &mut Scene| s.leaves[0].mesh.tangents.fill(glam::Vec4::new(0.0, 1.0, 0.0, 1.0));
    assert!(changes(&mut renderer, &full, tilt));
    assert!(changes(&mut renderer, &full, shine));
    assert!(changes(&mut renderer, &full, thicken));
    assert!(changes(&mut renderer, &full, tangent));
    assert!(changes(&mut renderer, &full, |s| s.exposure = 1.5));

    let mut overcast = lit(uniform_leaf());
    overcast.sun = None;
    overcast.leaves[0].front.normal = full.leaves[0].front.normal.clone();
    assert!(!changes(&mut renderer, &overcast, tilt), "no sun, no gloss: the normal is not seen");
    assert!(!changes(&mut renderer, &overcast, tangent));
    assert!(!changes(&mut renderer, &overcast, |s| s.shadow_samples = 9));
    assert!(changes(&mut renderer, &overcast, thicken));

    let mut pigments = lit(uniform_leaf());
    let leaf = &mut pigments.leaves[0];
    for side in [&mut leaf.front, &mut leaf.back] {
        side.interior = Interior::Maps { rho_d: vec![RHO_D; 64], rho_t: vec![RHO_T; 64] };
    }
    assert!(!changes(&mut renderer, &pigments, thicken), "pigment maps hold the thickness already");
    assert!(changes(&mut renderer, &pigments, |s| {
        s.leaves[0].front.interior = Interior::Maps { rho_d: vec![BACK_D; 64], rho_t: vec![RHO_T; 64] }
    }));

    let mut spare = full.clone();
    spare.leaves.push(full_leaf());
    assert!(!changes(&mut renderer, &spare, |s| s.leaves[1].thickness_mm = 3.0));
}

#[test]
fn thousands_of_leaves_are_one_draw() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(uniform_leaf());
    scene.instances = (0..4000)
        .map(|i| Instance {
            leaf: 0,
            transform: Mat4::from_translation(Vec3::new((i % 63) as f32, (i / 63) as f32, (i % 7) as f32))
                * Mat4::from_scale(Vec3::splat(0.02)),
            ride: None,
        })
        .collect();
    draw(&mut renderer, &scene);
    assert_eq!(renderer.stats().draws, 3 + 1 + 1, "three shadow maps, one main draw, one tone map");
}

#[test]
fn shadow_maps_are_kept_until_the_sun_moves() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(uniform_leaf());
    let camera = camera(Vec3::new(0.5, 0.1, 1.0), 55.0);
    renderer.set_scene(&scene).expect("scene");
    for _ in 0..3 {
        renderer.render(&camera, 16, 16).expect("picture");
    }
    scene.exposure = 2.0;
    scene.sky = Some([0.1; 3]);
    renderer.set_lights(&scene).expect("lights");
    renderer.render(&camera, 16, 16).expect("picture");
    assert_eq!(renderer.stats().shadow_renders, 1);
    scene.sun = Some(sun(Vec3::new(0.4, 0.3, 1.0)));
    renderer.set_lights(&scene).expect("lights");
    let moved = renderer.render(&camera, 16, 16).expect("picture");
    assert_eq!(renderer.stats().shadow_renders, 2);
    // Taking over a change gives the picture that the changed scene gives afresh.
    renderer.set_scene(&scene).expect("scene");
    assert_eq!(moved, renderer.render(&camera, 16, 16).expect("picture"));
}

#[test]
fn taking_over_a_leaf_is_as_good_as_a_new_scene() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(uniform_leaf());
    let camera = camera(Vec3::new(0.5, 0.1, 1.0), 55.0);
    renderer.set_scene(&scene).expect("scene");
    let before = renderer.render(&camera, 24, 24).expect("picture");
    scene.leaves[0].front.gloss = full_leaf().front.gloss;
    scene.leaves[0].thickness_mm = 0.22;
    renderer.set_leaf(&scene, 0).expect("leaf");
    let taken = renderer.render(&camera, 24, 24).expect("picture");
    renderer.set_scene(&scene).expect("scene");
    let fresh = renderer.render(&camera, 24, 24).expect("picture");
    assert!(before != taken && taken == fresh);
}

#[test]
fn timing_reports_every_frame_and_pass() {
    let Some(mut renderer) = renderer() else { return };
    renderer.set_scene(&lit(full_leaf())).expect("scene");
    let timing = renderer.time(&camera(Vec3::new(0.5, 0.1, 1.0), 55.0), 64, 48, 4).expect("times");
    assert_eq!(timing.frame_ms.len(), 4);
    assert!(timing.quantile(0.5) <= timing.quantile(0.95) && timing.quantile(0.5) > Some(0.0));
    if !timing.passes.is_empty() {
        let found: Vec<(&str, usize)> = timing.passes.iter().map(|(n, t)| (n.as_str(), t.len())).collect();
        assert_eq!(found, [("shadow", 1), ("main", 4), ("tonemap", 4)]);
        let sum: f64 = timing.passes[1..].iter().flat_map(|(_, t)| t).sum();
        assert!(sum > 0.0 && sum <= 1.05 * timing.frame_ms.iter().sum::<f64>(), "{timing:?}");
    }
}
