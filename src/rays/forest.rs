//! Shapes in their places.

use crate::arena::Tree;
use crate::frame::Bounds;
use crate::lanes::{Lanes, Level, dispatch};
use crate::ray::Ray;
use crate::shape::{Met, Shape};
use crate::walk::{Local, Visit, walk};
use glam::{DAffine3, DMat4, DVec3};

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

/// A shape in its place.
#[derive(Debug, Clone, Copy)]
struct Instance {
    shape: usize,
    to_local: DAffine3,
}

/// All instances.
#[derive(Debug, Clone)]
pub struct Forest {
    shapes: Vec<Shape>,
    placed: Vec<Instance>,
    tree: Tree,
    level: Level,
}

impl Forest {
    /// `placed` holds the index of a shape and its local → world transform (affine, invertible).
    ///
    /// # Panics
    /// Where the index of a shape is not below their number.
    pub fn new(shapes: Vec<Shape>, placed: &[(usize, DMat4)]) -> Forest {
        let parts: Vec<Vec<Bounds>> = shapes.iter().map(|shape| shape.tree.parts()).collect();
        let (mut numbers, mut boxes) = (Vec::new(), Vec::new());
        for (k, (shape, transform)) in placed.iter().enumerate() {
            // The boxes under a shape's root lie closer around it than the one box would, once it is turned.
            let corners = parts[*shape].iter().flat_map(Bounds::corners);
            let bounds = Bounds::of(corners.map(|p| transform.transform_point3(p))).padded();
            if !bounds.is_empty() && bounds.low.is_finite() && bounds.high.is_finite() {
                numbers.push(k as u32);
                boxes.push(bounds);
            }
        }
        let tree = Tree::build(&boxes, 1, |_, things, _| numbers[things[0] as usize]);
        let placed = placed
            .iter()
            .map(|(shape, transform)| Instance { shape: *shape, to_local: DAffine3::from_mat4(transform.inverse()) })
            .collect();
        Forest { shapes, placed, tree, level: Level::detect() }
    }

    /// The same forest at another level, where the processor has it: for tests and measurements.
    pub fn at_level(mut self, level: Level) -> Forest {
        self.level = level.available();
        self
    }

    /// Lowest and highest corner of the box around everything; `None` for an empty scene.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        let Bounds { low, high } = self.tree.bounds;
        (!self.tree.bounds.is_empty()).then_some([low, high])
    }

    /// Length of the diagonal of the box around everything; 0 for an empty scene.
    pub fn extent(&self) -> f64 {
        let bounds = self.tree.bounds;
        if bounds.is_empty() { 0.0 } else { (bounds.high - bounds.low).length() }
    }

    /// The nearest hit with t > 0 that `accept(instance, triangle, barycentric)` lets pass (an alpha test). Of hits at
    /// the same t the one with the lowest instance and triangle counts.
    pub fn nearest(&self, ray: &Ray, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> Option<Hit> {
        self.nearest_within(ray, f64::INFINITY, accept)
    }

    /// The nearest hit with 0 < t < `limit` that `accept` lets pass.
    pub fn nearest_within(
        &self,
        ray: &Ray,
        limit: f64,
        accept: impl Fn(usize, usize, [f64; 2]) -> bool,
    ) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        let farthest = limit;
        self.search::<false, _>(ray, limit, |instance, met, limit| {
            let Met { t, barycentric, solid, .. } = met;
            let triangle = met.triangle as usize;
            let hit = Hit { t, instance, triangle, barycentric };
            let first = t < farthest && best.is_none_or(|b| t < b.t || (instance, triangle) < (b.instance, b.triangle));
            if first && (solid || accept(instance, triangle, barycentric)) {
                *limit = t;
                best = Some(hit);
            }
            false
        });
        best
    }

    /// Whether anything that `accept` lets pass lies at t > 0.
    pub fn blocked(&self, ray: &Ray, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> bool {
        self.blocked_within(ray, f64::INFINITY, accept)
    }

    /// Whether anything that `accept` lets pass lies at 0 < t < `limit`.
    pub fn blocked_within(&self, ray: &Ray, limit: f64, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> bool {
        self.search::<true, _>(ray, limit, |instance, met, _| {
            met.t < limit && (met.solid || accept(instance, met.triangle as usize, met.barycentric))
        })
    }

    /// Tries hits with 0 < t ≤ limit, in no certain order, until `found` ends it; with `ANY` also until a solid triangle
    /// is met for sure with t < limit.
    fn search<const ANY: bool, F: Found>(&self, ray: &Ray, limit: f64, found: F) -> bool {
        let forest = self;
        dispatch!(self.level, [ANY], [F: Found], search(forest: &Forest, ray: &Ray, limit: f64, found: F) -> bool)
    }
}

/// What is done with a hit: takes the instance, what is met of it and the limit, which it may lower; true ends the
/// search.
trait Found: FnMut(usize, Met, &mut f64) -> bool {}

impl<F: FnMut(usize, Met, &mut f64) -> bool> Found for F {}

#[inline(always)]
fn search<L: Lanes, const ANY: bool, F: Found>(forest: &Forest, ray: &Ray, mut limit: f64, mut found: F) -> bool {
    if forest.placed.len() == 1 {
        // A single instance needs no tree above its own.
        return enter::<L, ANY>(forest, 0, ray, 0.0, &mut limit, &mut found);
    }
    let Some(local) = Local::<L>::new(ray, 0.0, &forest.tree.frame, &forest.tree.bounds) else { return false };
    walk(&forest.tree, &local, &mut limit, &mut Instances::<_, ANY> { forest, ray, found })
}

/// Searches one instance.
#[inline(always)]
fn enter<L: Lanes, const ANY: bool>(
    forest: &Forest,
    k: usize,
    ray: &Ray,
    from: f64,
    limit: &mut f64,
    found: &mut impl Found,
) -> bool {
    let instance = &forest.placed[k];
    let local = ray.through(&instance.to_local);
    let shape = &forest.shapes[instance.shape];
    shape.meet::<L, ANY>(&local, from, limit, |met, limit| found(k, met, limit))
}

/// Tries the instance of a leaf.
struct Instances<'a, F, const ANY: bool> {
    forest: &'a Forest,
    ray: &'a Ray,
    found: F,
}

impl<L: Lanes, F: Found, const ANY: bool> Visit<L> for Instances<'_, F, ANY> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, local: &Local<L>, near: f32, _: f32, limit: &mut f64) -> bool {
        enter::<L, ANY>(self.forest, code as usize, self.ray, local.t(near), limit, &mut self.found)
    }
}
