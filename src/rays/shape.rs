//! A mesh with its tree.

use crate::arena::Tree;
use crate::frame::Bounds;
use crate::lanes::{Lanes, WIDTH, prefetch};
use crate::ray::Ray;
use crate::triangle::{Candidates, PACKET, SOLID, Sheared, Triangle, candidates, pack};
use crate::walk::{Local, Visit, next, walk};
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
        Shape::with_solid(positions, indices, |_| false)
    }

    /// As [`Shape::new`], where of a triangle that is `solid` every point counts: rays are not asked whether to accept
    /// it, which saves them time.
    ///
    /// # Panics
    /// As [`Shape::new`].
    pub fn with_solid(positions: &[DVec3], indices: &[u32], solid: impl Fn(usize) -> bool) -> Shape {
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

    /// The hits with 0 < t ≤ limit in a ray of the shape's own space, in any order: `found(hit, limit)` may lower the
    /// limit, and ends the search by returning true. Nothing is met before `from`. Where `ANY` is set the search also
    /// ends, without a word, at a solid triangle that is met for sure with t < limit.
    #[inline(always)]
    pub(crate) fn meet<L: Lanes, const ANY: bool>(
        &self,
        ray: &Ray,
        from: f64,
        limit: &mut f64,
        found: impl FnMut(Met, &mut f64) -> bool,
    ) -> bool {
        let Some(local) = Local::<L>::new(ray, from, &self.tree.frame, &self.tree.bounds) else { return false };
        let mut triangles =
            Triangles::<_, ANY> { shape: self, ray, sheared: None, found, later: [0; LATER], waiting: 0 };
        walk(&self.tree, &local, limit, &mut triangles) || triangles.decide_waiting(limit)
    }
}

/// A triangle that a ray meets.
pub(crate) struct Met {
    pub triangle: u32,
    pub t: f64,
    pub barycentric: [f64; 2],
    /// Whether every point of it counts.
    pub solid: bool,
}

/// So many triangles can wait for their decision.
const LATER: usize = 8;

/// Tries a leaf's triangles.
///
/// A solid triangle that is met for sure lowers the limit at once, to what f32 says, and is decided in f64 when the walk
/// is over: by then its corners have come from memory. What is found does not change, because every triangle that may be
/// as near is decided too.
struct Triangles<'a, F, const ANY: bool> {
    shape: &'a Shape,
    ray: &'a Ray,
    /// Made when the first triangle needs it.
    sheared: Option<Sheared>,
    found: F,
    /// Numbers of the triangles that wait, the first `waiting` of them.
    later: [u32; LATER],
    waiting: usize,
}

impl<F: FnMut(Met, &mut f64) -> bool, const ANY: bool> Triangles<'_, F, ANY> {
    /// The f64 test; true ends the search.
    #[inline(always)]
    fn decide(&mut self, id: u32, limit: &mut f64) -> bool {
        let (triangle, solid) = (id & !SOLID, id & SOLID != 0);
        let sheared = self.sheared.get_or_insert_with(|| Sheared::new(self.ray));
        let Some((t, b1, b2)) = sheared.meet(&self.shape.triangles[triangle as usize]) else { return false };
        t > 0.0 && t <= *limit && (self.found)(Met { triangle, t, barycentric: [b1, b2], solid }, limit)
    }

    #[inline(always)]
    fn decide_waiting(&mut self, limit: &mut f64) -> bool {
        let waiting = std::mem::take(&mut self.waiting);
        (0..waiting).any(|k| self.decide(self.later[k], limit))
    }
}

impl<L: Lanes, F: FnMut(Met, &mut f64) -> bool, const ANY: bool> Visit<L> for Triangles<'_, F, ANY> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, local: &Local<L>, _near: f32, s: f32, limit: &mut f64) -> bool {
        // `pack` writes a whole packet before `Tree::build` stores the line at which it begins, and lines are never
        // taken away: a leaf's code always has a packet behind it.
        let packet =
            self.shape.tree.lines[code as usize..].first_chunk::<PACKET>().expect("a leaf's code names a packet");
        let Some(Candidates { mut lanes, sure, within, farthest, ids }) = candidates(local, L::splat(s), packet) else {
            return false;
        };
        let solid = L::load(ids).signs();
        if ANY && solid & within != 0 {
            return true;
        }
        let mut later = solid & sure;
        if later != 0 {
            lanes &= !later;
            let farthest = farthest.store();
            while later != 0 {
                let lane = next(&mut later);
                if self.waiting == LATER && self.decide_waiting(limit) {
                    return true;
                }
                let id = ids[lane];
                self.later[self.waiting & (LATER - 1)] = id;
                self.waiting += 1;
                prefetch::<2, _>(self.shape.triangles.as_ptr().wrapping_add((id & !SOLID) as usize));
                *limit = limit.min(local.t(farthest[lane]));
            }
        }
        while lanes != 0 {
            if self.decide(ids[next(&mut lanes)], limit) {
                return true;
            }
        }
        false
    }
}
