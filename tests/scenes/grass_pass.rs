//! The grass pass on the adapter is compared with the same rays in double precision. Also, what a scene file may state
//! about a lawn.

use crate::common;
use crate::lawn::{
    GRASS, GROUND, Lean, SIDE, SOIL, STILL, agree, cameras, even, file, in_half, lawn, lawn_of, rays, renderer,
    renderer_on, twin,
};
use glam::{DVec2, DVec3, Vec2, Vec3, Vec4};
use mesophyll::fits::grass::judge::{lit, seen};
use mesophyll::fits::grass::march::{LawnSlices, SliceAxis, SliceCrossing, unleant};
use mesophyll::fits::grass::sheet::CHANNELS;
use mesophyll_viewer::Backend;
use mesophyll_viewer::scene::{Grass, GrassGusts, Material, Mesh, OpaqueMaterial, Scene as Drawn, Sun};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

#[test]
fn the_pass_is_its_twin_in_double_precision() {
    twins(Backend::Any, &[0, 1, 2, 3, 4, 5, 6]);
}

/// GL has other rules for negative numbers than Vulkan.
#[test]
fn the_pass_is_its_twin_on_gl() {
    twins(Backend::Gl, &[1, 2]);
}

fn twins(backend: Backend, which: &[usize]) {
    let dir = tempfile::tempdir().unwrap();
    beside_twins(backend, which, lawn(dir.path()), STILL);
}

/// A wind whose gusts lean blades by a third of their height. The map is small, so that the lean differs from place to
/// place.
#[test]
fn the_pass_in_the_wind_is_its_twin() {
    let dir = tempfile::tempdir().unwrap();
    let (mut drawn, slices) = lawn(dir.path());
    let mut grass = drawn.grass[0].as_ref().clone();
    let (origin, mean) = (grass.origin, DVec2::new(0.2, -0.1));
    let (size, side) = (8usize, 1500.0);
    let wave = |k: usize, turns: f64| (TAU * turns * (k as f64 + 0.5) / size as f64).sin();
    let added = |k: usize| [0.1 * wave(k % size, 1.0), 0.12 * wave(k / size, 1.0) + 0.05 * wave(k % size, 2.0)];
    let added: Vec<[f32; 2]> = (0..size * size).map(|k| added(k).map(|v| in_half(v as f32))).collect();
    let turned = DVec2::from_angle(0.4) / side;
    let gusts = GrassGusts {
        mean: mean.as_vec2().to_array(),
        size: size as u32,
        added: added.clone(),
        turn: [turned, turned.perp()],
        drift: DVec2::new(0.3, 0.1),
    };
    // The map at 1.7 s, as an adapter reads it: linear between texel centres, and repeated.
    let at = |place: DVec2| {
        let p = gusts.place(place + origin.truncate().as_dvec2(), 1.7) * size as f64 - 0.5;
        let (low, f) = (p.floor(), p - p.floor());
        let one = |x: f64, y: f64| {
            let k = |v: f64| v.rem_euclid(size as f64) as usize;
            let v = added[k(low.y + y) * size + k(low.x + x)];
            DVec2::new(f64::from(v[0]), f64::from(v[1]))
        };
        mean + one(0.0, 0.0).lerp(one(1.0, 0.0), f.x).lerp(one(0.0, 1.0).lerp(one(1.0, 1.0), f.x), f.y)
    };
    grass.gusts = Some(Arc::new(gusts.clone()));
    drawn.grass = vec![Arc::new(grass)];
    drawn.wind = Some(mesophyll_viewer::scene::WindState { time_s: 1.7 });
    // Cameras from above, across all slices, and from inside. The other cameras run the same code.
    beside_twins(Backend::Any, &[0, 4, 6], (drawn.clone(), slices), &at);
    // At another time, the map has moved, and the scene is not set again.
    let Some(mut renderer) = renderer() else { return };
    let camera = &cameras(Vec3::new(32.3, -16.1, 4.0), 50.0)[3];
    drawn.sky = Some([1.0; 3]);
    renderer.set_scene(&drawn).unwrap();
    let before = renderer.render(camera, SIDE, SIDE).unwrap().hdr;
    let mut wind = drawn.wind.unwrap();
    wind.time_s = 4.1;
    renderer.set_time(&wind);
    let after = renderer.render(camera, SIDE, SIDE).unwrap().hdr;
    drawn.wind = Some(wind);
    renderer.set_scene(&drawn).unwrap();
    assert!(before != after && after == renderer.render(camera, SIDE, SIDE).unwrap().hdr);
}

/// Draws a lawn under a sky and under a sun with some of the cameras, and compares each picture with its twin.
pub fn beside_twins(backend: Backend, which: &[usize], (mut drawn, slices): (Drawn, LawnSlices), lean: Lean) {
    let Some(mut renderer) = renderer_on(backend) else { return };
    let mut grass = drawn.grass[0].as_ref().clone();
    (grass.open, grass.soil_open, grass.scatter) = ([1.0; 17], 1.0, [0.0; 3]);
    let (origin, middle) = (grass.origin, Vec3::new(32.3, -16.1, 4.0));
    drawn.grass = vec![Arc::new(grass)];
    let cameras = cameras(middle, slices.height as f32);
    let sun = DVec3::new(0.5, -0.4, 0.7).normalize();
    let adapter = renderer.adapter().clone();
    for &k in which {
        let camera = &cameras[k];
        // An even sky: each of the two sides gets the part of it that is above.
        (drawn.sun, drawn.sky) = (None, Some([1.0; 3]));
        renderer.set_scene(&drawn).unwrap();
        let colour = |c: &SliceCrossing, t: &[f64; CHANNELS], d: DVec3| {
            let n = c.turned(DVec3::new(t[10], t[11], t[12]));
            let up = (n * -n.dot(d).signum()).normalize_or_zero().z;
            let reflected = seen(t, c.unleant(d));
            [0, 1, 2].map(|c: usize| reflected[c] * (0.5 + 0.5 * up) + t[7 + c] * (0.5 - 0.5 * up))
        };
        let right = twin(&slices, camera, origin, lean, colour, |_| 1.0);
        let right: Vec<[f64; 3]> = right.into_iter().map(|r| r.0).collect();
        agree(&format!("sky, camera {k}"), &adapter, &renderer.render(camera, SIDE, SIDE).unwrap().hdr, &right);
        // A sun whose light passes through the slices.
        drawn.sun = Some(Sun { direction: sun.as_vec3(), irradiance: [PI as f32; 3], radius: 0.0 });
        drawn.sky = None;
        renderer.set_scene(&drawn).unwrap();
        let colour = |c: &SliceCrossing, t: &[f64; CHANNELS], d: DVec3| lit(&slices, c, t, d, sun, 0.0);
        let soil = |place: DVec3| {
            let to = unleant(sun, lean(place.truncate()));
            sun.z * (1.0 - slices.march(place.with_z(0.0), to, 256, 0.0, |_, _| [0.0; 3]).opacity)
        };
        let right = twin(&slices, camera, origin, lean, colour, soil);
        let right: Vec<[f64; 3]> = right.into_iter().map(|r| r.0).collect();
        agree(&format!("sun, camera {k}"), &adapter, &renderer.render(camera, SIDE, SIDE).unwrap().hdr, &right);
    }
}

/// A black plate lies in the grass. It is visible where the blades before it let more than half of the light pass.
#[test]
fn a_plate_in_the_grass_is_hidden_where_opacity_passes_one_half() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (mut drawn, slices) = lawn(dir.path());
    let (origin, middle) = (drawn.grass[0].origin, Vec3::new(32.3, -16.1, 4.0));
    let at = 0.37 * slices.height;
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let plate = Mesh {
        positions: corners
            .iter()
            .map(|(x, y)| middle.truncate().extend(4.0 + at as f32) + 250.0 * Vec3::new(*x, *y, 0.0))
            .collect(),
        normals: vec![Vec3::Z; 4],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4],
        uvs: vec![Vec2::ZERO; 4],
        indices: vec![0, 1, 2, 0, 2, 3],
        ..Mesh::default()
    };
    let plate =
        drawn.add(plate, Material::Opaque(OpaqueMaterial { name: "plate".into(), albedo: [0.0; 3], pattern: None }));
    drawn.instances.push(plate);
    drawn.sky = Some([1.0; 3]);
    renderer.set_scene(&drawn).unwrap();
    let (mut shown, mut hidden) = (0, 0);
    for camera in &cameras(middle, slices.height as f32)[..6] {
        let picture = renderer.render(camera, SIDE, SIDE).unwrap().hdr;
        let depths = twin(&slices, camera, origin, STILL, |_, _, _| [0.0; 3], |_| 0.0);
        let mut wrong = 0;
        for ((pixel, (o, d)), (_, depth)) in picture.iter().zip(rays(camera, origin, slices.height)).zip(depths) {
            let plate = (at - o.z) / d.z;
            let seen = pixel[0] == 0.0;
            wrong += u32::from(seen != (plate < depth));
            *(if seen { &mut shown } else { &mut hidden }) += 1;
        }
        assert!(wrong <= 12, "{wrong} of {} pixels", SIDE * SIDE);
    }
    assert!(shown > 500 && hidden > 500, "{shown} pixels show the plate, {hidden} do not");
}

/// The ground hides a sun below the horizon, whose light would otherwise reach the blades through the ground.
#[test]
fn a_sun_below_the_horizon_lights_no_blade() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (mut drawn, slices) = lawn(dir.path());
    let (origin, middle) = (drawn.grass[0].origin, Vec3::new(32.3, -16.1, 4.0));
    for camera in &cameras(middle, slices.height as f32) {
        for zenith in [80.0f64, 130.0] {
            let (sin, cos) = zenith.to_radians().sin_cos();
            let sun = DVec3::new(0.6 * sin, 0.8 * sin, cos);
            drawn.sun = Some(Sun { direction: sun.as_vec3(), irradiance: [PI as f32; 3], radius: 0.0 });
            renderer.set_scene(&drawn).unwrap();
            let seen = renderer.render(camera, SIDE, SIDE).unwrap().hdr;
            let dark = seen.iter().all(|p| p[..3] == [0.0; 3]);
            assert_eq!(dark, zenith > 90.0, "sun at {zenith}°, {camera:?}");
            let colour = |c: &SliceCrossing, t: &[f64; CHANNELS], d: DVec3| lit(&slices, c, t, d, sun, 0.0);
            let right = twin(&slices, camera, origin, STILL, colour, |_| 0.0);
            assert_eq!(right.iter().all(|p| p.0 == [0.0; 3]), zenith > 90.0, "twin, sun at {zenith}°");
        }
    }
}

/// With one step, a ray that has more slices ahead shows the colour of the blades that it gathered, however few. A ray
/// that crosses at most one slice on its way to the ground shows the ground behind it.
#[test]
fn a_ray_that_is_cut_off_shows_the_colour_that_it_gathered() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (mut drawn, mut slices) = lawn(dir.path());
    let middle = Vec3::new(32.3, -16.1, 4.0);
    // Blades with reflectance 1 that face up, with this small opacity everywhere, under a sky of 1. Their colour is 1.
    let opacity = 0.002;
    let base = drawn.grass[0].as_ref().clone();
    let thin = Grass {
        upright: even(&base.upright, opacity),
        level: base.level.as_ref().map(|l| even(l, opacity)),
        cover: [opacity; 17],
        level_cover: opacity,
        steps: 1,
        open: [1.0; 17],
        soil_open: 1.0,
        scatter: [0.0; 3],
        ..base
    };
    let origin = thin.origin;
    (drawn.grass, drawn.sky) = (vec![Arc::new(thin)], Some([1.0; 3]));
    slices.cover = ([f64::from(opacity); 17], f64::from(opacity));
    let (mut filled, mut open) = (0, 0);
    for camera in &cameras(middle, slices.height as f32) {
        renderer.set_scene(&drawn).unwrap();
        let picture = renderer.render(camera, SIDE, SIDE).unwrap().hdr;
        let mut wrong = Vec::new();
        for (pixel, (o, d)) in picture.iter().zip(rays(camera, origin, slices.height)) {
            let crossed: Vec<SliceCrossing> = slices.crossings(o, d, None).take(2).collect();
            let [upright, level] = slices.weights(d);
            let gathered = crossed.first().map_or(0.0, |c| {
                let weight = if c.across == SliceAxis::Z { level } else { upright };
                1.0 - (1.0 - f64::from(opacity)).powf(weight)
            });
            let cut = crossed.len() > 1 && gathered >= 1e-3;
            let right = if cut { 1.0 } else { gathered + (1.0 - gathered) * SOIL[0] };
            *(if cut { &mut filled } else { &mut open }) += 1;
            if (f64::from(pixel[0]) - right).abs() > 2e-3 {
                wrong.push((pixel[0], right, gathered, crossed.len()));
            }
        }
        // A few rays pass so close to an edge that single precision counts another slice.
        assert!(wrong.len() <= 12, "{camera:?}: {} pixels, {:?}", wrong.len(), &wrong[..3]);
    }
    assert!(filled > 500 && open > 500, "{filled} pixels are filled, {open} show the ground");
}

/// The same slices as sorted and blended polygons: with other geometry and another order of the sums, the picture is
/// the same. The targets have half floats, in which a sum is rounded by at most 2^-11 of it and half of that on
/// average. Some twenty sums for each pixel, all rounded in one direction, give 5e-3 on average and 0.01 at most. A
/// pixel with twice that error has polygons whose middles give a wrong order. Theory does not say how many such pixels
/// there are, so the 2 % is only a guard.
#[test]
fn billboards_show_what_rays_see() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (mut drawn, slices) = lawn_of(dir.path(), &GRASS.replace("[401, 401]", "[5, 5]"));
    (drawn.msaa, drawn.sky) = (4, Some([1.0; 3]));
    drawn.sun = Some(Sun { direction: Vec3::new(0.5, -0.4, 0.7).normalize(), irradiance: [1.0; 3], radius: 0.0 });
    let cameras = cameras(Vec3::new(32.3, -16.1, 4.0), slices.height as f32);
    for camera in [&cameras[0], &cameras[1], &cameras[4]] {
        let mut show = |billboards: bool| {
            let grass = drawn.grass[0].as_ref().clone();
            drawn.grass = vec![Arc::new(Grass { billboards, ..grass })];
            renderer.set_scene(&drawn).unwrap();
            renderer.render(camera, SIDE, SIDE).unwrap().hdr
        };
        let (rays, boards) = (show(false), show(true));
        let white = rays.as_flattened().iter().fold(0.0f32, |a, b| a.max(*b));
        let apart = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max) / white;
        let errors: Vec<f32> = rays.iter().zip(&boards).map(apart).collect();
        let mean = errors.iter().sum::<f32>() / errors.len() as f32;
        let beyond = errors.iter().filter(|e| **e > 0.02).count() as f32 / errors.len() as f32;
        println!("mean {mean:.2e}, beyond 0.02: {:.2} %", 100.0 * beyond);
        assert!(mean < 5e-3 && beyond < 0.02, "{mean} {beyond}, {camera:?}");
    }
}

#[test]
fn a_scene_without_grass_has_nothing_of_the_pass() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (mut drawn, _) = lawn(dir.path());
    drawn.sky = Some([1.0; 3]);
    renderer.set_scene(&drawn).unwrap();
    assert!(renderer.stats().pipelines.contains(&"grass".to_string()) && renderer.stats().uploaded("level slice"));
    let mut upright = drawn.grass[0].as_ref().clone();
    upright.level = None;
    drawn.grass = vec![Arc::new(upright)];
    renderer.set_scene(&drawn).unwrap();
    assert!(renderer.stats().pipelines.contains(&"grass without a level slice".to_string()));
    assert!(renderer.stats().uploaded("upright slices") && !renderer.stats().uploaded("level slice"));
    assert!(!renderer.stats().uploaded("gusts") && !renderer.stats().pipelines.iter().any(|p| p.contains("wind")));
    let mut windy = drawn.grass[0].as_ref().clone();
    let still = [DVec2::ZERO; 2];
    let gusts = GrassGusts { mean: [0.1, 0.0], size: 1, added: vec![[0.0; 2]], turn: still, drift: DVec2::ZERO };
    windy.gusts = Some(Arc::new(gusts));
    drawn.grass = vec![Arc::new(windy)];
    renderer.set_scene(&drawn).unwrap();
    assert!(renderer.stats().pipelines.contains(&"grass without a level slice in the wind".to_string()));
    assert!(renderer.stats().uploaded("gusts"));
    drawn.grass.clear();
    renderer.set_scene(&drawn).unwrap();
    assert!(!renderer.stats().pipelines.iter().any(|p| p.contains("grass")) && !renderer.stats().uploaded("slice"));
}

#[test]
fn mistakes_about_a_lawn_are_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let fit = format!("fit = \"{}\"", dir.path().join("nowhere").display());
    for (grass, more, said) in [
        (GRASS.to_string(), "", "scene.toml:3: grass: given without a [ground]"),
        (GRASS.replace("[401, 401]", "[0, 401]"), GROUND, "grass.tiles: found [0, 401], expected 1 to 1000000"),
        (GRASS.replace("[64, 16]", "[60, 16]"), GROUND, "grass.texels: found [60, 16], expected powers of two"),
        (
            GRASS.replace("slices = 5", "slices = 64").replace("[64, 16]", "[1024, 1024]"),
            GROUND,
            "scene.toml: grass \"lawn\": texels: found [1024, 1024], which with slices = 64 makes ",
        ),
        (
            format!("{GRASS}lean_per_m_s = 2\n"),
            GROUND,
            "grass.lean_per_m_s: found 2, expected 0 to 1 of the height per",
        ),
        (
            format!("{GRASS}lean_per_m_s = 0.3\n"),
            &format!("{GROUND}[wind]\nspeed_m_s = 4\nseed = 1\n"),
            "grass \"lawn\": lean_per_m_s: found 0.3, with which tips go by 2.",
        ),
        (
            format!("{GRASS}irregular_seed = 1\n"),
            GROUND,
            "grass.slices: found 5, expected a multiple of 8 beside irregular",
        ),
        (
            GRASS.replace("slices = 5", "slices = 8\nirregular_seed = 1"),
            GROUND,
            "grass.tiles: found [401, 401], expected 1 to 15625 rectangles",
        ),
        (GRASS.replace("[31, -17]", "[1e300, 0]"), GROUND, "grass.position_mm: found [1e300, 0.0], expected numbers"),
        (
            GRASS.to_string(),
            &format!("{GROUND}hill = {{ height_mm = 500, radius_mm = 100 }}\n"),
            "ground.hill.height_mm: found 500, expected -100 to 100 mm",
        ),
        (
            format!("{GRASS}lean_per_m_s = 0.01\n"),
            &format!("{GROUND}hill = {{ height_mm = 50, radius_mm = 100 }}\n[wind]\nspeed_m_s = 4\nseed = 1\n"),
            "ground.hill: given beside a lawn that the wind leans",
        ),
        (GRASS.replace("[31, -17]", "[nan, 0]"), GROUND, "grass.position_mm: found [NaN, 0.0], expected numbers from "),
        (GRASS.replace("[401, 401]", "[9223372036854775807, 2]"), GROUND, "807, 2], expected 1 to 1000000 rectangles"),
        (GRASS.replace("[401, 401]", "[1000000, 1]"), GROUND, "reaches 60000031 mm from the origin; expected at most"),
        (GRASS.replace("steps = 256", "steps = 0"), GROUND, "grass.steps: found 0, expected 1 to 256 slices"),
        (GRASS.replace("slices = 5", &fit), GROUND, "grass.texels: given beside a fit"),
        (GRASS.replace("slices = 5\ntexels = [64, 16]", &fit), GROUND, "there is no fit at "),
        (GRASS.replace("meadow.toml", "moss.toml"), GROUND, "moss.toml: no such file"),
        (GRASS.to_string(), "[ground]\nalbedo = [0, 0, 0]\n[periodic]\nsize_mm = [9, 9]\n", "given beside [periodic]"),
    ] {
        let path = file(dir.path(), &grass, more);
        let out = dir.path().join("out");
        let (scene, folder) = (path.to_str().unwrap(), out.to_str().unwrap());
        for words in [vec!["render", scene, "-o", folder], vec!["plan", scene]] {
            let output = common::run(words);
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{said}: {told}");
            assert!(told.contains(said) && told.lines().count() == 1, "{said}: {told}");
        }
        assert_eq!(std::fs::read_dir(&out).map_or(0, Iterator::count), 0, "something was written");
    }
}
