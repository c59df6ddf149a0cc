//! No ray leaks through shared edges and corners, or in wide scenes with narrow gaps. Other scenes are empty, have
//! piles of triangles, or refuse hits.

use crate::common::{Accept, EVERY, alone, numbered, point, seeded, with_every_set};
use glam::{DMat4, DQuat, DVec3};
use mesophyll_transport::rays::{InstanceForest, Ray, TriangleTree};
use rand::RngExt;

/// A closed ball made of triangles.
fn ball(n: u32, radius: f64, centre: DVec3) -> (Vec<DVec3>, Vec<u32>) {
    let at = |i: u32, j: u32| {
        let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(2 * n));
        let (s, c) = (std::f64::consts::PI * u).sin_cos();
        let (sp, cp) = (std::f64::consts::TAU * v).sin_cos();
        centre + DVec3::new(s * cp, s * sp, c) * radius
    };
    let mut positions = vec![at(0, 0), at(n, 0)];
    for i in 1..n {
        positions.extend((0..2 * n).map(|j| at(i, j)));
    }
    let number = |i: u32, j: u32| match i {
        0 => 0,
        i if i == n => 1,
        i => 2 + (i - 1) * 2 * n + j % (2 * n),
    };
    let mut indices = Vec::new();
    for i in 0..n {
        for j in 0..2 * n {
            let [a, b, c, d] = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
            if i + 1 < n {
                indices.extend([a, b, c]);
            }
            if i > 0 {
                indices.extend([a, c, d]);
            }
        }
    }
    (positions, indices)
}

/// No ray escapes from a closed ball, not even through its corners and edges.
#[test]
fn closed_surfaces_are_closed() {
    let mut rng = seeded(11);
    for (radius, centre) in [(1.0, DVec3::ZERO), (1e-3, DVec3::splat(0.7)), (2e4, DVec3::new(1e6, -3e5, 2e4))] {
        let (positions, indices) = ball(40, radius, centre);
        for forest in
            with_every_set(&InstanceForest::new(vec![TriangleTree::new(&positions, &indices)], &[(0, DMat4::IDENTITY)]))
        {
            for t in indices.chunks_exact(3) {
                let [a, b, c] = [0, 1, 2].map(|k| positions[t[k] as usize]);
                let origin = centre + point(&mut rng, 0.5 * radius);
                for target in [a, b, c, (a + b) * 0.5, b + (c - b) * rng.random::<f64>(), (a + c) * 0.5] {
                    let ray = Ray::new(origin, target - origin);
                    assert!(forest.nearest(&ray, EVERY).is_some(), "a ray to {target} escapes");
                    assert!(forest.blocked(&ray, EVERY));
                }
            }
        }
    }
}

/// A flat grid that is turned, with rays through every corner and the middle of every edge: straight, slanted and from
/// below.
#[test]
fn rays_through_shared_edges_and_corners_do_not_leak() {
    let n = 8u32;
    let positions: Vec<DVec3> =
        (0..=n).flat_map(|j| (0..=n).map(move |i| DVec3::new(f64::from(i) * 0.1, f64::from(j) * 0.3, 0.7))).collect();
    let mut indices = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let a = j * (n + 1) + i;
            indices.extend([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1]);
        }
    }
    let turn = DMat4::from_rotation_z(0.3);
    let forest = InstanceForest::new(vec![TriangleTree::new(&positions, &indices)], &[(0, turn)]);
    for j in 1..2 * n {
        for i in 1..2 * n {
            let target = turn.transform_point3(DVec3::new(f64::from(i) * 0.05, f64::from(j) * 0.15, 0.7));
            for origin in [target + DVec3::Z, target - DVec3::Z * 3.0, DVec3::new(5.0, -3.0, 9.0)] {
                let found = forest.nearest(&Ray::new(origin, target - origin), EVERY);
                assert!(found.is_some(), "leak at {i} {j}");
            }
        }
    }
}

/// Two plates of 40 m that are 10 mm apart, with triangles from 4 m to 40 mm, as one mesh and as instances. A ray that
/// starts between them hits the right one. A ray from far away never hits the second plate before the first.
#[test]
fn forty_metres_with_gaps_of_ten_millimetres() {
    let mut rng = seeded(13);
    let turn = DMat4::from_rotation_translation(DQuat::from_rotation_x(0.4), DVec3::new(300.0, -20.0, 5e3));
    for tiles in [10u32, 60] {
        let step = 40_000.0 / f64::from(tiles);
        let plate = |z: f64| -> Vec<DVec3> {
            (0..=tiles)
                .flat_map(|j| (0..=tiles).map(move |i| DVec3::new(f64::from(i) * step, f64::from(j) * step, z)))
                .collect()
        };
        let indices: Vec<u32> = (0..tiles)
            .flat_map(|j| (0..tiles).map(move |i| j * (tiles + 1) + i))
            .flat_map(|a| [a, a + 1, a + tiles + 2, a, a + tiles + 2, a + tiles + 1])
            .collect();
        let count = (tiles + 1) * (tiles + 1);
        let both = [plate(0.0), plate(10.0)].concat();
        let mut doubled = indices.clone();
        doubled.extend(indices.iter().map(|i| i + count));
        let one = InstanceForest::new(vec![TriangleTree::new(&both, &doubled)], &[(0, turn)]);
        let lift = DMat4::from_translation(DVec3::Z * 10.0);
        let two = InstanceForest::new(vec![TriangleTree::new(&plate(0.0), &indices)], &[(0, turn), (0, turn * lift)]);
        let upper = |hit: mesophyll_transport::rays::RayHit, single: bool| {
            if single { hit.triangle >= indices.len() / 3 } else { hit.instance == 1 }
        };
        for (forest, single) in [(one, true), (two, false)] {
            for k in 0..4000 {
                let inside = |rng: &mut rand_pcg::Pcg64, z: f64| {
                    // Some rays also aim at corners and edges of the tiles.
                    let mut along = || 100.0 + 39_800.0 * rng.random::<f64>();
                    let (x, y) = (along(), along());
                    let snap = |x: f64, on: bool| {
                        if on { ((x / step).round().max(1.0) * step).min(40_000.0 - step) } else { x }
                    };
                    DVec3::new(snap(x, k % 3 == 0), snap(y, k % 2 == 0), z)
                };
                let from_above = k % 2 == 0;
                let target = inside(&mut rng, if from_above { 10.0 } else { 0.0 });
                let height = 1e-6 + 9.999_998 * rng.random::<f64>();
                let between = inside(&mut rng, height);
                let far = inside(&mut rng, if from_above { 10.0 + 3e4 } else { -3e4 });
                for (origin, aim) in [(between, target), (far, target)] {
                    let origin = turn.transform_point3(origin);
                    let ray = Ray::new(origin, turn.transform_point3(aim) - origin);
                    let hit = forest.nearest(&ray, EVERY).expect("a ray between the plates meets one");
                    assert_eq!(upper(hit, single), from_above, "the wrong plate: a leak");
                    assert!((hit.t - 1.0).abs() < 1e-6, "{}", hit.t);
                    assert!(forest.blocked_within(&ray, 1.0 + 1e-6, EVERY));
                }
            }
        }
    }
}

#[test]
fn empty_scenes_empty_leaves_and_refused_hits() {
    let ray = Ray::new(DVec3::Z, -DVec3::Z);
    let nothing = InstanceForest::new(Vec::new(), &[]);
    assert!(nothing.nearest(&ray, EVERY).is_none() && nothing.extent() == 0.0);
    for places in [1, 3] {
        let hollow = InstanceForest::new(vec![TriangleTree::new(&[], &[])], &vec![(0, DMat4::IDENTITY); places]);
        assert!(hollow.nearest(&ray, EVERY).is_none() && !hollow.blocked(&ray, EVERY));
    }
    let sheet = [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
    let stacked: Vec<DVec3> = (0..3).flat_map(|k| sheet.map(|p| p - DVec3::Z * f64::from(k))).collect();
    for forest in with_every_set(&alone(&stacked)) {
        let but_first: Accept = |_, t, _| t != 0;
        let none: Accept = |_, _, _| false;
        let third: Accept = |_, t, b| t == 2 && (b[0] - 0.25).abs() < 1e-12 && (b[1] - 0.5).abs() < 1e-12;
        assert_eq!(forest.nearest(&ray, but_first).map(|h| h.triangle), Some(1));
        assert!(!forest.blocked(&ray, none));
        assert!(forest.blocked(&ray, third));
        // Rays without a direction, and rays that start on a sheet.
        assert!(forest.nearest(&Ray::new(DVec3::Z, DVec3::ZERO), EVERY).is_none());
        assert!(forest.nearest(&Ray::new(DVec3::Z, DVec3::NAN), EVERY).is_none());
        assert_eq!(forest.nearest(&Ray::new(DVec3::ZERO, -DVec3::Z), EVERY).map(|h| h.triangle), Some(1));
    }
}

/// Hundreds of triangles at one place, whose tree may have any depth. The first of them counts.
#[test]
fn piles_of_coincident_triangles() {
    let ray = Ray::new(DVec3::Z, -DVec3::Z);
    let sheet = [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
    for count in [9, 600, 20_000] {
        let pile: Vec<DVec3> = (0..count).flat_map(|_| sheet).collect();
        for forest in with_every_set(&alone(&pile)) {
            let found = forest.nearest(&ray, EVERY).unwrap();
            assert_eq!((found.t, found.triangle), (1.0, 0));
        }
    }
    let places = vec![(0, DMat4::IDENTITY); 5000];
    let stacked = InstanceForest::new(vec![TriangleTree::new(&sheet, &numbered(&sheet))], &places);
    let late: Accept = |instance, _, _| instance > 6;
    assert_eq!(stacked.nearest(&ray, late).map(|h| (h.t, h.instance)), Some((1.0, 7)));
}

/// Triangles without area, without size or without a place change nothing.
#[test]
fn degenerate_triangles_are_passed_by() {
    let sheet = [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
    let mut positions = sheet.to_vec();
    positions.extend([DVec3::new(0.0, 0.0, 0.5); 3]);
    positions.extend([DVec3::new(0.0, 0.0, 0.4), DVec3::new(1.0, 0.0, 0.4), DVec3::new(2.0, 0.0, 0.4)]);
    positions.extend([DVec3::NAN, DVec3::X, DVec3::Y]);
    positions.extend([DVec3::INFINITY, DVec3::X, DVec3::Y]);
    for forest in with_every_set(&alone(&positions)) {
        for origin in [DVec3::Z, DVec3::new(0.1, 0.0, 1.0)] {
            let hit = forest.nearest(&Ray::new(origin, -DVec3::Z), EVERY).unwrap();
            assert_eq!((hit.triangle, hit.t), (0, 1.0));
        }
        assert!(forest.extent().is_finite());
    }
    let point = alone(&[DVec3::ONE; 3]);
    assert!(point.nearest(&Ray::new(DVec3::ZERO, DVec3::ONE), EVERY).is_none());
}

/// Both sides of a triangle can be hit, with the same barycentric coordinates.
#[test]
fn back_faces_are_met() {
    let sheet = [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
    for forest in with_every_set(&alone(&sheet)) {
        let [front, back] = [1.0, -1.0].map(|side| {
            let ray = Ray::new(DVec3::new(0.1, 0.2, side), DVec3::new(0.0, 0.0, -side));
            forest.nearest(&ray, EVERY).unwrap()
        });
        assert_eq!(front, back);
    }
}
