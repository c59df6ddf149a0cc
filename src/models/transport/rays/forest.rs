//! Shapes that are placed in a scene, and the search for what a ray hits among them.

use crate::rays::arena::Tree;
use crate::rays::frame::Bounds;
use crate::rays::ray::Ray;
use crate::rays::shape::{Met, TriangleTree};
use crate::rays::traversal::{Local, Visit, walk};
use glam::{DAffine3, DMat4, DVec3};
use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::SingleLanes;
use mesophyll_base::processor::InstructionSet;

/// A point where a ray hits a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Distance along the ray, in units of the length of its direction.
    pub t: f64,
    /// The instance that was hit.
    pub instance: usize,
    /// The triangle of the instance's shape that was hit.
    pub triangle: usize,
    /// Weights of the triangle's second and third corner.
    pub barycentric: [f64; 2],
    /// The place at which the instance's group was hit; `None` for an instance that stands by itself.
    pub place: Option<u32>,
}

/// A placed shape.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Instance {
    pub shape: usize,
    pub to_local: DAffine3,
}

/// A placed group.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroupPlace {
    pub group: usize,
    pub to_local: DAffine3,
}

/// All instances, with a tree of boxes over them. Instances of a group stand together in any number of places, and are
/// stored once.
#[derive(Debug, Clone)]
pub struct InstanceForest {
    pub(crate) shapes: Vec<TriangleTree>,
    /// The instances that stand by themselves, and then those of the groups, in their group's space.
    pub(crate) placed: Vec<Instance>,
    /// How many of them stand by themselves.
    pub(crate) single: usize,
    /// A tree over the instances of each group, in the group's space.
    pub(crate) groups: Vec<Tree>,
    pub(crate) places: Vec<GroupPlace>,
    /// Over single instances, which have their numbers in it, and over places, which have the numbers after those.
    pub(crate) tree: Tree,
    pub(crate) instructions: InstructionSet,
}

/// Shapes or groups at places: the index of each, and the transform from its own space.
pub type Placements<'a> = &'a [(usize, DMat4)];

/// The box around boxes that are placed; `None` where there is none that is finite.
fn around(parts: &[Bounds], transform: &DMat4) -> Option<Bounds> {
    // The boxes under a tree's root together fit a rotated shape more closely than its single box would.
    let corners = parts.iter().flat_map(Bounds::corners);
    let bounds = Bounds::of(corners.map(|p| transform.transform_point3(p))).padded();
    (!bounds.is_empty() && bounds.low.is_finite() && bounds.high.is_finite()).then_some(bounds)
}

/// A tree over boxes, whose leaves are numbers of things.
fn over(boxes: impl Iterator<Item = (usize, Option<Bounds>)>) -> Tree {
    let (numbers, boxes): (Vec<usize>, Vec<Bounds>) = boxes.filter_map(|(k, bounds)| Some((k, bounds?))).unzip();
    Tree::build(&boxes, 1, |_, things, _| numbers[things[0] as usize] as u32)
}

impl InstanceForest {
    /// `placed` holds, for each instance, the index of its shape and its local → world transform (affine, invertible).
    ///
    /// # Panics
    /// Where the index of a shape is not below their number.
    pub fn new(shapes: Vec<TriangleTree>, placed: Placements) -> InstanceForest {
        InstanceForest::with_groups(shapes, placed, &[], &[])
    }

    /// Like [`InstanceForest::new`], with groups of instances. `groups` holds the instances of each, in the group's own
    /// space, and `places` where groups stand. Instances of groups are numbered after `placed`, group by group.
    ///
    /// # Panics
    /// Where the index of a shape or of a group is not below their number, and for more than 2³¹ instances and places.
    pub fn with_groups(
        shapes: Vec<TriangleTree>,
        placed: Placements,
        groups: &[Vec<(usize, DMat4)>],
        places: Placements,
    ) -> InstanceForest {
        let parts: Vec<Vec<Bounds>> = shapes.iter().map(|shape| shape.tree.parts()).collect();
        let of_shape = |(shape, transform): &(usize, DMat4)| around(&parts[*shape], transform);
        let mut first = placed.len();
        let mut of_group = |group: &Vec<(usize, DMat4)>| {
            let begin = first;
            first += group.len();
            over((begin..).zip(group.iter().map(of_shape)))
        };
        let trees: Vec<Tree> = groups.iter().map(&mut of_group).collect();
        let whole: Vec<Vec<Bounds>> = trees.iter().map(Tree::parts).collect();
        let standing = places.iter().map(|(group, transform)| around(&whole[*group], transform));
        let tree = over(placed.iter().map(of_shape).chain(standing).enumerate());
        let to_local = |transform: &DMat4| DAffine3::from_mat4(transform.inverse());
        let instance = |(shape, transform): &(usize, DMat4)| Instance { shape: *shape, to_local: to_local(transform) };
        InstanceForest {
            shapes,
            placed: placed.iter().chain(groups.iter().flatten()).map(instance).collect(),
            single: placed.len(),
            groups: trees,
            places: places
                .iter()
                .map(|(group, transform)| GroupPlace { group: *group, to_local: to_local(transform) })
                .collect(),
            tree,
            instructions: InstructionSet::detect(),
        }
    }

    /// The same forest searched with other instructions, if the processor has them; for tests and measurements.
    pub fn with_instructions(mut self, set: InstructionSet) -> InstanceForest {
        self.instructions = set.or_less();
        self
    }

    /// Whether a single instance is all there is, which needs no tree of instances.
    #[inline(always)]
    pub(crate) fn is_one(&self) -> bool {
        self.single == 1 && self.places.is_empty()
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

    /// The nearest hit with t > 0 that `accept(instance, triangle, barycentric)` accepts (an alpha test). Of several
    /// hits at the same t, the one with the lowest instance, triangle and place is returned.
    pub fn nearest(&self, ray: &Ray, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> Option<RayHit> {
        self.nearest_within(ray, f64::INFINITY, accept)
    }

    /// The nearest hit with 0 < t < `limit` that `accept` accepts.
    pub fn nearest_within(
        &self,
        ray: &Ray,
        limit: f64,
        accept: impl Fn(usize, usize, [f64; 2]) -> bool,
    ) -> Option<RayHit> {
        self.first(ray, limit, &accept)
    }

    /// Whether there is a hit at t > 0 that `accept` accepts.
    pub fn blocked(&self, ray: &Ray, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> bool {
        self.blocked_within(ray, f64::INFINITY, accept)
    }

    /// Whether there is a hit at 0 < t < `limit` that `accept` accepts.
    pub fn blocked_within(&self, ray: &Ray, limit: f64, accept: impl Fn(usize, usize, [f64; 2]) -> bool) -> bool {
        self.any(ray, limit, &accept)
    }

    fn first(&self, ray: &Ray, limit: f64, accept: Accept<'_>) -> Option<RayHit> {
        let mut first = First { accept, farthest: limit, best: None, place: None };
        self.search::<false, _>(ray, limit, &mut first);
        first.best
    }

    fn any(&self, ray: &Ray, limit: f64, accept: Accept<'_>) -> bool {
        self.search::<true, _>(ray, limit, &mut Any { accept })
    }

    /// The corners of a triangle of shape `shape`, in the shape's own space.
    ///
    /// # Panics
    /// Where there is no such shape or triangle.
    #[inline]
    pub fn corners(&self, shape: usize, triangle: usize) -> [DVec3; 3] {
        self.shapes[shape].triangles[triangle].map(DVec3::from)
    }

    /// Tries hits with 0 < t ≤ limit, in no certain order, until `found` ends it; with `ANY` also until a solid
    /// triangle is met for sure with t < limit.
    fn search<const ANY: bool, F: Found>(&self, ray: &Ray, limit: f64, found: &mut F) -> bool {
        let forest = self;
        dispatch_lanes!(self.instructions, F32[ANY][F: Found], search(forest: &InstanceForest, ray: &Ray, limit: f64,
            found: &mut F) -> bool)
    }
}

/// What is done with a hit.
pub(crate) trait Found {
    /// Takes the instance, what is met of it and the limit, which it may lower; true ends the search.
    fn found(&mut self, instance: usize, met: Met, limit: &mut f64) -> bool;

    /// Hears at which place what follows is met; `None` for what stands by itself.
    fn stands_at(&mut self, place: Option<u32>);
}

/// Which hits count: takes instance, triangle and barycentric coordinates. It is called through a pointer, so that the
/// search is compiled once, here, and not again for each function that anyone passes.
pub(crate) type Accept<'a> = &'a dyn Fn(usize, usize, [f64; 2]) -> bool;

/// Looks for the nearest hit before `farthest`.
pub(crate) struct First<'a> {
    pub accept: Accept<'a>,
    pub farthest: f64,
    pub best: Option<RayHit>,
    /// The place of the group that is searched.
    pub place: Option<u32>,
}

impl Found for First<'_> {
    #[inline(always)]
    fn found(&mut self, instance: usize, met: Met, limit: &mut f64) -> bool {
        let Met { t, barycentric, solid, .. } = met;
        let triangle = met.triangle as usize;
        let place = self.place;
        let order = |b: RayHit| (instance, triangle, place) < (b.instance, b.triangle, b.place);
        let first = t < self.farthest && self.best.is_none_or(|b| t < b.t || order(b));
        if first && (solid || (self.accept)(instance, triangle, barycentric)) {
            *limit = t;
            self.best = Some(RayHit { t, instance, triangle, barycentric, place });
        }
        false
    }

    #[inline(always)]
    fn stands_at(&mut self, place: Option<u32>) {
        self.place = place;
    }
}

/// Looks for any hit before the limit.
struct Any<'a> {
    accept: Accept<'a>,
}

impl Found for Any<'_> {
    #[inline(always)]
    fn found(&mut self, instance: usize, met: Met, limit: &mut f64) -> bool {
        met.t < *limit && (met.solid || (self.accept)(instance, met.triangle as usize, met.barycentric))
    }

    #[inline(always)]
    fn stands_at(&mut self, _: Option<u32>) {}
}

#[inline(always)]
fn search<L: SingleLanes, const ANY: bool, F: Found>(
    forest: &InstanceForest,
    ray: &Ray,
    mut limit: f64,
    found: &mut F,
) -> bool {
    if forest.is_one() {
        return enter::<L, ANY, F>(forest, 0, ray, 0.0, &mut limit, found);
    }
    let Some(local) = Local::new(ray, 0.0, &forest.tree.frame, &forest.tree.bounds) else { return false };
    walk::<L, ANY, _>(&forest.tree, &local, &mut limit, &mut Instances::<F, ANY> { forest, ray, found })
}

/// Searches one instance.
#[inline(always)]
fn enter<L: SingleLanes, const ANY: bool, F: Found>(
    forest: &InstanceForest,
    k: usize,
    ray: &Ray,
    from: f64,
    limit: &mut f64,
    found: &mut F,
) -> bool {
    let instance = &forest.placed[k];
    forest.shapes[instance.shape].meet::<L, ANY, F>(&ray.through(&instance.to_local), from, limit, k, found)
}

/// Searches a group at one of its places.
#[inline(always)]
fn enter_group<L: SingleLanes, const ANY: bool, F: Found>(
    forest: &InstanceForest,
    k: usize,
    ray: &Ray,
    from: f64,
    limit: &mut f64,
    found: &mut F,
) -> bool {
    let GroupPlace { group, to_local } = &forest.places[k];
    let (tree, ray) = (&forest.groups[*group], &ray.through(to_local));
    let Some(local) = Local::new(ray, from, &tree.frame, &tree.bounds) else { return false };
    found.stands_at(Some(k as u32));
    let ended = walk::<L, ANY, _>(tree, &local, limit, &mut Members::<F, ANY> { forest, ray, found });
    found.stands_at(None);
    ended
}

/// Tries the instance of a leaf, or the group at a place.
struct Instances<'a, F, const ANY: bool> {
    forest: &'a InstanceForest,
    ray: &'a Ray,
    found: &'a mut F,
}

impl<L: SingleLanes, F: Found, const ANY: bool> Visit<L> for Instances<'_, F, ANY> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, local: &Local, near: f32, _: f32, limit: &mut f64) -> bool {
        let (k, from) = (code as usize, local.t(near));
        match k.checked_sub(self.forest.single) {
            None => enter::<L, ANY, F>(self.forest, k, self.ray, from, limit, self.found),
            Some(place) => enter_group::<L, ANY, F>(self.forest, place, self.ray, from, limit, self.found),
        }
    }
}

/// Tries an instance of a group, in whose space the ray is.
struct Members<'a, F, const ANY: bool> {
    forest: &'a InstanceForest,
    ray: &'a Ray,
    found: &'a mut F,
}

impl<L: SingleLanes, F: Found, const ANY: bool> Visit<L> for Members<'_, F, ANY> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, local: &Local, near: f32, _: f32, limit: &mut f64) -> bool {
        enter::<L, ANY, F>(self.forest, code as usize, self.ray, local.t(near), limit, self.found)
    }
}
