//! A transfer is read as it was written, and it is made again when something that it was made from has changed.

use super::*;
use glam::{DMat4, DVec2, DVec3};
use mesophyll_files::mesh::LeafMesh;
use mesophyll_transport::lobe::Lobe;
use mesophyll_transport::world::{ReferenceInterior, ReferenceLeaf, ReferencePlacement, ReferenceSide};

fn scene() -> TransferScene {
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let side = || ReferenceSide {
        interior: ReferenceInterior::Maps {
            rho_d: [vec![0.1], vec![0.4], vec![0.1]],
            rho_t: [vec![0.1], vec![0.3], vec![0.05]],
        },
        gloss: None,
        normal: None,
    };
    let leaf = ReferenceLeaf {
        mesh: LeafMesh {
            positions: vec![at(-9.0, -5.0), at(9.0, -5.0), at(9.0, 5.0), at(-9.0, 5.0)],
            normals: vec![DVec3::Z; 4],
            tangents: Vec::new(),
            uvs: vec![DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y],
            indices: vec![0, 1, 2, 0, 2, 3],
            discs: false,
        },
        width: 1,
        height: 1,
        front: side(),
        back: side(),
        mask: None,
        lobe: Lobe::Beckmann,
    };
    let instances = (0..3)
        .map(|k| ReferencePlacement { leaf: 0, transform: DMat4::from_translation(DVec3::Z * 4.0 * f64::from(k)) })
        .collect();
    let world = ReferenceWorld { leaves: vec![leaf], instances, sky: Some([1.0; 3]), ..ReferenceWorld::default() };
    TransferScene {
        name: "stack".into(),
        world: Arc::new(world),
        leaves: 1,
        seen: Vec::new(),
        sources: Vec::new(),
        sun: None,
    }
}

fn options(columns: TransferColumns) -> Options {
    Options {
        method: TransferMethod::Paths,
        anchors: [3, 2],
        columns,
        gloss_bands: 3,
        paths: 64,
        seed: 5,
        force: false,
    }
}

#[test]
fn what_is_written_is_what_is_read() {
    let (scene, dir) = (scene(), tempfile::tempdir().unwrap());
    for (name, columns) in [("harmonics", TransferColumns::Harmonics(3)), ("light", TransferColumns::Light)] {
        let (out, options) = (dir.path().join(name), options(columns));
        assert!(matches!(run(&scene, &[], &out, &options), Ok(FitOutcome::Done(_))));
        assert!(matches!(run(&scene, &[], &out, &options), Ok(FitOutcome::UpToDate(_))));
        let read = TransferFit::open(&out, &scene, &options).unwrap().unwrap();
        assert_eq!(read.layout.rows, 3 * 6 * 6);
        let tracer = PathTracer::new(&scene.world, PathSettings::default()).unwrap();
        let anchors = &read.layout.leaves[0].anchors.points;
        let receiver = TransferReceiver { instance: 1, anchors, rows: read.layout.leaves[0].rows };
        let request = TransferRequest { method: TransferMethod::Paths, columns, paths: 64, seed: 5 };
        let found = transfer::measure(&tracer, &receiver, &request);
        let of_one = &read.entries[read.layout.first[1] * columns.count()..][..found.entries.len()];
        // A half float has a significand of eleven bits.
        for (a, b) in of_one.iter().flatten().zip(found.entries.iter().flatten()) {
            let a = a * read.scale;
            assert!((a - b).abs() <= b.abs() / 1024.0 + 1e-6, "{a} {b}");
        }
        let section = &read.record.sections["transfer"];
        assert!(section.figures["irradiance_error_worst"] < 0.3 && section.counts["anchors"] == 18);
    }
}

#[test]
fn another_scene_or_light_is_another_transfer() {
    let base = scene();
    let changed = |change: &dyn Fn(&mut ReferenceWorld)| {
        let mut world = (*base.world).clone();
        change(&mut world);
        TransferScene { world: Arc::new(world), ..base.clone() }
    };
    let (bands, light) = (options(TransferColumns::Harmonics(3)), options(TransferColumns::Light));
    let moved = changed(&|w| w.instances[1].transform.w_axis.x += 1e-9);
    let dyed = changed(&|w| w.leaves[0].front.interior = w.leaves[0].back.interior.clone());
    let darker = changed(&|w| w.sky = Some([0.9; 3]));
    let greyer = changed(&|w| {
        if let ReferenceInterior::Maps { rho_d, .. } = &mut w.leaves[0].front.interior {
            rho_d[0][0] = 0.11;
        }
    });
    for options in [&bands, &light] {
        let own = input_hash(&base, options);
        assert!(own != input_hash(&moved, options) && own != input_hash(&greyer, options));
        assert_eq!(own, input_hash(&dyed, options), "both sides were alike");
    }
    // Harmonics hold for every light, so their hash does not depend on it.
    assert_eq!(input_hash(&base, &bands), input_hash(&darker, &bands));
    assert_ne!(input_hash(&base, &light), input_hash(&darker, &light));
    let more = Options { paths: 65, ..bands };
    assert_ne!(input_hash(&base, &bands), input_hash(&base, &more));
}

#[test]
fn a_damaged_transfer_is_refused() {
    let (scene, dir) = (scene(), tempfile::tempdir().unwrap());
    let (out, options) = (dir.path().join("t"), options(TransferColumns::Light));
    run(&scene, &[], &out, &options).unwrap();
    let entries = store::entries(&out.join(OPERATORS), 36).unwrap();
    assert!(store::entries(&out.join(OPERATORS), 100_000).is_err());
    let mut broken = entries;
    broken[3][1] = f32::NAN;
    write_exr(&out.join(OPERATORS), &store::maps(&broken), Packing::Half).unwrap();
    let told = TransferFit::open(&out, &scene, &options).unwrap_err().to_string();
    assert!(told.contains("operators.exr") && told.contains("changed since it was fitted"), "{told}");
}

/// An instance that no picture shows has no rows. It points to those of another instance of the same leaf.
#[test]
fn what_is_never_seen_has_no_rows() {
    let (whole, dir) = (scene(), tempfile::tempdir().unwrap());
    let options = options(TransferColumns::Light);
    let rows = |seen: &[bool]| {
        let scene = TransferScene { seen: seen.to_vec(), ..whole.clone() };
        let out = dir.path().join(format!("{seen:?}"));
        run(&scene, &[], &out, &options).unwrap();
        let read = TransferFit::open(&out, &scene, &options).unwrap().unwrap();
        assert_eq!(read.entries.len(), read.layout.rows);
        (read.layout.first, read.entries)
    };
    let (all, entries) = rows(&[]);
    let one = 6 * 6;
    assert_eq!(all, [0, one, 2 * one]);
    // What holds more than is shown will do, and what holds less will not.
    let folder = |seen: &[bool]| dir.path().join(format!("{seen:?}"));
    let some = TransferScene { seen: vec![false, true, false], ..whole.clone() };
    let read = TransferFit::open(&folder(&[]), &some, &options).unwrap().unwrap();
    assert_eq!((&read.layout.first, &read.entries), (&all, &entries));
    let (first, middle) = rows(&[false, true, false]);
    assert!(TransferFit::open(&folder(&some.seen), &whole, &options).unwrap().is_none());
    assert_eq!(first, [0; 3]);
    assert_eq!(middle, entries[one..2 * one]);
    // Where no instance of a leaf is seen, one of them has rows all the same.
    assert_eq!(rows(&[false; 3]).1, entries[..one]);
}

/// Instances that show the light of another one point to its rows. A transfer in which each has rows of its own, or
/// others stand for them, is another one.
#[test]
fn copies_show_the_light_of_the_one_that_stands_for_them() {
    let (whole, dir) = (scene(), tempfile::tempdir().unwrap());
    let options = options(TransferColumns::Light);
    let make = |sources: &[usize]| {
        let seen = sources.iter().enumerate().map(|(k, s)| k == *s).collect();
        let scene = TransferScene { seen, sources: sources.to_vec(), ..whole.clone() };
        let out = dir.path().join(format!("{sources:?}"));
        run(&scene, &[], &out, &options).unwrap();
        (TransferFit::open(&out, &scene, &options).unwrap().unwrap(), scene, out)
    };
    let ((all, ..), (some, scene, out)) = (make(&[]), make(&[1, 1, 2]));
    let one = 6 * 6;
    assert_eq!(some.layout.first, [0, 0, one]);
    assert_eq!(some.entries, all.entries[one..3 * one]);
    assert_eq!(
        [0, 1, 2].map(|k| (some.layout.is_own(k), some.layout.is_lit(k))),
        [(false, true), (true, true), (true, true)]
    );
    let (_, other, _) = make(&[0, 0, 2]);
    assert!(TransferFit::open(&out, &scene, &options).unwrap().is_some());
    assert!([&other, &whole].iter().all(|s| TransferFit::open(&out, s, &options).unwrap().is_none()));
}

/// A sun that moves freely gets the map of its last place, and rays confirm it. No map is asked for while the sun
/// stands still.
#[test]
fn a_live_sun_has_the_map_of_its_last_place() {
    use mesophyll_transport::visibility::{AreaLight, ShadowScene};
    let (at, radius) = (DVec3::new(0.1, 0.0, 1.0), 0.02);
    let (scene, dir) = (scene().under_sun(radius, &[at], 3.0).unwrap(), tempfile::tempdir().unwrap());
    let options = Options { paths: 8, ..options(TransferColumns::Harmonics(2)) };
    run(&scene, &[], dir.path(), &options).unwrap();
    let read = TransferFit::open(dir.path(), &scene, &options).unwrap().unwrap();
    let sun = read.sun.unwrap();
    let mut live = sun.live(read.world.clone(), at);
    assert!(live.follow(at).unwrap().is_none() && !live.is_waiting());
    for k in 1..4 {
        live.follow(DVec3::new(0.1 + 0.3 * f64::from(k), 0.2, 1.0)).unwrap();
    }
    let last = DVec3::new(-0.9, 0.3, 0.8);
    let mut found = live.follow(last).unwrap();
    let begun = std::time::Instant::now();
    while live.is_waiting() && begun.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(1));
        found = live.follow(last).unwrap().or(found);
    }
    let light = AreaLight::disk(radius, 64).unwrap();
    let rays = ShadowScene::new(&read.world, &sun.receivers, &light).unwrap().by_rays(last);
    let found = found.expect("no map came");
    // Points of the disk that lie just at an edge may differ: four of 64.
    assert!(found.iter().zip(&rays).all(|(a, b)| a.abs_diff(*b) <= 16), "{found:?} {rays:?}");
    let seen = |map: &[u8]| map.iter().filter(|v| **v > 128).count();
    assert!(seen(&found) > rays.len() / 3 && seen(&found) < rays.len() * 9 / 10, "{}", seen(&found));
    assert_ne!(found, sun.shares(at).unwrap());
    // A world that contradicts itself has no maps. This is reported once, and then nothing is waited for.
    let mut broken = ReferenceWorld::clone(&read.world);
    broken.instances[0].leaf = 7;
    let told = broken.validate().unwrap_err().to_string();
    let mut live = sun.live(Arc::new(broken), at);
    assert!(live.follow(at).unwrap().is_none());
    let mut said = live.follow(last);
    let begun = std::time::Instant::now();
    while live.is_waiting() && begun.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(1));
        said = live.follow(last);
    }
    assert_eq!(said.unwrap_err().to_string(), told);
    assert!(live.follow(at).unwrap().is_none() && live.follow(last).unwrap().is_none() && !live.is_waiting());
}
