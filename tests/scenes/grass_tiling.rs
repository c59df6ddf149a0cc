//! Irregular lawns: the meadow is moved in every rectangle, by the pass, by its twin and for the path tracer alike, and
//! what is drawn does not repeat.

use crate::grass_pass::beside_twins;
use crate::lawn::{GRASS, GROUND, STILL, file, lawn_of, renderer};
use glam::{DVec2, DVec3, Vec3};
use mesophyll::fits::grass::blades::LawnMeadow;
use mesophyll::fits::grass::irregularity::{SHIFTS, shifted};
use mesophyll::fits::grass::march::{LawnSlices, SliceAxis, SliceCrossing};
use mesophyll::fits::grass::{Options, baked, optics, plant};
use mesophyll::proof::pictures::repeats::{autocorrelation, largest};
use mesophyll::scene::draw::reference;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::leaf::LeafSearch;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll_viewer::Backend;
use mesophyll_viewer::scene::{Camera, Grass};
use std::sync::Arc;

/// The corner between four rectangles is in the middle of the cameras' pictures.
fn irregular() -> String {
    let grass = GRASS.replace("slices = 5", "slices = 8\nirregular_seed = 5").replace("[31, -17]", "[91, 33]");
    let grass = grass.replace("[401, 401]", "[101, 101]");
    assert!(grass.contains("irregular_seed") && grass.contains("[91, 33]"));
    grass
}

#[test]
fn an_irregular_lawn_is_its_twin() {
    let dir = tempfile::tempdir().unwrap();
    beside_twins(Backend::Any, &[0, 1], lawn_of(dir.path(), &irregular()), STILL);
}

/// All 64 ways to move a rectangle are equally likely, and neighbours are independent: they are alike as often as any
/// two. Limits are four standard deviations of counts.
#[test]
fn rectangles_are_moved_at_random() {
    let side = 128i64;
    let all = || (0..side * side).map(|k| [k % side - 40, k / side - 90]);
    let mut counts = [0.0f64; SHIFTS * SHIFTS];
    all().for_each(|at| {
        let [x, y] = shifted(3, at);
        counts[y * SHIFTS + x] += 1.0;
    });
    let expected = (side * side) as f64 / 64.0;
    let chi2: f64 = counts.iter().map(|n| (n - expected).powi(2) / expected).sum();
    assert!((chi2 - 63.0).abs() < 4.0 * (2.0 * 63.0f64).sqrt(), "{chi2}");
    for [dx, dy] in [[1, 0], [0, 1], [1, 1], [2, 0], [0, 2]] {
        let alike = all().filter(|[x, y]| shifted(3, [*x, *y]) == shifted(3, [x + dx, y + dy])).count() as f64;
        assert!((alike - expected).abs() < 4.0 * expected.sqrt(), "{dx} {dy}: {alike}");
    }
}

/// Two seeds give two lawns that have nothing in common: wherever one of them is laid over the other, rectangles are
/// alike as often as by chance, one in 64. 24 x 24 rectangles are compared at all 49 x 49 places up to 24 rectangles
/// away, with the next seed, with one that differs in its highest bit, and with another one. The limit is six
/// standard deviations, which chance exceeds once in 10^8 places.
#[test]
fn seeds_give_lawns_that_have_nothing_in_common() {
    let (side, most) = (24i64, 24i64);
    let expected = (side * side) as f64 / 64.0;
    let limit = expected + 6.0 * (expected * 63.0 / 64.0).sqrt();
    for [a, b] in [[3, 4], [7, 8], [0, 1], [5, 5 | 1 << 31], [1, 2_000_000_001]] {
        let lawn = |seed: u32, reach: i64| -> Vec<[usize; 2]> {
            let n = side + 2 * reach;
            (0..n * n).map(|k| shifted(seed, [k % n - reach, k / n - reach])).collect()
        };
        let (first, second) = (lawn(a, 0), lawn(b, most));
        let alike = |dx: i64, dy: i64| {
            let at = |k: i64| (k / side + dy + most) * (side + 2 * most) + k % side + dx + most;
            (0..side * side).filter(|k| first[*k as usize] == second[at(*k) as usize]).count()
        };
        let places = (-most..=most).flat_map(|dx| (-most..=most).map(move |dy| [dx, dy]));
        let (found, [dx, dy]) = places.map(|[dx, dy]| (alike(dx, dy), [dx, dy])).max().unwrap();
        println!("seeds {a} and {b}: at most {found} of {} alike, {dx} and {dy} rectangles apart", side * side);
        assert!((found as f64) < limit, "seeds {a} and {b}: {found} alike, {dx} and {dy} rectangles apart");
    }
}

fn slices() -> LawnSlices {
    let dir = tempfile::tempdir().unwrap();
    file(dir.path(), GRASS, GROUND);
    let path = dir.path().join("meadow.toml");
    let meadow = LawnMeadow::new(&path, &plant(&path).unwrap(), &optics::read(None).unwrap()).unwrap();
    baked(&meadow, &Options { slices: 8, texels: [32, 16], rays: 1, ..Options::default() })
}

/// A place in a rectangle shows what the meadow has at the moved place, on slices of all kinds.
#[test]
fn slices_show_the_meadow_moved() {
    let plain = slices();
    let moved = LawnSlices { irregular: Some(9), ..plain.clone() };
    let step = [0, 1].map(|k| plain.period[k] / plain.count as f64);
    for k in 0..300i64 {
        let across = [SliceAxis::X, SliceAxis::Y, SliceAxis::Z][k as usize % 3];
        let index = if across == SliceAxis::Z { 0 } else { k * 7 % 61 - 30 };
        let f = |a: f64| (k as f64 * a).fract();
        let mut place = DVec3::new(900.0 * f(0.7549) - 450.0, 900.0 * f(0.5698) - 450.0, plain.height * f(0.3247));
        if across != SliceAxis::Z {
            let axis = across as usize;
            place[axis] = (index as f64 + 0.5) * step[axis] - 0.5 * plain.period[axis];
        }
        let period = DVec2::from(plain.period);
        let rectangle = (place.truncate() / period + 0.5).floor().to_array().map(|n| n as i64);
        let by = shifted(9, rectangle);
        let from = SliceCrossing { t: 0.0, across, index, place, lean: DVec2::ZERO };
        let slices = if across == SliceAxis::Z { 0 } else { by[across as usize] as i64 };
        let to = SliceCrossing {
            index: index + slices,
            place: place + (DVec2::new(by[0] as f64, by[1] as f64) / 8.0 * period).extend(0.0),
            ..from
        };
        let [found, right] = [moved.texel(&from, [1.0; 2], 0.0), plain.texel(&to, [1.0; 2], 0.0)];
        assert!(found.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-9), "{k}: {found:?} {right:?}");
    }
}

/// The path tracer has every blade once in every rectangle, where the moved meadow has it; from parts, as without wind,
/// or rectangle by rectangle, as in the wind.
#[test]
fn blades_stand_where_slices_show_them() {
    let dir = tempfile::tempdir().unwrap();
    let grass = irregular().replace("[101, 101]", "[3, 2]");
    let path = file(dir.path(), &grass, GROUND);
    let ledger = Ledger::new();
    let scene = LoadedScene::open(SceneManifest::read(&path).unwrap(), LeafSearch::default(), &ledger).unwrap();
    let lawn = &scene.placed.grass[0];
    let period = DVec2::from(lawn.period);
    let mut right = Vec::new();
    for (k, place) in lawn.places().enumerate() {
        let by = shifted(5, [(k % 3) as i64, (k / 3) as i64]);
        for leaf in &lawn.plant.leaves {
            let stands = lawn.place_in(leaf, k);
            let share = stands.w_axis.truncate().truncate() / period;
            assert!(share.abs().max_element() <= 0.5 + 1e-9, "{share}");
            let moved = share + DVec2::new(by[0] as f64, by[1] as f64) / 8.0;
            let turns = moved - leaf.transform.w_axis.truncate().truncate() / period;
            assert!((turns - turns.round()).length() < 1e-9, "{turns}");
            let mesh = &lawn.plant.blades[leaf.blade].mesh;
            right.extend(mesh.positions.iter().map(|p| (place * stands).transform_point3(*p)));
        }
    }
    let world = reference::traced(&scene, 0.0, &ledger).unwrap();
    let blades = world.instances.iter().filter(|i| world.ground.is_none_or(|g| world.instances[g].leaf != i.leaf));
    let points = |i: &mesophyll::transport::ReferencePlacement| {
        let transform = i.transform;
        world.leaves[i.leaf].mesh.positions.iter().map(move |p| transform.transform_point3(*p)).collect::<Vec<_>>()
    };
    let mut found: Vec<DVec3> = blades.flat_map(points).collect();
    let order = |a: &DVec3, b: &DVec3| a.x.total_cmp(&b.x);
    found.sort_by(order);
    right.sort_by(order);
    assert_eq!(found.len(), right.len());
    assert!(found.iter().zip(&right).all(|(a, b)| (a.x - b.x).abs() < 1e-6));
    let sum = |all: &[DVec3]| all.iter().map(|p| DVec3::new(p.x * p.y, p.y * p.z, p.z * p.x)).sum::<DVec3>();
    assert!((sum(&found) - sum(&right)).length() < 1e-6 * sum(&right).length());
}

/// Rectangles that are all alike repeat; irregular ones do not. A sixty-fourth of neighbours is alike by chance. All
/// other pairs show places of the meadow that have nothing in common: the colour of places farther apart than a blade
/// is long (52 mm) is independent, so a rectangle of 120 x 100 mm has four independent places or more, and the
/// correlation of two rectangles has a standard deviation of a half at most. The limit is four standard deviations of
/// both over the pairs of neighbours.
#[test]
fn an_irregular_lawn_does_not_repeat() {
    let Some(mut renderer) = renderer() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (rectangles, period) = (16usize, [8usize, 8]);
    let pairs = (rectangles * (rectangles - 1)) as f64;
    let most = 1.0 / 64.0 + 4.0 * (1.0 / 64.0 / pairs).sqrt() + 4.0 * 0.5 / pairs.sqrt();
    let grass = GRASS.replace("[401, 401]", "[18, 18]").replace("[31, -17]", "[0, 0]").replace("= 5", "= 8");
    let mut drawn = lawn_of(dir.path(), &grass).0;
    drawn.sky = Some([1.0; 3]);
    for irregular in [None, Some(5)] {
        let grass = drawn.grass[0].as_ref().clone();
        drawn.grass = vec![Arc::new(Grass { irregular, ..grass })];
        renderer.set_scene(&drawn).unwrap();
        // A rectangle is 16 pixels wide, and 13 1/3 high: pictures of three rectangles upwards repeat after 40 pixels.
        let above = Camera {
            eye: Vec3::new(0.0, 0.0, 40_004.0),
            target: Vec3::new(0.0, 0.0, 4.0),
            up: Vec3::Y,
            fov_y_deg: 2.0 * (0.5f32 * 1600.0 / 40_000.0).atan().to_degrees(),
        };
        let (w, h) = (16 * rectangles, 40 * rectangles / 3);
        let picture = renderer.render(&above, w as u32, h as u32).unwrap();
        let green: Vec<f64> = picture.hdr.iter().map(|p| f64::from(p[1])).collect();
        let at = [[16, 0], [32, 0], [0, 40]].map(|lag| autocorrelation(&green, w, lag));
        println!("irregular {irregular:?}: {at:.3?}, limit {most:.3}");
        assert!(at.iter().all(|v| if irregular.is_some() { *v < most } else { *v > 0.9 }), "{at:?}");
    }
    // The same by parallel rays in double precision: without an error of drawing, the regular lawn is the same.
    let plain = slices();
    for irregular in [None, Some(5)] {
        let slices = LawnSlices { irregular, ..plain.clone() };
        let n = rectangles * period[0];
        let seen = |k: usize| {
            let at = |k: usize, axis: usize| (k as f64 + 0.3) / period[axis] as f64 * slices.period[axis];
            let origin = DVec3::new(at(k % n, 0), at(k / n, 1), slices.height);
            slices.march(origin, DVec3::new(0.3, 0.2, -1.0).normalize(), 64, 0.0, |_, t| [t[1], t[2], t[3]]).colour[1]
        };
        let green: Vec<f64> = (0..n * n).map(seen).collect();
        let found = largest(&green, n, period);
        println!("rays, irregular {irregular:?}: {found:.3}");
        assert!(if irregular.is_some() { found < most } else { found > 1.0 - 1e-6 }, "{irregular:?}: {found}");
    }
}
