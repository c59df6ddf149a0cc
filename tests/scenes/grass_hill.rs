//! A lawn on a hill: the pass beside its twin in double precision, and where blades and ground are.

use crate::lawn::{GRASS, GROUND, SIDE, SOIL, agree, file, lawn_with, renderer};
use glam::{DVec2, DVec3, Vec3};
use mesophyll::fit_grass::hill::Hill;
use mesophyll::fit_grass::judge::seen;
use mesophyll::fit_grass::march::Crossing;
use mesophyll::fit_grass::sheet::CHANNELS;
use mesophyll::manifest::Manifest;
use mesophyll::placed::leaf::Search;
use mesophyll::placed::ledger::Ledger;
use mesophyll::scene::draw::reference;
use mesophyll::scene::loaded::Scene;
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

/// Cameras from above, down a slope, over the ridge, where rays leave the lawn and come into it again far behind, and
/// up to the ridge, behind which is nothing. Pixels are smaller than texels.
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
    let one = |eye: Vec3, fov_y_deg: f32| Camera { eye: TOP + eye, target: TOP, up: Vec3::Y, fov_y_deg };
    let views = [
        one(Vec3::new(2.0, 1.0, 500.0), 9.0),
        one(Vec3::new(-300.0, -250.0, 200.0), 9.0),
        Camera { up: Vec3::Z, target: TOP + 47.0 * Vec3::Z, ..one(Vec3::new(100.0, -120.0, 80.0), 4.0) },
        Camera { up: Vec3::Z, target: TOP + 48.0 * Vec3::Z, ..one(Vec3::new(200.0, -240.0, 30.0), 7.0) },
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
            let colour = |c: &Crossing, t: &[f64; CHANNELS], d: DVec3| {
                let n = DVec3::new(t[10], t[11], t[12]);
                let n = (n * -n.dot(d).signum()).normalize_or_zero();
                let (reflected, through) = (seen(t, d), [t[7], t[8], t[9]]);
                if !sunlit {
                    return [0, 1, 2].map(|c| reflected[c] * (0.5 + 0.5 * n.z) + through[c] * (0.5 - 0.5 * n.z));
                }
                let own = hill.sheared(sun, c.place.truncate());
                let arrives = slices.arriving(c, t, d, own, 0.0) * n.dot(sun).abs();
                (if n.dot(sun) > 0.0 { reflected } else { through }).map(|v| v * arrives)
            };
            let soil = |at: DVec2| {
                let own = hill.sheared(sun, at);
                let normal = (-hill.slope(at)).extend(1.0).normalize();
                let passes = 1.0 - slices.march(at.extend(0.0), own, 256, 0.0, |_, _| [0.0; 3]).opacity;
                if sunlit { normal.dot(sun).max(0.0) * passes } else { 1.0 }
            };
            let pixel = |k: u32| {
                let d = (forward + aside * share(k % SIDE) - above * share(k / SIDE)).normalize();
                let (found, ground) = slices.march_on(&hill, eye - origin, d, 2500.0, |c, t| colour(c, t, d));
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
            agree(&format!("hill, camera {k}, sun {sunlit}"), renderer.adapter().half_precision, &picture, &right);
        }
    }
}

/// For the path tracer every blade stands on the hill with its foot, and the ground is where the hill is.
#[test]
fn blades_and_ground_follow_the_hill() {
    let dir = tempfile::tempdir().unwrap();
    let grass = GRASS.replace("[401, 401]", "[3, 2]");
    let path = file(dir.path(), &grass, &format!("{GROUND}{HILL}"));
    let scene = Scene::open(Manifest::read(&path).unwrap(), Search::default(), &Ledger::new()).unwrap();
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
