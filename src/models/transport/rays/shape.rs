//! A mesh with its tree of boxes.

use crate::rays::arena::Tree;
use crate::rays::forest::Found;
use crate::rays::frame::Bounds;
use crate::rays::ray::Ray;
use crate::rays::traversal::{Local, Visit, next, walk};
use crate::rays::triangle::{Candidates, PACKET, SOLID, Sheared, Triangle, candidates, pack};
use glam::DVec3;
use mesophyll_base::lanes::{SingleLanes, WIDTH, prefetch};

/// A leaf's triangles in the leaf's own coordinates, with a tree of boxes.
#[derive(Debug, Clone)]
pub struct TriangleTree {
    pub(crate) triangles: Vec<Triangle>,
    pub(crate) tree: Tree,
}

impl TriangleTree {
    /// The triangles of a mesh, with three indices each, in a tree of boxes. A triangle with a coordinate that is not
    /// finite keeps its number, but is never hit.
    ///
    /// # Panics
    /// Where an index is not below the number of positions.
    pub fn new(positions: &[DVec3], indices: &[u32]) -> TriangleTree {
        TriangleTree::with_solid(positions, indices, |_| false)
    }

    /// Like [`TriangleTree::new`]. All points of a `solid` triangle count as hits, so that `accept` is not called for
    /// it, which saves time.
    ///
    /// # Panics
    /// As [`TriangleTree::new`].
    pub fn with_solid(positions: &[DVec3], indices: &[u32], solid: impl Fn(usize) -> bool) -> TriangleTree {
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
                let number = numbers[thing as usize];
                *id = if solid(number as usize) { number | SOLID } else { number };
            }
            pack(frame, &triangles, &ids[..things.len()], lines)
        });
        TriangleTree { triangles, tree }
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The hits with 0 < t ≤ limit in a ray of the shape's own space, in any order: `found` may lower the limit, and
    /// ends the search by returning true. Nothing is met before `from`. Where `ANY` is set the search also ends,
    /// without a word, at a solid triangle that is met for sure with t < limit.
    #[inline(always)]
    pub(crate) fn meet<L: SingleLanes, const ANY: bool, F: Found>(
        &self,
        ray: &Ray,
        from: f64,
        limit: &mut f64,
        instance: usize,
        found: &mut F,
    ) -> bool {
        let Some(local) = Local::new(ray, from, &self.tree.frame, &self.tree.bounds) else { return false };
        let mut tried = Tried::NONE;
        tried.begin(*ray);
        walk::<L, ANY, _>(
            &self.tree,
            &local,
            limit,
            &mut Triangles::<F, ANY> { shape: self, instance, tried: &mut tried, found },
        ) || tried.decide(self, instance, limit, found)
    }
}

/// A triangle that a ray hits.
pub(crate) struct Met {
    pub triangle: u32,
    pub t: f64,
    pub barycentric: [f64; 2],
    /// Whether all points of the triangle count as hits.
    pub solid: bool,
}

/// Number of triangles that can wait for their f64 test.
const LATER: usize = 8;

/// The triangles of an instance that a ray has tried so far.
///
/// Where f32 is sure that a solid triangle is hit, it lowers the limit at once to the largest distance that f32 allows.
/// The f64 test follows when the walk is over; by then the triangle's corners have arrived from memory. The result
/// stays the same, because every other triangle that may be as near is tested too.
#[derive(Clone, Copy)]
pub(crate) struct Tried {
    /// In the shape's own space.
    ray: Ray,
    /// Computed when the first triangle needs it.
    sheared: Option<Sheared>,
    /// Numbers of the triangles that wait; only the first `waiting` are valid.
    later: [u32; LATER],
    waiting: usize,
}

impl Tried {
    /// Of no ray.
    pub const NONE: Tried = Tried {
        ray: Ray { origin: DVec3::ZERO, direction: DVec3::ZERO },
        sheared: None,
        later: [0; LATER],
        waiting: 0,
    };

    /// Nothing of an instance, whose space `ray` is in.
    #[inline(always)]
    pub fn begin(&mut self, ray: Ray) {
        (self.ray, self.sheared, self.waiting) = (ray, None, 0);
    }

    /// The f64 test of a triangle; true ends the search.
    #[inline(always)]
    fn meet(
        &mut self,
        shape: &TriangleTree,
        instance: usize,
        id: u32,
        limit: &mut f64,
        found: &mut impl Found,
    ) -> bool {
        let (triangle, solid) = (id & !SOLID, id & SOLID != 0);
        let sheared = self.sheared.get_or_insert_with(|| Sheared::new(&self.ray));
        let Some((t, b1, b2)) = sheared.meet(&shape.triangles[triangle as usize]) else { return false };
        t > 0.0 && t <= *limit && found.found(instance, Met { triangle, t, barycentric: [b1, b2], solid }, limit)
    }

    /// The f64 test of those that wait.
    #[inline(always)]
    pub fn decide(&mut self, shape: &TriangleTree, instance: usize, limit: &mut f64, found: &mut impl Found) -> bool {
        let waiting = std::mem::take(&mut self.waiting);
        for k in 0..waiting {
            if self.meet(shape, instance, self.later[k], limit, found) {
                return true;
            }
        }
        false
    }
}

/// Tries a leaf's triangles.
pub(crate) struct Triangles<'a, F, const ANY: bool> {
    pub shape: &'a TriangleTree,
    pub instance: usize,
    pub tried: &'a mut Tried,
    pub found: &'a mut F,
}

impl<L: SingleLanes, F: Found, const ANY: bool> Visit<L> for Triangles<'_, F, ANY> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, local: &Local, _near: f32, s: f32, limit: &mut f64) -> bool {
        let Triangles { shape, instance, tried, found } = self;
        // `pack` writes a whole packet before `Tree::build` stores the line at which it begins, and lines are never
        // taken away: a leaf's code always has a packet behind it.
        let packet = shape.tree.lines[code as usize..].first_chunk::<PACKET>().expect("a leaf's code names a packet");
        let Some(Candidates { mut lanes, sure, within, farthest, ids }) = candidates::<L>(local, L::splat(s), packet)
        else {
            return false;
        };
        let solid = L::from_bits(ids).signs();
        if ANY && solid & within != 0 {
            return true;
        }
        let mut later = solid & sure;
        if later != 0 {
            lanes &= !later;
            let mut ends = [0.0; WIDTH];
            farthest.store(&mut ends);
            while later != 0 {
                let lane = next(&mut later);
                if tried.waiting == LATER && tried.decide(shape, *instance, limit, *found) {
                    return true;
                }
                let id = ids[lane];
                tried.later[tried.waiting & (LATER - 1)] = id;
                tried.waiting += 1;
                prefetch::<2, _>(shape.triangles.as_ptr().wrapping_add((id & !SOLID) as usize));
                *limit = limit.min(local.t(ends[lane]));
            }
        }
        while lanes != 0 {
            if tried.meet(shape, *instance, ids[next(&mut lanes)], limit, *found) {
                return true;
            }
        }
        false
    }
}
