//! Which triangle a ray meets first: a tree of boxes over each leaf's triangles, and one over the instances.
//!
//! The trees are built by the crate `bvh` (surface area heuristic) and walked here, nearest box first. Triangles are
//! met by the method of Möller & Trumbore (1997) in f64, from both sides; shared edges do not leak, because a ray
//! within 1e-12 of an edge (in barycentric units) counts as hitting.

mod tree;

pub use tree::Ray;

use glam::{DMat4, DVec3};
use tree::{Bounds, Tree};

/// A triangle ready for the intersection: a corner and two edges.
#[derive(Debug, Clone, Copy)]
struct Triangle {
    corner: DVec3,
    edge: [DVec3; 2],
}

impl Triangle {
    /// (t, b1, b2) with the hit at (1−b1−b2)·p0 + b1·p1 + b2·p2. Möller & Trumbore 1997, without culling.
    #[inline]
    fn meet(&self, ray: &Ray) -> Option<(f64, f64, f64)> {
        const EDGE: f64 = 1e-12;
        let p = ray.direction.cross(self.edge[1]);
        let det = self.edge[0].dot(p);
        if det == 0.0 {
            return None;
        }
        let inverse = 1.0 / det;
        let s = ray.origin - self.corner;
        let b1 = s.dot(p) * inverse;
        if !(-EDGE..=1.0 + EDGE).contains(&b1) {
            return None;
        }
        let q = s.cross(self.edge[0]);
        let b2 = ray.direction.dot(q) * inverse;
        if b2 < -EDGE || b1 + b2 > 1.0 + EDGE {
            return None;
        }
        Some((self.edge[1].dot(q) * inverse, b1, b2))
    }
}

/// A leaf's triangles in their own space.
#[derive(Debug, Clone)]
pub struct Shape {
    triangles: Vec<Triangle>,
    tree: Tree,
}

impl Shape {
    /// The triangles of a mesh, three indices each, in boxes that rays can be tried on.
    pub fn new(positions: &[DVec3], indices: &[u32]) -> Shape {
        let corners = |t: &[u32]| [positions[t[0] as usize], positions[t[1] as usize], positions[t[2] as usize]];
        let triangles = indices
            .chunks_exact(3)
            .map(corners)
            .map(|[a, b, c]| Triangle { corner: a, edge: [b - a, c - a] })
            .collect::<Vec<_>>();
        let boxes = indices.chunks_exact(3).map(|t| Bounds::of(corners(t))).collect();
        Shape { triangles, tree: Tree::build(boxes) }
    }
}

/// Where a ray met something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray, in lengths of its direction.
    pub t: f64,
    /// Which instance was met.
    pub instance: usize,
    /// Which of its triangles.
    pub triangle: usize,
    /// Weights of the triangle's second and third corner.
    pub barycentric: [f64; 2],
}

/// All instances.
#[derive(Debug, Clone)]
pub struct Forest {
    shapes: Vec<Shape>,
    /// Shape and world → local, an instance each.
    placed: Vec<(usize, DMat4)>,
    tree: Tree,
}

impl Forest {
    /// `placed` holds the index of a shape and its local → world transform (invertible).
    pub fn new(shapes: Vec<Shape>, placed: &[(usize, DMat4)]) -> Forest {
        let boxes = placed
            .iter()
            .map(|(shape, transform)| {
                let bounds = shapes[*shape].tree.bounds;
                let Bounds { low, high } = bounds;
                if bounds.is_empty() {
                    return Bounds { low: DVec3::ZERO, high: DVec3::ZERO };
                }
                let corner =
                    |k: usize| DVec3::new([low.x, high.x][k & 1], [low.y, high.y][k >> 1 & 1], [low.z, high.z][k >> 2]);
                Bounds::of((0..8).map(|k| transform.transform_point3(corner(k))))
            })
            .collect();
        let placed = placed.iter().map(|(shape, transform)| (*shape, transform.inverse())).collect();
        Forest { shapes, placed, tree: Tree::build(boxes) }
    }

    /// Lowest and highest corner of the box around everything; `None` for an empty scene.
    pub(crate) fn bounds(&self) -> Option<[DVec3; 2]> {
        let Bounds { low, high } = self.tree.bounds;
        (!self.tree.bounds.is_empty()).then_some([low, high])
    }

    /// Length of the diagonal of the box around everything; 0 for an empty scene.
    pub(crate) fn extent(&self) -> f64 {
        let bounds = self.tree.bounds;
        if bounds.is_empty() { 0.0 } else { (bounds.high - bounds.low).length() }
    }

    /// The nearest hit with t > 0 that `accept(instance, triangle, barycentric)` lets pass (an alpha test).
    pub fn nearest(&self, ray: &Ray, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> Option<Hit> {
        self.nearest_within(ray, f64::INFINITY, accept)
    }

    /// The nearest hit with 0 < t < `limit` that `accept` lets pass.
    pub fn nearest_within(
        &self,
        ray: &Ray,
        mut limit: f64,
        accept: impl Fn(usize, usize, [f64; 2]) -> bool,
    ) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.tree.walk(ray, &mut limit, |instance, limit| {
            let (shape, to_local) = &self.placed[instance as usize];
            let shape = &self.shapes[*shape];
            let local = ray.through(to_local);
            shape.tree.walk(&local, limit, |triangle, limit| {
                if let Some((t, b1, b2)) = shape.triangles[triangle as usize].meet(&local)
                    && t > 0.0
                    && t < *limit
                    && accept(instance as usize, triangle as usize, [b1, b2])
                {
                    *limit = t;
                    best = Some(Hit {
                        t,
                        instance: instance as usize,
                        triangle: triangle as usize,
                        barycentric: [b1, b2],
                    });
                }
                false
            });
            false
        });
        best
    }

    /// Whether anything that `accept` lets pass lies at t > 0.
    pub fn blocked(&self, ray: &Ray, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> bool {
        self.blocked_within(ray, f64::INFINITY, accept)
    }

    /// Whether anything that `accept` lets pass lies at 0 < t < `limit`.
    pub fn blocked_within(&self, ray: &Ray, mut limit: f64, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> bool {
        self.tree.walk(ray, &mut limit, |instance, limit| {
            let (shape, to_local) = &self.placed[instance as usize];
            let shape = &self.shapes[*shape];
            let local = ray.through(to_local);
            shape.tree.walk(&local, limit, |triangle, limit| {
                matches!(shape.triangles[triangle as usize].meet(&local),
                    Some((t, b1, b2)) if t > 0.0 && t < *limit && accept(instance as usize, triangle as usize, [b1, b2]))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    fn point(rng: &mut Pcg64, reach: f64) -> DVec3 {
        DVec3::new(rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5) * 2.0 * reach
    }

    /// The brute force transforms every triangle to the world and solves a 3×3 system: no box, no Möller–Trumbore.
    fn brute(triangles: &[[DVec3; 3]], origin: DVec3, direction: DVec3) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        for (k, [a, b, c]) in triangles.iter().enumerate() {
            let system = glam::DMat3::from_cols(*b - *a, *c - *a, -direction);
            let s = system.inverse() * (origin - *a);
            if s.is_finite()
                && s.x >= 0.0
                && s.y >= 0.0
                && s.x + s.y <= 1.0
                && s.z > 0.0
                && best.is_none_or(|(_, t)| s.z < t)
            {
                best = Some((k, s.z));
            }
        }
        best
    }

    #[test]
    fn trees_find_what_brute_force_finds() {
        let mut rng = Pcg64::seed_from_u64(3);
        let mut shapes = Vec::new();
        let mut meshes = Vec::new();
        for _ in 0..2 {
            let mut positions = Vec::new();
            for _ in 0..40 {
                let corner = point(&mut rng, 1.0);
                positions.extend([corner, corner + point(&mut rng, 0.6), corner + point(&mut rng, 0.6)]);
            }
            let indices: Vec<u32> = (0..120).collect();
            shapes.push(Shape::new(&positions, &indices));
            meshes.push(positions);
        }
        let mut placed = Vec::new();
        let mut world = Vec::new();
        for k in 0..25 {
            let turn = DQuat::from_axis_angle(point(&mut rng, 1.0).normalize(), 6.0 * rng.random::<f64>());
            let transform = DMat4::from_scale_rotation_translation(
                DVec3::splat(0.5 + rng.random::<f64>()),
                turn,
                point(&mut rng, 4.0),
            );
            placed.push((k % 2, transform));
            world.extend(meshes[k % 2].chunks(3).map(|t| [0, 1, 2].map(|i| transform.transform_point3(t[i]))));
        }
        let forest = Forest::new(shapes, &placed);
        let mut hits = 0;
        for _ in 0..1500 {
            let (origin, aim) = (point(&mut rng, 8.0), point(&mut rng, 4.0));
            let direction = aim - origin;
            let ray = Ray::new(origin, direction);
            let found = forest.nearest(&ray, |_, _, _| true);
            let expected = brute(&world, origin, direction);
            assert_eq!(found.map(|h| h.instance * 40 + h.triangle), expected.map(|e| e.0));
            assert_eq!(forest.blocked(&ray, |_, _, _| true), expected.is_some());
            if let (Some(h), Some((_, t))) = (found, expected) {
                assert!((h.t - t).abs() < 1e-9);
                hits += 1;
            }
        }
        assert!(hits > 300, "only {hits} of 1500 rays hit anything: the test sees too little");
    }

    #[test]
    fn rays_through_shared_edges_and_vertices_do_not_leak() {
        // a flat grid, axis-aligned rays through every vertex and edge midpoint, and slanted ones
        let n = 8u32;
        let positions: Vec<DVec3> = (0..=n)
            .flat_map(|j| (0..=n).map(move |i| DVec3::new(f64::from(i) * 0.1, f64::from(j) * 0.3, 0.7)))
            .collect();
        let mut indices = Vec::new();
        for j in 0..n {
            for i in 0..n {
                let a = j * (n + 1) + i;
                indices.extend([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1]);
            }
        }
        let forest = Forest::new(vec![Shape::new(&positions, &indices)], &[(0, DMat4::from_rotation_z(0.3))]);
        let turn = DMat4::from_rotation_z(0.3);
        for j in 0..=2 * n {
            for i in 0..=2 * n {
                let target = turn.transform_point3(DVec3::new(f64::from(i) * 0.05, f64::from(j) * 0.15, 0.7));
                let inside = i > 0 && j > 0 && i < 2 * n && j < 2 * n;
                for origin in [target + DVec3::Z, target - DVec3::Z * 3.0, DVec3::new(5.0, -3.0, 9.0)] {
                    let found = forest.nearest(&Ray::new(origin, target - origin), |_, _, _| true);
                    assert!(!inside || found.is_some(), "leak at {i} {j}");
                }
            }
        }
    }

    #[test]
    fn empty_scenes_empty_leaves_and_refused_hits() {
        let nothing = Forest::new(Vec::new(), &[]);
        let ray = Ray::new(DVec3::Z, -DVec3::Z);
        assert!(nothing.nearest(&ray, |_, _, _| true).is_none() && nothing.extent() == 0.0);
        let hollow = Forest::new(vec![Shape::new(&[], &[])], &[(0, DMat4::IDENTITY)]);
        assert!(hollow.nearest(&ray, |_, _, _| true).is_none());
        let stacked: Vec<DVec3> = (0..3)
            .flat_map(|k| {
                [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)]
                    .map(|p| p - DVec3::Z * f64::from(k))
            })
            .collect();
        let forest = Forest::new(vec![Shape::new(&stacked, &(0..9).collect::<Vec<_>>())], &[(0, DMat4::IDENTITY)]);
        assert_eq!(forest.nearest(&ray, |_, t, _| t != 0).map(|h| h.triangle), Some(1));
        assert!(!forest.blocked(&ray, |_, _, _| false));
        // hundreds of coincident triangles: a tree deeper than the fixed stack must still work
        let pile: Vec<DVec3> = (0..600)
            .flat_map(|_| [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, 1.0, 0.0)])
            .collect();
        let pile = Forest::new(vec![Shape::new(&pile, &(0..1800).collect::<Vec<_>>())], &[(0, DMat4::IDENTITY)]);
        assert_eq!(pile.nearest(&ray, |_, _, _| true).map(|h| h.t), Some(1.0));
    }
}
