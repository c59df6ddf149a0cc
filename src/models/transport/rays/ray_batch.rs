//! Many rays at once: several are followed in turns, a node or a packet each, so that what one needs next comes from
//! memory while the others are computed.
//!
//! The answers are those that each ray gets alone ([`crate::rays::traversal`], [`crate::rays::forest`]), bit by bit. It
//! pays where rays differ; for those that are close to each other see [`crate::rays::neighbours`].

use crate::rays::arena::{LEAF, Line, Tree};
use crate::rays::forest::{Accept, First, InstanceForest, RayHit};
use crate::rays::ray::Ray;
use crate::rays::shape::{TriangleTree, Triangles, Tried};
use crate::rays::traversal::{Local, Visit, back, descend_without_branches};
use crate::rays::triangle::PACKET;
use glam::DVec3;
use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::{SingleLanes, Waiting, prefetch};

/// So many rays take turns: as many steps of other rays take about as long as the memory to answer.
const TURNS: usize = 16;

/// Fewer rays are followed one by one: the turns would be short.
const FEW: usize = 8;

impl InstanceForest {
    /// What [`InstanceForest::nearest`] gives, for each of many rays; faster where the rays differ.
    pub fn nearest_of_each<A>(&self, rays: &[Ray], accept: A) -> Vec<Option<RayHit>>
    where
        A: Fn(usize, usize, [f64; 2]) -> bool,
    {
        if rays.len() < FEW {
            return rays.iter().map(|ray| self.nearest(ray, &accept)).collect();
        }
        let mut hits = vec![None; rays.len()];
        self.in_turn(rays, &accept, &mut hits);
        hits
    }

    fn in_turn(&self, rays: &[Ray], accept: Accept<'_>, hits: &mut [Option<RayHit>]) {
        let forest = self;
        dispatch_lanes!(self.instructions, F32,
            follow(forest: &InstanceForest, rays: &[Ray], accept: Accept<'_>, hits: &mut [Option<RayHit>]) -> ());
    }
}

/// A ray on its way.
struct Walker<'a> {
    /// Which of the rays.
    number: usize,
    first: First<'a>,
    limit: f64,
    /// The ray in the frame of the tree over the instances, where there are several.
    outer: Local,
    /// The group that is walked at one of its places: its tree, and the ray in its space and in its tree's frame.
    /// `None` in the tree over all instances and places.
    group: Option<&'a Tree>,
    in_group: (Ray, Local),
    /// The instance that is walked.
    instance: usize,
    /// Its shape; `None` in the trees over instances.
    shape: Option<&'a TriangleTree>,
    tree: &'a Tree,
    /// The ray in the tree's frame, and the limit there.
    local: Local,
    s: f32,
    /// What it comes to next.
    current: Waiting,
    /// How many children wait for it, how many of them are of trees over instances, and of those how many are of the
    /// tree over all.
    count: usize,
    instances: usize,
    places: usize,
    tried: Tried,
}

/// The numbers of some walkers.
#[derive(Clone, Copy)]
struct Queue {
    numbers: [usize; TURNS],
    count: usize,
}

impl Queue {
    const EMPTY: Queue = Queue { numbers: [0; TURNS], count: 0 };

    #[inline(always)]
    fn push(&mut self, number: usize) {
        self.numbers[self.count] = number;
        self.count += 1;
    }
}

/// The rays' numbers, those with the same signs of their direction together: they meet boxes in the same order.
fn alike(rays: &[Ray]) -> Vec<usize> {
    let signs = |ray: &Ray| ray.direction.is_negative_bitmask() as usize;
    let mut at = [0; 8];
    rays.iter().for_each(|ray| at[signs(ray)] += 1);
    let mut before = 0;
    for place in &mut at {
        before += std::mem::replace(place, before);
    }
    let mut order = vec![0; rays.len()];
    for (number, ray) in rays.iter().enumerate() {
        let place = &mut at[signs(ray)];
        order[*place] = number;
        *place += 1;
    }
    order
}

#[inline(always)]
fn follow<L: SingleLanes>(forest: &InstanceForest, rays: &[Ray], accept: Accept<'_>, hits: &mut [Option<RayHit>]) {
    let deepest = forest.shapes.iter().map(|shape| shape.tree.waiting).max().unwrap_or(0);
    let groups = forest.groups.iter().map(|tree| tree.waiting).max().unwrap_or(0);
    let most = forest.tree.waiting + groups + deepest;
    let mut waiting = vec![Waiting::default(); TURNS * most];
    let mut walkers: [Walker<'_>; TURNS] = std::array::from_fn(|_| Walker {
        number: 0,
        first: First { accept, farthest: f64::INFINITY, best: None, place: None },
        limit: f64::INFINITY,
        outer: Local::NONE,
        group: None,
        in_group: (Ray { origin: DVec3::ZERO, direction: DVec3::ZERO }, Local::NONE),
        instance: 0,
        shape: None,
        tree: &forest.tree,
        local: Local::NONE,
        s: 0.0,
        current: Waiting::default(),
        count: 0,
        instances: 0,
        places: 0,
        tried: Tried::NONE,
    });
    let order = alike(rays);
    let mut left = order.iter().copied();
    // Those that come to a node next, and those that come to a leaf. One kind after the other, the processor foresees
    // better what they do.
    let mut queues = [Queue::EMPTY; 2];
    for (which, walker) in walkers.iter_mut().enumerate() {
        if walker.begin(forest, rays, &mut left) {
            queues[0].push(which);
        }
    }
    while queues.iter().any(|queue| queue.count > 0) {
        let [nodes, leaves] = std::mem::replace(&mut queues, [Queue::EMPTY; 2]);
        for &which in &nodes.numbers[..nodes.count] {
            let walker = &mut walkers[which];
            let goes_on = walker.step::<L, false>(forest, rays, &mut waiting[which * most..][..most]);
            if goes_on || walker.answer(hits) && walker.begin(forest, rays, &mut left) {
                queues[walker.at_leaf()].push(which);
            }
        }
        for &which in &leaves.numbers[..leaves.count] {
            let walker = &mut walkers[which];
            let goes_on = walker.step::<L, true>(forest, rays, &mut waiting[which * most..][..most]);
            if goes_on || walker.answer(hits) && walker.begin(forest, rays, &mut left) {
                queues[walker.at_leaf()].push(which);
            }
        }
    }
}

impl<'a> Walker<'a> {
    /// 1 where it comes to a leaf next, 0 where it comes to a node.
    #[inline(always)]
    fn at_leaf(&self) -> usize {
        usize::from(self.current.code & LEAF != 0)
    }

    /// Says what the ray met; always true.
    #[inline(always)]
    fn answer(&self, hits: &mut [Option<RayHit>]) -> bool {
        hits[self.number] = self.first.best;
        true
    }

    /// Takes the next ray that comes near anything; false where there is none left.
    #[inline(always)]
    fn begin(&mut self, forest: &'a InstanceForest, rays: &[Ray], left: &mut impl Iterator<Item = usize>) -> bool {
        for number in left {
            self.number = number;
            (self.first.best, self.first.place, self.limit) = (None, None, f64::INFINITY);
            (self.group, self.count, self.instances, self.places) = (None, 0, 0, 0);
            let ray = &rays[number];
            if forest.is_one() {
                if self.enter(forest, ray, 0, 0.0) {
                    return true;
                }
            } else if !forest.tree.lines.is_empty()
                && let Some(local) = Local::new(ray, 0.0, &forest.tree.frame, &forest.tree.bounds)
            {
                self.outer = local;
                self.walk(&forest.tree, None, local);
                return true;
            }
        }
        false
    }

    /// Begins with an instance, before which the ray meets nothing until `from`; false where it misses it.
    #[inline(always)]
    fn enter(&mut self, forest: &'a InstanceForest, ray: &Ray, instance: usize, from: f64) -> bool {
        let placed = &forest.placed[instance];
        let shape = &forest.shapes[placed.shape];
        let ray = ray.through(&placed.to_local);
        let Some(local) = Local::new(&ray, from, &shape.tree.frame, &shape.tree.bounds) else { return false };
        if shape.tree.lines.is_empty() {
            return false;
        }
        (self.instance, self.instances) = (instance, self.count);
        self.tried.begin(ray);
        self.walk(&shape.tree, Some(shape), local);
        true
    }

    /// Begins with the group at a place, before which the ray meets nothing until `from`; false where it misses it.
    #[inline(always)]
    fn enter_group(&mut self, forest: &'a InstanceForest, ray: &Ray, place: usize, from: f64) -> bool {
        let of = &forest.places[place];
        let tree = &forest.groups[of.group];
        let ray = ray.through(&of.to_local);
        let Some(local) = Local::new(&ray, from, &tree.frame, &tree.bounds) else { return false };
        if tree.lines.is_empty() {
            return false;
        }
        (self.group, self.in_group, self.first.place) = (Some(tree), (ray, local), Some(place as u32));
        (self.places, self.instances) = (self.count, self.count);
        self.walk(tree, None, local);
        true
    }

    /// Begins with the instance or the place of a leaf of the tree that is walked; false where the ray misses it.
    #[inline(always)]
    fn enter_leaf(&mut self, forest: &'a InstanceForest, ray: &Ray) -> bool {
        let (k, from) = ((self.current.code & !LEAF) as usize, self.local.t(self.current.near));
        match (self.group, k.checked_sub(forest.single)) {
            (Some(_), _) => {
                let ray = self.in_group.0;
                self.enter(forest, &ray, k, from)
            }
            (None, None) => self.enter(forest, ray, k, from),
            (None, Some(place)) => self.enter_group(forest, ray, place, from),
        }
    }

    /// Begins with a tree, at its root.
    #[inline(always)]
    fn walk(&mut self, tree: &'a Tree, shape: Option<&'a TriangleTree>, local: Local) {
        (self.tree, self.shape, self.local) = (tree, shape, local);
        (self.s, self.current) = (local.s(self.limit), Waiting::default());
        fetch(tree, 0);
    }

    /// A node or a leaf; false when the walk is over.
    #[inline(always)]
    fn step<L: SingleLanes, const AT_LEAF: bool>(
        &mut self,
        forest: &'a InstanceForest,
        rays: &[Ray],
        waiting: &mut [Waiting],
    ) -> bool {
        let code = self.current.code;
        if !AT_LEAF {
            descend_without_branches::<L>(self.tree, &self.local, code, self.s, waiting, &mut self.count);
        } else if let Some(shape) = self.shape {
            let Walker { instance, tried, first, local, limit, current, s, .. } = self;
            let before = *limit;
            let mut triangles = Triangles::<_, false> { shape, instance: *instance, tried, found: first };
            if Visit::<L>::leaf(&mut triangles, code & !LEAF, local, current.near, *s, limit) {
                return false;
            }
            if *limit < before {
                *s = local.s(*limit);
            }
        } else if self.enter_leaf(forest, &rays[self.number]) {
            return true;
        }
        let mut next = back(waiting, &mut self.count, self.instances, self.s);
        if next.is_none()
            && let Some(shape) = self.shape
        {
            if self.tried.decide(shape, self.instance, &mut self.limit, &mut self.first) || self.count == 0 {
                return false;
            }
            // Back among the instances.
            (self.tree, self.local) = self.group.map_or((&forest.tree, self.outer), |tree| (tree, self.in_group.1));
            (self.shape, self.instances) = (None, self.places);
            self.s = self.local.s(self.limit);
            next = back(waiting, &mut self.count, self.instances, self.s);
        }
        if next.is_none() && self.group.is_some() {
            // Back among all instances and places.
            (self.tree, self.local, self.group, self.first.place) = (&forest.tree, self.outer, None, None);
            (self.instances, self.places) = (0, 0);
            self.s = self.local.s(self.limit);
            next = back(waiting, &mut self.count, 0, self.s);
        }
        let Some(next) = next else { return false };
        fetch(self.tree, next.code);
        self.current = next;
        true
    }
}

/// Asks the memory for a node or a packet.
#[inline(always)]
fn fetch(tree: &Tree, code: u32) {
    prefetch::<PACKET, Line>(tree.lines.as_ptr().wrapping_add((code & !LEAF) as usize));
}
