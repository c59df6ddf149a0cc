//! Rays that are followed in turns or in groups have the answers that they have alone.

use crate::common::{Accept, EVERY, numbered, one_by_one, placement, point, seeded, soup, variants, with_every_set};
use glam::{DMat4, DVec3};
use mesophyll_transport::rays::{InstanceForest, Ray, TriangleTree};
use rand::RngExt;

/// Fails where the rays together have other answers than one by one, in any bit; gives how many meet something.
fn same(forest: &InstanceForest, rays: &[Ray], accept: Accept) -> usize {
    let together = forest.nearest_of_each(rays, accept);
    assert_eq!(together, forest.nearest_of_neighbours(rays, accept));
    assert_eq!(together.len(), rays.len());
    for (ray, found) in rays.iter().zip(&together) {
        assert_eq!(*found, forest.nearest(ray, accept), "{ray:?}");
    }
    together.iter().flatten().count()
}

/// One mesh against the f64 test on every triangle: rays from far and near, along edges, in a triangle's plane, along
/// the axes, beside everything, and rays that go nowhere; no triangle solid, every other one, and all.
#[test]
fn one_mesh_is_met_as_without_a_tree() {
    let mut rng = seeded(21);
    let mut hits = 0;
    for size in [1.0, 1e-2] {
        let mesh = soup(&mut rng, 300, 1.0, size);
        let triangles: Vec<[DVec3; 3]> = mesh.chunks(3).map(|t| [t[0], t[1], t[2]]).collect();
        let mut rays = vec![Ray::new(DVec3::ZERO, DVec3::ZERO), Ray::new(DVec3::X * 9.0, DVec3::X)];
        for (k, [a, b, c]) in triangles.iter().enumerate() {
            let within = *a + (*b - *a) * 0.3 + (*c - *a) * 0.3;
            let axis = DVec3::AXES[k % 3];
            let from = within + point(&mut rng, if k % 2 == 0 { 2.0 } else { 1e4 });
            rays.extend([
                Ray::new(from, (within - from) * 10f64.powi(rng.random_range(-6..6))),
                Ray::new(*a * 2.0 - *b, *b - *a),
                Ray::new(within - (*b - *c) * 3.0, *b - *c),
                Ray::new(*a - axis * 4.0, axis),
            ]);
        }
        let alone: Vec<_> = rays
            .iter()
            .map(|ray| if ray.direction == DVec3::ZERO { None } else { one_by_one(&triangles, ray) })
            .collect();
        for forest in variants(&mesh) {
            hits += same(&forest, &rays, EVERY);
            assert_eq!(forest.nearest_of_each(&rays, EVERY), alone);
        }
    }
    assert!(hits > 5000, "{hits}");
}

/// Several instances, some of them empty, with an outline that cuts triangles; any number of rays.
#[test]
fn instances_and_outlines_are_met_as_alone() {
    let outline: Accept = |instance, _, [b, c]| instance % 3 != 0 || b + c < 0.6;
    let mut rng = seeded(22);
    let meshes = [soup(&mut rng, 60, 1.0, 0.6), Vec::new(), soup(&mut rng, 3, 1.0, 0.6)];
    let shapes = meshes.iter().map(|m| TriangleTree::with_solid(m, &numbered(m), |k| k % 4 == 0)).collect();
    let placed: Vec<_> = (0..50).map(|k| (k % 3, placement(&mut rng, 4.0))).collect();
    let forest = InstanceForest::new(shapes, &placed);
    let mut hits = [0; 2];
    for count in [0, 1, 7, 8, 15, 16, 17, 1500] {
        let start = |rng: &mut _| point(rng, 6.0);
        let rays: Vec<Ray> = (0..count).map(|_| Ray::new(start(&mut rng), point(&mut rng, 1.0))).collect();
        // A camera's rays: one origin, and directions that differ little from one to the next.
        let eye = point(&mut rng, 9.0);
        let picture: Vec<Ray> = (0..count)
            .map(|k| Ray::new(eye, DVec3::new(0.02 * (k % 50) as f64, 0.05 * (k / 50) as f64, 0.0) - eye))
            .collect();
        for forest in with_every_set(&forest) {
            hits[0] += same(&forest, &rays, outline);
            hits[1] += same(&forest, &picture, outline);
        }
    }
    assert!(hits.iter().all(|hits| *hits > 300), "{hits:?}");
}

/// Nothing is met where there is nothing.
#[test]
fn empty_forests_are_not_met() {
    let rays = vec![Ray::new(DVec3::ZERO, DVec3::Z); 40];
    for placed in [vec![], vec![(0, DMat4::IDENTITY)], vec![(0, DMat4::IDENTITY); 3]] {
        let forest = InstanceForest::new(vec![TriangleTree::new(&[], &[])], &placed);
        assert_eq!(same(&forest, &rays, EVERY), 0);
    }
}
