//! Searches by trees give the same results as searches without trees.

use crate::common::{
    EVERY, by_solving, numbered, one_by_one, placement, point, seeded, soup, variants, with_every_set,
};
use glam::{DMat4, DVec3};
use mesophyll_transport::rays::{InstanceForest, Ray, TriangleTree};
use proptest::prelude::*;
use rand::RngExt;

fn thirds(positions: &[DVec3]) -> Vec<[DVec3; 3]> {
    positions.chunks(3).map(|t| [t[0], t[1], t[2]]).collect()
}

/// Instances of meshes are compared with the solution of a 3×3 system for every triangle in the world.
#[test]
fn instances_are_met_where_brute_force_meets_them() {
    let mut rng = seeded(3);
    let meshes: Vec<_> = (0..2).map(|_| soup(&mut rng, 40, 1.0, 0.6)).collect();
    let shapes = meshes
        .iter()
        .zip([false, true])
        .map(|(m, solid)| TriangleTree::with_solid(m, &numbered(m), |_| solid))
        .collect();
    let (mut placed, mut world) = (Vec::new(), Vec::new());
    for k in 0..25 {
        let transform = placement(&mut rng, 4.0);
        placed.push((k % 2, transform));
        world.extend(thirds(&meshes[k % 2]).iter().map(|t| t.map(|p| transform.transform_point3(p))));
    }
    let forests = with_every_set(&InstanceForest::new(shapes, &placed));
    let mut hits = 0;
    for _ in 0..1500 {
        let origin = point(&mut rng, 8.0);
        let ray = Ray::new(origin, point(&mut rng, 4.0) - origin);
        let expected = by_solving(&world, &ray);
        for forest in &forests {
            let found = forest.nearest(&ray, EVERY);
            assert_eq!(found.map(|h| h.instance * 40 + h.triangle), expected.map(|e| e.0));
            assert_eq!(forest.blocked(&ray, EVERY), expected.is_some());
            if let (Some(h), Some((_, t))) = (found, expected) {
                assert!((h.t - t).abs() < 1e-9);
                assert!(forest.blocked_within(&ray, t + 1e-9, EVERY));
                assert!(!forest.blocked_within(&ray, t - 1e-9, EVERY));
                hits += 1;
            }
        }
    }
    assert!(hits > 300, "only {hits} of 1500 rays hit anything: the test sees too little");
}

/// One mesh is compared with the f64 test on every triangle. The numbers agree bit by bit for any size of the scene and
/// its triangles, and any distance from the origin and from the ray.
#[test]
fn results_are_those_of_the_double_precision_test_at_any_scale() {
    let mut rng = seeded(5);
    let (mut rays, mut hits) = (0, 0);
    for exponent in -3..=6 {
        for size in [1.0, 1e-2, 1e-4] {
            for offset in [0.0, 1e3] {
                let scale = 10f64.powi(exponent);
                let shift = point(&mut rng, offset * scale);
                let mesh: Vec<DVec3> = soup(&mut rng, 150, 1.0, size).iter().map(|p| *p * scale + shift).collect();
                let triangles = thirds(&mesh);
                let forests = variants(&mesh);
                for k in 0..60 {
                    let aim = triangles[k].iter().sum::<DVec3>() / 3.0 + point(&mut rng, 0.4 * size * scale);
                    let origin = match k % 4 {
                        0 => aim + point(&mut rng, 1e4 * scale),
                        1 => triangles[k + 1][0] * 0.7 + triangles[k + 1][1] * 0.3,
                        _ => shift + point(&mut rng, 2.0 * scale),
                    };
                    let ray = Ray::new(origin, (aim - origin) * 10f64.powi(rng.random_range(-6..6)));
                    let expected = one_by_one(&triangles, &ray);
                    for forest in &forests {
                        assert_eq!(forest.nearest(&ray, EVERY), expected, "scale {scale} size {size}");
                        assert_eq!(forest.blocked(&ray, EVERY), expected.is_some());
                    }
                    (rays, hits) = (rays + 1, hits + usize::from(expected.is_some()));
                }
            }
        }
    }
    assert!(hits * 3 > rays, "{hits} of {rays}");
}

/// A limit just before a hit excludes it, and one just behind it does not, whatever the limit is in f32. All triangles
/// are solid, so that f32 alone may end the search. They are near and far, and of all sizes. A relative 1e-9 is sixty
/// times finer than f32, and much coarser than f64.
#[test]
fn a_limit_beside_a_hit_is_kept_to() {
    let mut rng = seeded(11);
    let mut hits = 0;
    for size in [1.0, 1e-2, 1e-3] {
        let mesh = soup(&mut rng, 120, 1.0, size);
        let triangles = thirds(&mesh);
        let forests = with_every_set(&InstanceForest::new(
            vec![TriangleTree::with_solid(&mesh, &numbered(&mesh), |_| true)],
            &[(0, DMat4::IDENTITY)],
        ));
        for k in 0..1200 {
            let aim = triangles[k % 120].iter().sum::<DVec3>() / 3.0 + point(&mut rng, 0.2 * size);
            let origin = aim + point(&mut rng, 10f64.powi(k as i32 % 5 - 2));
            let ray = Ray::new(origin, (aim - origin) * 10f64.powi(rng.random_range(-3..3)));
            let Some(first) = one_by_one(&triangles, &ray) else { continue };
            hits += 1;
            for forest in &forests {
                assert!(forest.blocked_within(&ray, first.t * (1.0 + 1e-9), EVERY), "{k} {size}");
                assert!(!forest.blocked_within(&ray, first.t * (1.0 - 1e-9), EVERY), "{k} {size}");
            }
        }
    }
    assert!(hits > 1500, "{hits}");
}

/// Where a caller accepts nothing, solid triangles are still hit, and no others.
#[test]
fn solid_triangles_are_not_asked_for() {
    let mut rng = seeded(9);
    let mesh = soup(&mut rng, 200, 1.0, 0.5);
    let triangles = thirds(&mesh);
    let even: Vec<_> = triangles.iter().step_by(2).copied().collect();
    let forests = with_every_set(&InstanceForest::new(
        vec![TriangleTree::with_solid(&mesh, &numbered(&mesh), |k| k % 2 == 0)],
        &[(0, DMat4::IDENTITY)],
    ));
    let mut hits = 0;
    for _ in 0..1000 {
        let origin = point(&mut rng, 2.0);
        let ray = Ray::new(origin, point(&mut rng, 1.0) - origin);
        let expected = one_by_one(&even, &ray);
        hits += usize::from(expected.is_some());
        for forest in &forests {
            let found = forest.nearest(&ray, |_, _, _| false).map(|h| (h.triangle, h.t));
            assert_eq!(found, expected.map(|h| (2 * h.triangle, h.t)));
            assert_eq!(forest.blocked(&ray, |_, _, _| false), expected.is_some());
        }
    }
    assert!(hits > 300, "{hits}");
}

/// Grazing rays: in the plane of a triangle or almost, along its edges, and along the axes.
#[test]
fn grazing_and_axis_parallel_rays() {
    let mut rng = seeded(6);
    let mut hits = 0;
    for round in 0..300 {
        let mut mesh = soup(&mut rng, 40, 1.0, 0.5);
        if round % 3 == 0 {
            // Triangles along the axes, whose boxes have no thickness.
            for t in mesh.chunks_mut(3) {
                let axis = rng.random_range(0..3);
                (t[1][axis], t[2][axis]) = (t[0][axis], t[0][axis]);
            }
        }
        let triangles = thirds(&mesh);
        let forests = variants(&mesh);
        for [a, b, c] in triangles.iter().take(12) {
            let tilt = 10f64.powi(-rng.random_range(3..18));
            let within = *a + (*b - *a) * 0.3 + (*c - *a) * 0.3;
            let along = (*b - *a) + (*c - *a) * rng.random::<f64>() + point(&mut rng, tilt);
            let edge = (*b - *a) + point(&mut rng, tilt);
            let axis = [DVec3::X, DVec3::Y, DVec3::Z][rng.random_range(0..3)] * [1.0, -1.0][rng.random_range(0..2)];
            for ray in [
                Ray::new(within - along * 3.0, along),
                Ray::new(*a - edge * 2.0, edge),
                Ray::new(within - axis * 4.0, axis),
                Ray::new(*a - axis * 4.0, axis),
                Ray::new(*a, edge),
            ] {
                let expected = one_by_one(&triangles, &ray);
                hits += usize::from(expected.is_some());
                for forest in &forests {
                    assert_eq!(forest.nearest(&ray, EVERY), expected);
                    assert_eq!(forest.blocked(&ray, EVERY), expected.is_some());
                }
            }
        }
    }
    assert!(hits > 3000, "{hits}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// A few arbitrary triangles, also degenerate ones, and any ray. Coordinates on a coarse grid make shared corners,
    /// flat boxes, zero areas and rays through edges frequent.
    #[test]
    fn coarse_grids(
        corners in prop::collection::vec(prop::array::uniform3(-3i32..=3), 3..90),
        rays in prop::collection::vec((prop::array::uniform3(-6i32..=6), prop::array::uniform3(-3i32..=3)), 1..40),
        exponent in -10i32..=20,
    ) {
        let unit = 2f64.powi(exponent);
        let at = |p: [i32; 3]| DVec3::from(p.map(f64::from)) * unit;
        let mesh: Vec<DVec3> = corners[..corners.len() / 3 * 3].iter().map(|p| at(*p)).collect();
        let triangles = thirds(&mesh);
        for forest in variants(&mesh) {
            for (origin, direction) in &rays {
                let ray = Ray::new(at(*origin), DVec3::from(direction.map(f64::from)));
                let expected = if ray.direction == DVec3::ZERO { None } else { one_by_one(&triangles, &ray) };
                prop_assert_eq!(forest.nearest(&ray, EVERY), expected);
            }
        }
    }
}

/// The tree above instances changes no result: the same mesh alone, and beside an empty shape and a distant copy.
#[test]
fn one_instance_and_several_agree() {
    let mut rng = seeded(8);
    let mesh = soup(&mut rng, 400, 1.0, 0.3);
    let turned = placement(&mut rng, 3.0);
    let shape = TriangleTree::new(&mesh, &numbered(&mesh));
    let single = InstanceForest::new(vec![shape.clone()], &[(0, turned)]);
    let far = DMat4::from_translation(DVec3::splat(1e4));
    let several =
        InstanceForest::new(vec![TriangleTree::new(&[], &[]), shape], &[(1, turned), (0, turned), (1, far * turned)]);
    for _ in 0..2000 {
        let origin = turned.transform_point3(point(&mut rng, 2.0));
        let ray = Ray::new(origin, turned.transform_point3(point(&mut rng, 1.0)) - origin);
        assert_eq!(single.nearest(&ray, EVERY), several.nearest(&ray, EVERY));
    }
}
