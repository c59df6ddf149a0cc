//! A lawn on a hill: the pass beside its twin in double precision, and where blades and ground are.

use crate::lawn::{GRASS, GROUND, SIDE, SOIL, agree, even, file, lawn_with, rays, renderer};
use crate::skips;
use glam::{DVec2, DVec3, Vec3};
use mesophyll::fits::grass::hill::Hill;
use mesophyll::fits::grass::judge::seen;
use mesophyll::fits::grass::march::{SliceAxis, SliceCrossing};
use mesophyll::fits::grass::sheet::CHANNELS;
use mesophyll::proof::pictures::ridge::{LawnSilhouettes, silhouettes};
use mesophyll::scene::draw::reference;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::leaf::LeafSearch;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll_viewer::scene::{Camera, Grass, Sun};
use std::f32::consts::PI;
use std::sync::Arc;

const HILL: &str = "hill = { height_mm = 90, radius_mm = 150, position_mm = [20, -10] }\n";
const TOP: Vec3 = Vec3::new(20.0, -10.0, 94.0);

/// The slope is the derivative of the height, and nowhere larger than at the radius.
#[test]
fn the_slope_of_a_hill() {
    let hill = Hill { middle: DVec2::new(20.0, -10.0), height: 90.0, radius: 150.0 };
    for at in [DVec2::new(25.0, -3.0), DVec2::new(-130.0, 40.0), DVec2::new(170.0, -10.0)] {
        let along = |by: DVec2| (hill.rise(at + by) - hill.rise(at - by)) / 2e-3;
        let right = DVec2::new(along(DVec2::X * 1e-3), along(DVec2::Y * 1e-3));
        assert!((hill.slope(at) - right).length() < 1e-6 && right.length() <= hill.steepest() + 1e-6, "{at}");
    }
    assert!((hill.slope(DVec2::new(170.0, -10.0)).length() - hill.steepest()).abs() < 1e-12);
}

/// Cameras from above, down a slope, over the ridge, where rays leave the lawn and come into it again far behind, up
/// to the ridge, behind which is nothing, and from afar just over the tips of level ground, where rays pass nearly
/// level over grass for 2 m before they reach the hill's foot. Pixels are smaller than texels.
#[test]
fn a_lawn_on_a_hill_is_its_twin() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let grass = GRASS.replace("[401, 401]", "[61, 61]");
    let (mut drawn, slices) = lawn_with(dir.path(), &grass, &format!("{GROUND}{HILL}"));
    let mut grass = drawn.grass[0].as_ref().clone();
    (grass.open, grass.soil_open, grass.scatter) = ([1.0; 17], 1.0, [0.0; 3]);
    let origin = grass.origin.as_dvec3();
    drawn.grass = vec![Arc::new(Grass { ..grass })];
    let hill = Hill { middle: DVec2::new(20.0, -10.0) - origin.truncate(), height: 90.0, radius: 150.0 };
    let sun = DVec3::new(0.5, -0.4, 0.5).normalize();
    let tips = Vec3::new(TOP.x, TOP.y, 4.0 + slices.height as f32 + 0.5);
    let one = |eye: Vec3, fov_y_deg: f32| Camera { eye: TOP + eye, target: TOP, up: Vec3::Y, fov_y_deg };
    let views = [
        one(Vec3::new(2.0, 1.0, 500.0), 9.0),
        one(Vec3::new(-300.0, -250.0, 200.0), 9.0),
        Camera { up: Vec3::Z, target: TOP + 47.0 * Vec3::Z, ..one(Vec3::new(100.0, -120.0, 80.0), 4.0) },
        Camera { up: Vec3::Z, target: TOP + 48.0 * Vec3::Z, ..one(Vec3::new(200.0, -240.0, 30.0), 7.0) },
        Camera { up: Vec3::Z, target: tips + Vec3::new(400.0, 0.0, 5.0), ..one(tips + 2500.0 * Vec3::X - TOP, 0.25) },
    ];
    for (k, camera) in views.iter().enumerate() {
        let [eye, target, up] = [camera.eye, camera.target, camera.up].map(Vec3::as_dvec3);
        let forward = (target - eye).normalize();
        let aside = forward.cross(up).normalize();
        let above = aside.cross(forward);
        let tan = (0.5 * f64::from(camera.fov_y_deg).to_radians()).tan();
        let share = |k: u32| (2.0 * (f64::from(k) + 0.5) / f64::from(SIDE) - 1.0) * tan;
        for sunlit in [false, true] {
            drawn.sun = sunlit.then(|| Sun { direction: sun.as_vec3(), irradiance: [PI; 3], radius: 0.0 });
            drawn.sky = (!sunlit).then_some([1.0; 3]);
            renderer.set_scene(&drawn).unwrap();
            let colour = |c: &SliceCrossing, t: &[f64; CHANNELS], d: DVec3| {
                let n = DVec3::new(t[10], t[11], t[12]);
                let n = (n * -n.dot(d).signum()).normalize_or_zero();
                let (reflected, through) = (seen(t, d), [t[7], t[8], t[9]]);
                if !sunlit {
                    return [0, 1, 2].map(|c| reflected[c] * (0.5 + 0.5 * n.z) + through[c] * (0.5 - 0.5 * n.z));
                }
                let arrives = slices.arriving_on(&hill, c, t, d, sun) * n.dot(sun).abs();
                (if n.dot(sun) > 0.0 { reflected } else { through }).map(|v| v * arrives)
            };
            let soil = |at: DVec2| {
                let normal = (-hill.slope(at)).extend(1.0).normalize();
                if sunlit { normal.dot(sun).max(0.0) * slices.on_ground(&hill, at, sun) } else { 1.0 }
            };
            let pixel = |k: u32| {
                let d = (forward + aside * share(k % SIDE) - above * share(k / SIDE)).normalize();
                let (found, ground) = slices.march_on(&hill, eye - origin, d, 3000.0, |c, t| colour(c, t, d));
                let mut out = found.colour;
                match ground.filter(|_| found.opacity <= 1.0 - 1e-4) {
                    Some(t) => {
                        let light = soil((eye - origin + d * t).truncate());
                        (0..3).for_each(|c| out[c] += (1.0 - found.opacity) * SOIL[c] * light);
                    }
                    None if found.opacity >= 0.5 => out = out.map(|v| v / found.opacity),
                    None => out = [0.0; 3],
                }
                out
            };
            let right: Vec<[f64; 3]> = (0..SIDE * SIDE).map(pixel).collect();
            let picture = renderer.render(camera, SIDE, SIDE).unwrap().hdr;
            let dark = right.iter().filter(|p| p[1] == 0.0).count();
            assert!(if k == 3 { dark > 100 } else { dark == 0 }, "{k}: {dark} pixels of sky");
            agree(&format!("hill, camera {k}, sun {sunlit}"), renderer.adapter(), &picture, &right);
        }
    }
}

/// A ray that is cut off after one slice, with next to nothing gathered, shows the ground, wherever the slope is.
#[test]
fn a_ray_that_is_cut_off_with_nothing_shows_the_hills_ground() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (mut drawn, _) = lawn_with(dir.path(), &GRASS.replace("[401, 401]", "[61, 61]"), &format!("{GROUND}{HILL}"));
    let base = drawn.grass[0].as_ref().clone();
    let opacity = 1e-5;
    drawn.grass = vec![Arc::new(Grass {
        upright: even(&base.upright, opacity),
        level: base.level.as_ref().map(|l| even(l, opacity)),
        cover: [opacity; 17],
        level_cover: opacity,
        steps: 1,
        open: [1.0; 17],
        soil_open: 1.0,
        scatter: [0.0; 3],
        ..base
    })];
    drawn.sky = Some([1.0; 3]);
    renderer.set_scene(&drawn).unwrap();
    for eye in [Vec3::new(2.0, 1.0, 500.0), Vec3::new(-300.0, -250.0, 200.0), Vec3::new(-900.0, 100.0, 150.0)] {
        let camera = Camera { eye: TOP + eye, target: TOP, up: Vec3::Y, fov_y_deg: 9.0 };
        let picture = renderer.render(&camera, SIDE, SIDE).unwrap().hdr;
        let wrong = picture.iter().filter(|p| (0..3).any(|c| (f64::from(p[c]) - SOIL[c]).abs() > 1e-3)).count();
        assert_eq!(wrong, 0, "{eye}");
    }
}

/// On a hill, a ray that leaves the lawn before the sky covers as many of a pixel's samples as its opacity says, in
/// the mean. An eye in the grass, 1.5 m from the hill, where the ground is level, looks up through blades with one
/// opacity everywhere. Rounding to four samples in 16 even steps is off by 1/128 at most, and so is the mean; at the
/// picture's edges, a part of a group of 4 x 4 pixels adds as much.
#[test]
fn blades_before_the_sky_cover_samples_as_their_opacity_says() {
    let Some(mut renderer) = renderer() else { return };
    if renderer.adapter().backend == "gl" {
        return skips::skip(skips::Need::Elsewhere, "OpenGL has no masks of samples");
    }
    let dir = tempfile::tempdir().unwrap();
    let grass = GRASS.replace("[401, 401]", "[61, 61]");
    let (mut drawn, mut slices) = lawn_with(dir.path(), &grass, &format!("{GROUND}{HILL}"));
    let opacity = 0.04;
    let base = drawn.grass[0].as_ref().clone();
    let thin = Grass {
        upright: even(&base.upright, opacity),
        level: base.level.as_ref().map(|l| even(l, opacity)),
        cover: [opacity; 17],
        level_cover: opacity,
        open: [1.0; 17],
        soil_open: 1.0,
        scatter: [0.0; 3],
        ..base
    };
    let origin = thin.origin;
    (drawn.grass, drawn.sky, drawn.msaa) = (vec![Arc::new(thin)], Some([1.0; 3]), 4);
    slices.cover = ([f64::from(opacity); 17], f64::from(opacity));
    renderer.set_scene(&drawn).unwrap();
    let eye = Vec3::new(1535.3, -23.1, 4.0 + 0.3 * slices.height as f32);
    for up in [0.2, 0.5, 1.5] {
        let camera = Camera { eye, target: eye + Vec3::new(1.0, 0.4, up), up: Vec3::Z, fov_y_deg: 15.0 };
        let picture = renderer.render(&camera, SIDE, SIDE).unwrap().hdr;
        let of = |(o, d): (DVec3, DVec3)| {
            let [upright, level] = slices.weights(d);
            let weight = |c: SliceCrossing| if c.across == SliceAxis::Z { level } else { upright };
            1.0 - (1.0 - f64::from(opacity)).powf(slices.crossings(o, d, None).map(weight).sum())
        };
        let n = f64::from(SIDE * SIDE);
        let right = rays(&camera, origin, slices.height).into_iter().map(of).sum::<f64>() / n;
        let covered = picture.iter().map(|p| f64::from(p[3])).sum::<f64>() / n;
        println!("{up}: covered {covered:.4}, opacity {right:.4}");
        assert!((0.05..0.45).contains(&right), "{right}");
        assert!((covered - right).abs() < 1.0 / 64.0, "{up}: covered {covered}, opacity {right}");
    }
}

/// Grass stands out over the bare hill, and slices show most of it. How much they may miss is a guard: theory does not
/// say it.
#[test]
fn grass_stands_out_over_the_ridge() {
    let Some(mut renderer) = renderer() else { return };
    let LawnSilhouettes { bare, blades, slices } = silhouettes(&mut renderer, 90).unwrap();
    println!("bare {bare:.2}, blades {blades:.2}, slices {slices:.2}");
    assert!(bare > 1.0 && blades > bare + 2.0, "bare {bare}, blades {blades}");
    assert!(slices > bare + 0.75 * (blades - bare) && slices < blades + 0.25, "bare {bare}, {blades}, {slices}");
}

/// For the path tracer every blade stands on the hill with its foot, and the ground is where the hill is.
#[test]
fn blades_and_ground_follow_the_hill() {
    let dir = tempfile::tempdir().unwrap();
    let grass = GRASS.replace("[401, 401]", "[3, 2]");
    let path = file(dir.path(), &grass, &format!("{GROUND}{HILL}"));
    let scene = LoadedScene::open(SceneManifest::read(&path).unwrap(), LeafSearch::default(), &Ledger::new()).unwrap();
    let world = reference::traced(&scene, 0.0, &Ledger::new()).unwrap();
    let hill =
        |at: DVec2| 4.0 + 90.0 * (-at.distance_squared(DVec2::new(20.0, -10.0)) / (2.0 * 150.0f64.powi(2))).exp();
    let ground = world.ground.unwrap();
    let points = |k: usize| {
        let i = &world.instances[k];
        world.leaves[i.leaf].mesh.positions.iter().map(|p| i.transform.transform_point3(*p)).collect::<Vec<_>>()
    };
    assert!(points(ground).iter().all(|p| (p.z - hill(p.truncate())).abs() < 1e-9));
    // A blade has 7 rows of 3 points, of which the first row is its foot.
    let per_lawn = scene.placed.grass[0].plant.leaves.len();
    let mut blades = 0;
    for k in (0..world.instances.len()).filter(|k| *k != ground) {
        for blade in points(k).chunks(21) {
            blades += 1;
            let stands = blade[0].z - hill(blade[0].truncate());
            assert!(stands.abs() < 2.0, "{stands}");
        }
    }
    assert_eq!(blades, 6 * per_lawn);
}
