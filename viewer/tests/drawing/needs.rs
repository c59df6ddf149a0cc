//! A part that a scene does not need is neither created nor uploaded, and cannot change the picture.

use crate::common::*;
use glam::{Mat4, Vec3};
use mesophyll_viewer::scene::{Instance, Interior, LeafMaterial, Material, OpaqueMaterial, Scene, Side, SideMaps};
use mesophyll_viewer::{Picture, Renderer};

/// A leaf with everything: gloss and normals on both sides.
fn full_leaf() -> LeafMaterial {
    let mut leaf = uniform_leaf();
    for side in [&mut leaf.sides.front, &mut leaf.sides.back] {
        side.gloss = Some((0..64).map(|i| [0.05, 0.05, 0.05, 0.2 + 0.002 * i as f32]).collect());
        side.normal =
            Some((0..64).map(|i| Vec3::new(0.02 * (i % 5) as f32, 0.03, 1.0).normalize().to_array()).collect());
    }
    leaf
}

fn lit(leaf: LeafMaterial) -> Scene {
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

/// Bloom moves light from bright pixels to those around them, and changes neither their sum nor the radiance. A scene
/// without it has no such pass.
#[test]
fn bloom_moves_light_in_the_displayed_picture_alone() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(full_leaf());
    scene.exposure = 0.5;
    let look = |renderer: &mut Renderer, scene: &Scene| {
        renderer.set_scene(scene).expect("scene");
        renderer.render(&camera(Vec3::new(0.1, 0.1, 1.0), 400.0), 96, 64).expect("picture")
    };
    let plain = look(&mut renderer, &scene);
    assert!(!names_of_pipelines(&renderer).contains(&"bloom".to_string()));
    scene.bloom = Some(0.3);
    let bloom = look(&mut renderer, &scene);
    assert!(names_of_pipelines(&renderer).contains(&"bloom".to_string()));
    assert!(plain.hdr == bloom.hdr);
    let light = |byte: u8| {
        let v = f64::from(byte) / 255.0;
        let x = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
        x / (1.0 - x)
    };
    let sum = |p: &Picture| p.ldr.iter().map(|c| light(c[1])).sum::<f64>();
    let (before, after) = (sum(&plain), sum(&bloom));
    assert!(before > 1.0 && (after / before - 1.0).abs() < 0.03, "{before} {after}");
    // The leaf is in the middle; it loses light, and the dark pixels around it gain some.
    let at = |p: &Picture, x: usize, y: usize| light(p.ldr[y * 96 + x][1]);
    assert!(at(&bloom, 48, 32) < 0.95 * at(&plain, 48, 32));
    let edge = (0..48).find(|x| at(&plain, *x, 32) > 0.0).expect("a leaf");
    assert!(edge > 8 && at(&plain, edge - 3, 32) == 0.0 && at(&bloom, edge - 3, 32) > 0.0, "{edge}");
    scene.bloom = None;
    assert!(look(&mut renderer, &scene).ldr == plain.ldr);
    scene.bloom = Some(1.5);
    assert!(renderer.set_scene(&scene).unwrap_err().to_string().contains("bloom"));
}

fn names_of_pipelines(renderer: &Renderer) -> Vec<String> {
    renderer.stats().pipelines.iter().map(|p| p.to_string()).collect()
}

#[test]
fn without_a_sun_no_shadow_and_no_normal_where_nothing_shines() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(full_leaf());
    scene.sun = None;
    leaf(&mut scene, 0).sides.back.gloss = None;
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
    leaf(&mut scene, 0).sides.front.gloss = None;
    // A gloss map in which all gloss is 0 makes a matte side too.
    leaf(&mut scene, 0).sides.back.gloss = Some(vec![[0.0, 0.0, 0.0, 0.3]; 64]);
    leaf(&mut scene, 0).sides.front.normal = None;
    leaf(&mut scene, 0).sides.back.normal = None;
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
        ["instances", "positions", "normals", "indices", "uvs"].map(|n| if n == "instances" {
            "instances of mesh 0".into()
        } else {
            format!("mesh 0 {n}")
        })
    );
}

#[test]
fn a_leaf_that_stands_nowhere_is_not_uploaded() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(uniform_leaf());
    scene.materials.push(Material::Leaf(full_leaf()));
    draw(&mut renderer, &scene);
    assert!(!renderer.stats().uploaded("leaf 1"), "{:?}", names(&renderer));
    assert_eq!(renderer.stats().pipelines, ["shadow: opaque", "main: sun, shadow 3, sky", "tonemap"]);
}

#[test]
fn upload_sizes_are_the_maps_sizes() {
    let Some(mut renderer) = renderer() else { return };
    draw(&mut renderer, &lit(full_leaf()));
    // 8×8 texels and their mips: 64 + 16 + 4 + 1 texels of four channels, with 4 or 2 bytes each.
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
    let tilt = |s: &mut Scene| leaf(s, 0).sides.front.normal = Some(vec![[0.6, 0.0, 0.8]; 64]);
    let shine = |s: &mut Scene| leaf(s, 0).sides.front.gloss = Some(vec![[0.2, 0.2, 0.2, 0.3]; 64]);
    let thicken = |s: &mut Scene| leaf(s, 0).sides.front.gamma_delta.fill([1.0, 1.0, 1.0, 0.05]);
    let tangent = |s: &mut Scene| s.meshes[0].tangents.fill(glam::Vec4::new(0.0, 1.0, 0.0, 1.0));
    assert!(changes(&mut renderer, &full, tilt));
    assert!(changes(&mut renderer, &full, shine));
    assert!(changes(&mut renderer, &full, thicken));
    assert!(changes(&mut renderer, &full, tangent));
    assert!(changes(&mut renderer, &full, |s| s.exposure = 1.5));

    let mut overcast = lit(uniform_leaf());
    overcast.sun = None;
    leaf(&mut overcast, 0).sides.front.normal = full_leaf().sides.front.normal;
    assert!(!changes(&mut renderer, &overcast, tilt), "no sun, no gloss: the normal is not seen");
    assert!(!changes(&mut renderer, &overcast, tangent));
    assert!(!changes(&mut renderer, &overcast, |s| s.shadow_samples = 9));
    assert!(changes(&mut renderer, &overcast, thicken));

    let mut pigments = lit(uniform_leaf());
    for (_, side) in leaf(&mut pigments, 0).sides.iter_mut() {
        side.interior = Interior::Maps { rho_d: vec![RHO_D; 64], rho_t: vec![RHO_T; 64] };
    }
    assert!(!changes(&mut renderer, &pigments, thicken), "pigment maps hold the thickness already");
    assert!(changes(&mut renderer, &pigments, |s| {
        leaf(s, 0).sides.front.interior = Interior::Maps { rho_d: vec![BACK_D; 64], rho_t: vec![RHO_T; 64] }
    }));

    let mut spare = full.clone();
    spare.materials.push(Material::Leaf(full_leaf()));
    assert!(!changes(&mut renderer, &spare, |s| leaf(s, 1).thickness_mm = 3.0));
}

#[test]
fn thousands_of_leaves_are_one_draw() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(uniform_leaf());
    scene.instances = (0..4000)
        .map(|i| Instance {
            mesh: 0,
            material: 0,
            transform: Mat4::from_translation(Vec3::new((i % 63) as f32, (i / 63) as f32, (i % 7) as f32))
                * Mat4::from_scale(Vec3::splat(0.02)),
            ..Instance::default()
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
    // A change that is taken over gives the same picture as the changed scene set anew.
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
    leaf(&mut scene, 0).sides.front.gloss = full_leaf().sides.front.gloss;
    leaf(&mut scene, 0).thickness_mm = 0.22;
    renderer.set_material(&scene, 0).expect("leaf");
    let taken = renderer.render(&camera, 24, 24).expect("picture");
    renderer.set_scene(&scene).expect("scene");
    let fresh = renderer.render(&camera, 24, 24).expect("picture");
    assert!(before != taken && taken == fresh);
}

/// The names of what an edit uploads.
fn uploaded(renderer: &mut Renderer, scene: &Scene) -> Vec<String> {
    let before = renderer.stats().uploads.len();
    renderer.set_material(scene, 0).expect("material");
    renderer.stats().uploads[before..].iter().map(|u| u.name.clone()).collect()
}

#[test]
fn a_slider_uploads_what_it_moves() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(full_leaf());
    renderer.set_scene(&scene).expect("scene");
    let all = renderer.stats().uploads.len();
    assert!(uploaded(&mut renderer, &scene).is_empty(), "nothing moved");
    // An edit of h, σa and σs: the editor solves the slab again and returns curves.
    for (side, name) in [(Side::Front, "front"), (Side::Back, "back")] {
        let leaf = leaf(&mut scene, 0);
        leaf.thickness_mm += 0.01;
        leaf.sides[side].interior = Interior::Scalars(curve(leaf.thickness_mm, BACK_T, RHO_T));
        assert_eq!(uploaded(&mut renderer, &scene), [format!("leaf 0 {name} slab curve")]);
    }
    // An edit of h alone within the range of the curve uploads no texture.
    leaf(&mut scene, 0).thickness_mm += 0.001;
    assert!(uploaded(&mut renderer, &scene).is_empty());
    // An edit of ρs on one side uploads its gloss. So does an edit of m within the range of the albedo table.
    let gloss = leaf(&mut scene, 0).sides.front.gloss.as_mut().expect("gloss");
    gloss.iter_mut().for_each(|t| t[0] *= 0.5);
    gloss[0][3] = 0.21;
    assert_eq!(uploaded(&mut renderer, &scene), ["leaf 0 front gloss"]);
    // A roughness outside the table's range needs a new albedo table too.
    leaf(&mut scene, 0).sides.back.gloss.as_mut().expect("gloss")[0][3] = 0.9;
    assert_eq!(uploaded(&mut renderer, &scene), ["leaf 0 back gloss", "leaf 0 albedo table"]);
    // Normals on a leaf that had none need the mesh's tangents, which are uploaded once.
    let mut plain = lit(uniform_leaf());
    renderer.set_scene(&plain).expect("scene");
    for (map, want) in [(0.1, vec!["leaf 0 front normal", "mesh 0 tangents"]), (0.2, vec!["leaf 0 front normal"])] {
        leaf(&mut plain, 0).sides.front.normal = Some(vec![Vec3::new(map, 0.0, 1.0).normalize().to_array(); 64]);
        assert_eq!(uploaded(&mut renderer, &plain), want);
    }
    // The changes that were taken over give the same picture as a new scene.
    let view = camera(Vec3::new(0.5, 0.1, 1.0), 55.0);
    for scene in [&scene, &plain] {
        let mut other = scene.clone();
        leaf(&mut other, 0).sides = full_leaf().sides;
        renderer.set_scene(&other).expect("scene");
        let first = renderer.stats().uploads.len();
        renderer.set_material(scene, 0).expect("material");
        assert!(renderer.stats().uploads.len() - first < all);
        let taken = renderer.render(&view, 24, 24).expect("picture");
        renderer.set_scene(scene).expect("scene");
        assert_eq!(taken, renderer.render(&view, 24, 24).expect("picture"));
    }
}

/// An opaque surface has a pipeline without a leaf's code, without maps and without texture coordinates. Meshes are
/// uploaded once, whatever the number of their materials.
#[test]
fn bark_needs_no_maps() {
    let Some(mut renderer) = renderer() else { return };
    let mut scene = lit(full_leaf());
    scene.materials.push(Material::Opaque(OpaqueMaterial {
        name: "bark".into(),
        albedo: [0.3, 0.2, 0.1],
        pattern: None,
    }));
    let bark = Instance { material: 1, transform: Mat4::from_translation(25.0 * Vec3::X), ..scene.instances[0] };
    scene.instances.push(bark);
    draw(&mut renderer, &scene);
    let name = "main: opaque, sun, shadow 3, sky";
    assert!(renderer.stats().pipelines.iter().any(|p| p == name), "{:?}", renderer.stats().pipelines);
    assert_eq!(names(&renderer).iter().filter(|n| n.contains("positions")).count(), 1);
    scene.instances = vec![bark];
    draw(&mut renderer, &scene);
    assert_eq!(renderer.stats().pipelines, ["shadow: opaque", name, "tonemap"]);
    let found = names(&renderer);
    assert_eq!(found, ["instances of mesh 0", "mesh 0 positions", "mesh 0 normals", "mesh 0 indices"]);
}

/// Bark reflects ρ/π of the sun's light and ρ of the sky's, on its outside only. It looks the same as a leaf whose one
/// texel has this reflectance.
#[test]
fn bark_looks_like_a_matte_leaf_of_one_texel() {
    let Some(mut renderer) = renderer() else { return };
    let albedo = [0.3, 0.2, 0.1];
    let mut leaf = uniform_leaf();
    (leaf.width, leaf.height) = (1, 1);
    leaf.sides.front =
        SideMaps { interior: Interior::Maps { rho_d: vec![albedo], rho_t: vec![[0.0; 3]] }, ..SideMaps::black() };
    leaf.sides.back = SideMaps::black();
    let mut bark = lit(leaf.clone());
    bark.materials = vec![Material::Opaque(OpaqueMaterial { name: "bark".into(), albedo, pattern: None })];
    for (eye, sun_from) in [(Vec3::Z, Vec3::new(-0.4, 0.3, 1.0)), (Vec3::Z, -Vec3::Z), (-Vec3::Z, -Vec3::Z)] {
        let view = camera(eye + 0.3 * Vec3::X, 60.0);
        let mut picture = |scene: &Scene| {
            let scene = Scene { sun: Some(sun(sun_from)), ..scene.clone() };
            renderer.set_scene(&scene).expect("scene");
            renderer.render(&view, 24, 24).expect("picture")
        };
        let (a, b) = (picture(&lit(leaf.clone())), picture(&bark));
        for (a, b) in a.hdr.iter().zip(&b.hdr) {
            assert!((0..4).all(|c| (a[c] - b[c]).abs() <= 2e-3 * a[c].abs()), "{a:?} {b:?}");
        }
        assert_eq!(b.radiance(12, 12)[0] > 0.0, eye.z > 0.0, "its inside is black");
    }
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
