//! A mesh with its tree.

use crate::arena::Tree;
use crate::frame::Bounds;
use crate::lanes::{Lanes, WIDTH};
use crate::ray::Ray;
use crate::triangle::{PACKET, Sheared, Triangle, candidates, pack};
use crate::walk::{Local, Visit, walk};
use glam::DVec3;

/// A leaf's triangles in their own space.
#[derive(Debug, Clone)]
pub struct Shape {
    triangles: Vec<Triangle>,
    pub(crate) tree: Tree,
}

impl Shape {
    /// The triangles of a mesh, three indices each, in boxes that rays can be tried on. Triangles with a coordinate
    /// that is not finite keep their number and are never met.
    ///
    /// # Panics
    /// Where an index is not below the number of positions.
    pub fn new(positions: &[DVec3], indices: &[u32]) -> Shape {
        let corners = |t: &[u32]| [0, 1, 2].map(|k| positions[t[k] as usize]);
        let triangles: Vec<Triangle> = indices.chunks_exact(3).map(|t| corners(t).map(|p| p.to_array())).collect();
        let (mut numbers, mut boxes) = (Vec::with_capacity(triangles.len()), Vec::with_capacity(triangles.len()));
        for (k, triangle) in indices.chunks_exact(3).map(corners).enumerate() {
            if triangle.iter().all(|p| p.is_finite()) {
                numbers.push(k as u32);
                boxes.push(Bounds::of(triangle));
            }
        }
        let tree = Tree::build(&boxes, WIDTH as u32, |frame, things, lines| {
            let mut ids = [0; WIDTH];
            for (id, &thing) in ids.iter_mut().zip(things) {
                *id = numbers[thing as usize];
            }
            pack(frame, &triangles, &ids[..things.len()], lines)
        });
        Shape { triangles, tree }
    }

    /// How many triangles there are.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The hits with 0 < t ≤ limit in a ray of the shape's own space, in any order: `found(triangle, t, barycentric,
    /// limit)` may lower the limit, and ends the search by returning true. Nothing is met before `from`.
    #[inline(always)]
    pub(crate) fn meet<L: Lanes>(
        &self,
        ray: &Ray,
        from: f64,
        limit: &mut f64,
        found: impl FnMut(u32, f64, [f64; 2], &mut f64) -> bool,
    ) -> bool {
        let Some(local) = Local::<L>::new(ray, from, &self.tree.frame, &self.tree.bounds) else { return false };
        walk(&self.tree, &local, limit, &mut Triangles { shape: self, ray, sheared: None, found })
    }
}

/// Tries a leaf's triangles.
struct Triangles<'a, F> {
    shape: &'a Shape,
    ray: &'a Ray,
    /// Made when the first triangle needs it.
    sheared: Option<Sheared>,
    found: F,
}

impl<L: Lanes, F: FnMut(u32, f64, [f64; 2], &mut f64) -> bool> Visit<L> for Triangles<'_, F> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, local: &Local<L>, _near: f32, s: f32, limit: &mut f64) -> bool {
        // `pack` writes a whole packet before `Tree::build` stores the line at which it begins, and lines are never
        // taken away: a leaf's code always has a packet behind it.
        let packet =
            self.shape.tree.lines[code as usize..].first_chunk::<PACKET>().expect("a leaf's code names a packet");
        let (mut lanes, ids) = candidates(local, L::splat(s), packet);
        while lanes != 0 {
            let id = ids[lanes.trailing_zeros() as usize & 7];
            lanes &= lanes - 1;
            let sheared = self.sheared.get_or_insert_with(|| Sheared::new(self.ray));
            if let Some((t, b1, b2)) = sheared.meet(&self.shape.triangles[id as usize])
                && t > 0.0
                && t <= *limit
                && (self.found)(id, t, [b1, b2], limit)
            {
                return true;
            }
        }
        false
    }
}
