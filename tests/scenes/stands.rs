//! Plants that stand in many places, as the path tracer is given them.

use glam::{DMat4, DVec3};
use mesophyll::fits::leaf::blade::{BladeMesh, glb};
use mesophyll::scene::draw::reference;
use mesophyll::scene::loaded::LoadedScene;
use mesophyll::scene::manifest::SceneManifest;
use mesophyll::scene::placed::groups::{PlantGroups, SHARED};
use mesophyll::scene::placed::leaf::LeafSearch;
use mesophyll::scene::placed::ledger::Ledger;
use mesophyll::scene::placed::plant::planted;
use mesophyll::transport::comparison::flip_map;
use mesophyll::transport::{Options, ReferencePlace, ReferenceRenderer, ReferenceWorld};

/// Ninety twigs of eight leaves in two groups of a wind, or still in a scene that repeats.
fn opened(rest: &str) -> (tempfile::TempDir, LoadedScene) {
    opened_on([6000, 4000], rest)
}

/// The same on an area (mm).
fn opened_on(area: [u32; 2], rest: &str) -> (tempfile::TempDir, LoadedScene) {
    let folder = tempfile::tempdir().unwrap();
    let blade = BladeMesh {
        positions: vec![[-9.0, 0.0, 0.0], [9.0, 0.0, 0.0], [9.0, 30.0, 0.0], [-9.0, 30.0, 2.0]],
        normals: vec![[0.0, 0.0, 1.0]; 4],
        tangents: vec![[1.0, 0.0, 0.0, 1.0]; 4],
        uvs: vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        indices: vec![0, 1, 2, 0, 2, 3],
        ..BladeMesh::default()
    };
    glb::write(&folder.path().join("blade.glb"), "sheet", &blade).unwrap();
    let plants = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("data/plants/elm-twig.toml");
    let text = format!(
        "schema = 1\nname = \"stand\"\n[[leaf]]\nname = \"sheet\"\nmesh = \"blade.glb\"\n\
         uniform = {{ rho_d = [[0.1, 0.3, 0.1], [0.2, 0.3, 0.2]], rho_t = [0.1, 0.2, 0.1] }}\n\
         [[plant]]\ngrow = \"{}\"\nmaterials = {{ leaf = \"sheet\", bark = [0.1, 0.1, 0.1] }}\ncount = 90\n\
         area_mm = {area:?}\nscales = [0.5, 2]\nseed = 4\n\
         [sun]\nzenith_deg = 40\nirradiance = [3, 3, 3]\n{rest}",
        plants.display()
    );
    let mut manifest = SceneManifest::parse(&text, &folder.path().join("scene.toml")).unwrap();
    if manifest.views.is_empty() {
        manifest.look_from_above();
    }
    let scene = LoadedScene::open(manifest, LeafSearch::default(), &Ledger::new()).unwrap();
    (folder, scene)
}

const VIEW: &str = "[[view]]\nkind = \"perspective\"\nname = \"v\"\neye_mm = [0, -9000, 2000]\n\
                    target_mm = [0, 0, 300]\nfov_deg = 40\n";

/// Every leaf of the stands in the world, place by place.
fn leaves(world: &ReferenceWorld) -> Vec<Vec<DMat4>> {
    let of = |place: &ReferencePlace| {
        world.groups[place.group].iter().filter(|m| m.leaf == 0).map(|m| place.transform * m.transform).collect()
    };
    world.places.iter().map(of).collect()
}

/// The plants that the scene is planned with stand in the world exactly where the wind carries them, by way of the
/// sections of the scene. The world holds each pose once.
#[test]
fn a_plant_is_stored_once_for_each_pose_and_stands_where_the_wind_carries_it() {
    let wind = format!("[wind]\nspeed_m_s = 6\nseed = 3\n[ground]\nalbedo = [0.1, 0.1, 0.1]\nreach_mm = 9000\n{VIEW}");
    let (_folder, scene) = opened(&wind);
    let stand = &scene.placed.stands[0];
    let (twig, poses) = (stand.leaves.len(), stand.poses);
    let world = reference::traced(&scene, 2.5, &Ledger::new()).unwrap();
    world.validate().unwrap();
    assert_eq!((world.instances.len(), world.groups.len(), world.places.len()), (1, poses, 90));
    assert!(world.groups.iter().all(|group| group.len() == twig + stand.wood.len()));
    let all = leaves(&world);
    let near: Vec<DMat4> = scene
        .placed
        .placements
        .iter()
        .filter(|p| p.frame > 0)
        .map(|p| scene.placed.at_time(p, 2.5).transform)
        .collect();
    assert!(near.len() == 8 * twig && twig == 8);
    for plant in near.chunks(twig) {
        let same = |place: &&Vec<DMat4>| place.iter().zip(plant).all(|(a, b)| a.abs_diff_eq(*b, 1e-7));
        assert_eq!(all.iter().filter(same).count(), 1);
    }
    // At another time everything has moved, and the plants are as many.
    let later = leaves(&reference::traced(&scene, 3.5, &Ledger::new()).unwrap());
    let moved = |(a, b): (&Vec<DMat4>, &Vec<DMat4>)| a.iter().zip(b).any(|(a, b)| !a.abs_diff_eq(*b, 1e-3));
    assert!(later.len() == all.len() && all.iter().zip(&later).all(moved));
}

/// In a scene that repeats plants that stand still are stored once; in a wind each has its own turn and pose.
#[test]
fn a_canopy_holds_a_plant_once() {
    let periodic = "[periodic]\nsize_mm = [6000, 4000]\n[ground]\nalbedo = [0.1, 0.1, 0.1]\n";
    let (_folder, scene) = opened(periodic);
    let world = reference::traced(&scene, 0.0, &Ledger::new()).unwrap();
    world.validate().unwrap();
    assert_eq!((world.instances.len(), world.groups.len(), world.places.len()), (1, 1, 90));
    let (_folder, blown) = opened(&format!("{periodic}[wind]\nspeed_m_s = 6\nseed = 3\n"));
    let world = reference::traced(&blown, 0.0, &Ledger::new()).unwrap();
    assert!(world.places.is_empty() && world.instances.len() > 90 * 8);
}

/// How far a shared pose is from one of each plant's own, in which the same gusts arrive exactly when the wind brings
/// them: the root mean square over leaves, plants and times, of the distance and of what the leaves move.
fn apart(shared: &LoadedScene, own: &LoadedScene) -> [f64; 2] {
    let at = |scene: &LoadedScene, time: f64| -> Vec<Vec<DVec3>> {
        let world = reference::unlit(scene, time, &Ledger::new()).unwrap();
        leaves(&world).iter().map(|plant| plant.iter().map(|m| m.w_axis.truncate()).collect()).collect()
    };
    let times = [3.0, 11.0, 40.0, 95.0, 230.0, 500.0];
    let [a, b] = [shared, own].map(|scene| times.map(|time| at(scene, time)));
    let (mut off, mut moved, mut count) = (0.0, 0.0, 0.0);
    for plant in 0..a[0].len() {
        for leaf in 0..a[0][plant].len() {
            let mean = (0..times.len()).map(|t| b[t][plant][leaf]).sum::<DVec3>() / times.len() as f64;
            for t in 0..times.len() {
                off += a[t][plant][leaf].distance_squared(b[t][plant][leaf]);
                moved += b[t][plant][leaf].distance_squared(mean) * times.len() as f64 / (times.len() - 1) as f64;
                count += 1.0;
            }
        }
    }
    [off, moved].map(|sum| (sum / count).sqrt())
}

/// A scene with poses of its own for each of the ninety plants. `delay` says when gusts arrive that the wind brings at
/// a time (s).
fn alone(mut own: LoadedScene, delay: impl Fn(f64) -> f64) -> (LoadedScene, PlantGroups) {
    let ledger = Ledger::new();
    let mut plants = planted(&own.manifest, &ledger).unwrap();
    let groups = plants[0].groups.clone().unwrap();
    let wind = own.manifest.wind.as_ref().unwrap();
    let delay = |place: &DMat4| delay(place.w_axis.truncate().dot(wind.direction()) / 1e3 / wind.speed_m_s);
    plants[0].groups = Some(PlantGroups {
        of_place: (0..90).collect(),
        leaders: plants[0].places.clone(),
        delays: plants[0].places.iter().map(delay).collect(),
        off: 0.0,
        near: groups.near.clone(),
    });
    let manifest = own.manifest.clone();
    own.placed.replant(&manifest, &plants, &ledger).unwrap();
    (own, groups)
}

/// What sharing poses costs: leaves are off by what a gust does within the time by which it comes too early or too
/// late. Independent motions would be off by √2 of what leaves move. A picture is as far from the exact one as that of
/// another moment: no farther, and not much nearer either.
#[test]
fn sharing_poses_costs_as_much_as_another_moment() {
    let (_folder, shared) = opened(&format!("[wind]\nspeed_m_s = 6\nseed = 3\n{VIEW}"));
    let (_other, own) = opened(&format!("[wind]\nspeed_m_s = 6\nseed = 3\n{VIEW}"));
    let ledger = Ledger::new();
    let (own, groups) = alone(own, |time| time);
    assert_eq!((shared.placed.stands[0].poses, own.placed.stands[0].poses), (groups.leaders.len(), 90));
    let [off, moved] = apart(&shared, &own);
    let [none, _] = apart(&own, &own);
    let camera = own.manifest.perspectives().next().unwrap().camera;
    let options = Options { samples_per_pixel: 4, sun_samples: 1, ..Options::default() };
    let picture = |scene: &LoadedScene, time: f64| {
        let world = reference::unlit(scene, time, &ledger).unwrap();
        ReferenceRenderer::new(&world).unwrap().render(&camera, 240, 160, &options).unwrap().ldr
    };
    let [exact, near, later] = [picture(&own, 8.0), picture(&shared, 8.0), picture(&own, 60.0)];
    let mean = |a: &[[u8; 4]], b: &[[u8; 4]]| {
        let flip = flip_map(a, b, 240, 160);
        flip.iter().map(|v| f64::from(*v)).sum::<f64>() / flip.len() as f64
    };
    let [cost, moment] = [mean(&exact, &near), mean(&exact, &later)];
    eprintln!("late by {:.2} s, off by {off:.2} of {moved:.2} mm, FLIP {cost:.4} of {moment:.4}", groups.off);
    let independent = 2f64.sqrt() * moved;
    assert!(none == 0.0 && (0.5..1.15).contains(&(off / independent)), "{off} mm of {moved} mm");
    assert!((0.5..1.2).contains(&(cost / moment)), "{cost} {moment}");
    // The plants nearest to the camera have poses of their own in both.
    let [a, b] = [&shared, &own].map(|scene| leaves(&reference::unlit(scene, 8.0, &ledger).unwrap()));
    for place in &groups.near {
        assert!(a[*place].iter().zip(&b[*place]).all(|(a, b)| a.abs_diff_eq(*b, 1e-7)));
    }
}

/// What is slow in the motion of some plants: the mean place of a tip over four seconds, at some times, less the mean
/// over all of them. There are several readings in each period of the resonance, so that it leaves the means alone.
fn slow(scene: &LoadedScene, places: &[usize]) -> Vec<Vec<DVec3>> {
    let plants = planted(&scene.manifest, &Ledger::new()).unwrap();
    let trunk = &plants[0].plant.branches[0];
    let [t, r, s] = trunk.axes;
    let end = trunk.axis.last().unwrap();
    let tip = trunk.root + t * end.x + r * end.y + s * end.z;
    let winds = scene.placed.moves().winds.unwrap();
    let of = |place: usize| -> Vec<DVec3> {
        let at = |time: f64| winds.pose(0, place, time).unwrap().at(0, 1.0).place(tip);
        let mean = |k: usize| (0..96).map(|j| at(k as f64 * 7.0 + f64::from(j) / 24.0)).sum::<DVec3>() / 96.0;
        let all: Vec<DVec3> = (0..24).map(mean).collect();
        let middle = all.iter().sum::<DVec3>() / all.len() as f64;
        all.into_iter().map(|p| p - middle).collect()
    };
    places.iter().copied().map(of).collect()
}

/// Gusts run over the land with the wind: what is slow in the motion of a plant that shares its pose is what it would
/// be alone, though the gust may be a second early or late. With gusts that come from the wrong side it is not. Poses
/// repeat after 24 s, and so do the gusts that both are held against.
#[test]
fn gusts_run_over_the_land_with_the_wind() {
    let wind = format!("[wind]\nspeed_m_s = 6\nseed = 3\n{VIEW}");
    let open = || opened_on([120_000, 80_000], &wind);
    let ((_a, shared), (_b, own), (_c, wrong)) = (open(), open(), open());
    let circle = SHARED as f64;
    let (own, groups) = alone(own, |time| time.rem_euclid(circle));
    let (wrong, _) = alone(wrong, |time| (-time).rem_euclid(circle));
    let places: Vec<usize> = (0..90).step_by(3).filter(|place| !groups.near.contains(place)).collect();
    let shared = slow(&shared, &places);
    let alike = |other: &LoadedScene| {
        let other = slow(other, &places);
        let (mut both, mut a, mut b) = (0.0, 0.0, 0.0);
        for (p, q) in shared.iter().flatten().zip(other.iter().flatten()) {
            both += p.dot(*q);
            a += p.length_squared();
            b += q.length_squared();
        }
        both / (a * b).sqrt()
    };
    let [right, wrong] = [&own, &wrong].map(alike);
    eprintln!("late by {:.2} s, correlation {right:.3}, from the wrong side {wrong:.3}", groups.off);
    assert!(right > 0.5 && wrong < 0.25, "{right} {wrong}");
}
