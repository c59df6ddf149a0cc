//! Rays that are close to each other, as those through neighbouring pixels are: several go through a tree together.
//!
//! They meet almost the same boxes. So what is to be visited next, which the processor cannot foresee, is decided once
//! for all. A box is visited by those rays alone that meet it, and each ray finds what it finds alone, bit by bit.

use crate::rays::arena::{LEAF, NODE, Tree};
use crate::rays::forest::{Accept, First, InstanceForest, RayHit};
use crate::rays::ray::Ray;
use crate::rays::shape::{TriangleTree, Triangles, Tried};
use crate::rays::traversal::{FARTHEST, Local, Visit, back, next};
use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::{SingleLanes, WIDTH, Waiting, prefetch};

/// So many rays go together, one for each bit of a byte.
const GROUP: usize = 8;

/// The rays of a group, as bits.
type Who = u8;

impl InstanceForest {
    /// What [`InstanceForest::nearest`] gives, for each of many rays; faster where each ray is close to the next.
    pub fn nearest_of_neighbours<A>(&self, rays: &[Ray], accept: A) -> Vec<Option<RayHit>>
    where
        A: Fn(usize, usize, [f64; 2]) -> bool,
    {
        let mut hits = vec![None; rays.len()];
        self.in_groups(rays, &accept, &mut hits);
        hits
    }

    fn in_groups(&self, rays: &[Ray], accept: Accept<'_>, hits: &mut [Option<RayHit>]) {
        let forest = self;
        dispatch_lanes!(self.instructions, F32,
            follow(forest: &InstanceForest, rays: &[Ray], accept: Accept<'_>, hits: &mut [Option<RayHit>]) -> ());
    }
}

/// What a ray has found so far, and the limit on t of what it still looks for.
struct Found<'a> {
    first: First<'a>,
    limit: f64,
}

/// A group's rays in a tree's frame.
struct Group {
    locals: [Local; GROUP],
    /// The limit of each on s.
    s: [f32; GROUP],
    /// The rays that meet the tree's box.
    who: Who,
}

impl Group {
    /// The rays `who`, which meet nothing before `from`.
    #[inline(always)]
    fn new(rays: &[Ray; GROUP], who: Who, from: [f64; GROUP], tree: &Tree, found: &[Found; GROUP]) -> Group {
        let mut group = Group { locals: [Local::NONE; GROUP], s: [0.0; GROUP], who: 0 };
        if tree.lines.is_empty() {
            return group;
        }
        for k in each(who) {
            if let Some(local) = Local::new(&rays[k], from[k], &tree.frame, &tree.bounds) {
                (group.locals[k], group.s[k]) = (local, local.s(found[k].limit));
                group.who |= 1 << k;
            }
        }
        group
    }

    /// The largest limit on s.
    #[inline(always)]
    fn farthest(&self) -> f32 {
        each(self.who).fold(0.0, |most: f32, k| most.max(self.s[k]))
    }
}

/// The numbers of the rays.
#[inline(always)]
fn each(who: Who) -> impl Iterator<Item = usize> {
    let mut left = u32::from(who);
    std::iter::from_fn(move || (left != 0).then(|| next(&mut left)))
}

/// What a group does at a leaf.
trait VisitTogether<L> {
    /// Takes a leaf's code without [`LEAF`], an s before which no ray enters its box, the rays that meet the box, and
    /// the group, whose limits it may lower.
    fn leaf(&mut self, code: u32, near: f32, who: Who, group: &mut Group);
}

#[inline(always)]
fn follow<L: SingleLanes>(forest: &InstanceForest, rays: &[Ray], accept: Accept<'_>, hits: &mut [Option<RayHit>]) {
    for (rays, hits) in rays.chunks(GROUP).zip(hits.chunks_mut(GROUP)) {
        let who = ((1u32 << rays.len()) - 1) as Who;
        // A group that is not full repeats its last ray, which no bit of `who` names.
        let rays = std::array::from_fn(|k| rays[k.min(rays.len() - 1)]);
        let mut found: [Found; GROUP] = std::array::from_fn(|_| Found {
            first: First { accept, farthest: f64::INFINITY, best: None, place: None },
            limit: f64::INFINITY,
        });
        if forest.is_one() {
            enter::<L>(forest, 0, &rays, who, [0.0; GROUP], &mut found);
        } else {
            let group = Group::new(&rays, who, [0.0; GROUP], &forest.tree, &found);
            let mut instances = Instances { forest, rays: &rays, found: &mut found };
            walk::<L, _>(&forest.tree, group, &mut instances);
        }
        for (hit, found) in hits.iter_mut().zip(&found) {
            *hit = found.first.best;
        }
    }
}

/// Searches one instance for the rays `who`.
#[inline(always)]
fn enter<L: SingleLanes>(
    forest: &InstanceForest,
    instance: usize,
    rays: &[Ray; GROUP],
    who: Who,
    from: [f64; GROUP],
    found: &mut [Found; GROUP],
) {
    let placed = &forest.placed[instance];
    let shape = &forest.shapes[placed.shape];
    let (mut rays, mut tried) = (*rays, [Tried::NONE; GROUP]);
    for k in each(who) {
        rays[k] = rays[k].through(&placed.to_local);
        tried[k].begin(rays[k]);
    }
    let group = Group::new(&rays, who, from, &shape.tree, found);
    let who = group.who;
    walk::<L, _>(&shape.tree, group, &mut Packets { shape, instance, tried: &mut tried, found });
    for k in each(who) {
        let Found { first, limit } = &mut found[k];
        tried[k].decide(shape, instance, limit, first);
    }
}

/// Searches a group at one of its places for the rays `who`.
#[inline(always)]
fn enter_group<L: SingleLanes>(
    forest: &InstanceForest,
    place: usize,
    rays: &[Ray; GROUP],
    who: Who,
    from: [f64; GROUP],
    found: &mut [Found; GROUP],
) {
    let of = &forest.places[place];
    let (mut rays, tree) = (*rays, &forest.groups[of.group]);
    for k in each(who) {
        rays[k] = rays[k].through(&of.to_local);
        found[k].first.place = Some(place as u32);
    }
    let group = Group::new(&rays, who, from, tree, found);
    walk::<L, _>(tree, group, &mut Members { forest, rays: &rays, found });
    each(who).for_each(|k| found[k].first.place = None);
}

/// Tries a leaf's triangles.
struct Packets<'t, 'a> {
    shape: &'t TriangleTree,
    instance: usize,
    tried: &'t mut [Tried; GROUP],
    found: &'t mut [Found<'a>; GROUP],
}

impl<L: SingleLanes> VisitTogether<L> for Packets<'_, '_> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, near: f32, who: Who, group: &mut Group) {
        for k in each(who) {
            let Found { first, limit } = &mut self.found[k];
            let before = *limit;
            let (local, s) = (&group.locals[k], group.s[k]);
            let (shape, instance, tried) = (self.shape, self.instance, &mut self.tried[k]);
            let mut triangles = Triangles::<_, false> { shape, instance, tried, found: first };
            Visit::<L>::leaf(&mut triangles, code, local, near, s, limit);
            if *limit < before {
                group.s[k] = local.s(*limit);
            }
        }
    }
}

/// Tries the instance of a leaf, or the group at a place.
struct Instances<'t, 'a> {
    forest: &'t InstanceForest,
    rays: &'t [Ray; GROUP],
    found: &'t mut [Found<'a>; GROUP],
}

impl<L: SingleLanes> VisitTogether<L> for Instances<'_, '_> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, near: f32, who: Who, group: &mut Group) {
        let mut from = [0.0; GROUP];
        each(who).for_each(|k| from[k] = group.locals[k].t(near));
        let k = code as usize;
        match k.checked_sub(self.forest.single) {
            None => enter::<L>(self.forest, k, self.rays, who, from, self.found),
            Some(place) => enter_group::<L>(self.forest, place, self.rays, who, from, self.found),
        }
        each(who).for_each(|k| group.s[k] = group.locals[k].s(self.found[k].limit));
    }
}

/// Tries an instance of a group, in whose space the rays are.
struct Members<'t, 'a> {
    forest: &'t InstanceForest,
    rays: &'t [Ray; GROUP],
    found: &'t mut [Found<'a>; GROUP],
}

impl<L: SingleLanes> VisitTogether<L> for Members<'_, '_> {
    #[inline(always)]
    fn leaf(&mut self, code: u32, near: f32, who: Who, group: &mut Group) {
        let mut from = [0.0; GROUP];
        each(who).for_each(|k| from[k] = group.locals[k].t(near));
        enter::<L>(self.forest, code as usize, self.rays, who, from, self.found);
        each(who).for_each(|k| group.s[k] = group.locals[k].s(self.found[k].limit));
    }
}

/// Room for the waiting children of a tree of nine levels, which needs no memory of its own.
const FEW: usize = 72;

/// Visits the leaves whose boxes any ray of the group meets before its limit, near ones first.
#[inline(always)]
fn walk<L: SingleLanes, V: VisitTogether<L>>(tree: &Tree, mut group: Group, visitor: &mut V) {
    if group.who == 0 {
        return;
    }
    let (mut few, mut many);
    let (waiting, whose): (&mut [Waiting], &mut [Who]) = if tree.waiting <= FEW {
        few = ([Waiting::default(); FEW], [0; FEW]);
        (&mut few.0, &mut few.1)
    } else {
        many = (vec![Waiting::default(); tree.waiting], vec![0; tree.waiting]);
        (&mut many.0, &mut many.1)
    };
    let mut farthest = group.farthest();
    let (mut current, mut who, mut count) = (Waiting::default(), group.who, 0);
    loop {
        if current.code & LEAF == 0 {
            descend::<L>(tree, &group, current.code, who, waiting, whose, &mut count);
        } else {
            visitor.leaf(current.code & !LEAF, current.near, who, &mut group);
            farthest = group.farthest();
        }
        let Some(child) = back(waiting, &mut count, 0, farthest) else { return };
        (current, who) = (child, whose[count]);
    }
}

/// Lets a node's children that any of the rays `who` meets wait, the nearest on top, and notes which rays meet them.
#[inline(always)]
fn descend<L: SingleLanes>(
    tree: &Tree,
    group: &Group,
    code: u32,
    who: Who,
    waiting: &mut [Waiting],
    whose: &mut [Who],
    count: &mut usize,
) {
    let node = tree.node(code);
    let (mut nearest, mut met) = (L::splat(f32::INFINITY), [0; GROUP]);
    for k in each(who) {
        let [near, far] = group.locals[k].boxes::<L>(node, L::splat(group.s[k]));
        met[k] = L::bits(near.at_most(far)) as u8;
        nearest = nearest.min(near.or(near.at_most(far), L::splat(f32::INFINITY)));
    }
    // Byte k holds the children that ray k meets. The rays that meet a child are the bits of its column.
    let met = u64::from_le_bytes(met);
    let rays = |child: u32| ((met >> child & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080) >> 56) as Who;
    // `Tree::waiting` counts all lanes of the last node, whether a ray meets their boxes or not.
    let room: &mut [Waiting; WIDTH] = waiting[*count..].first_chunk_mut().expect("room for a node's children");
    let added = nearest.order(L::splat(FARTHEST), &[0, 1, 2, 3, 4, 5, 6, 7], room);
    for (child, whose) in room[..added].iter_mut().zip(&mut whose[*count..]) {
        *whose = rays(child.code);
        child.code = node[NODE - 1].0[0][child.code as usize & (WIDTH - 1)];
        prefetch::<NODE, _>(tree.lines.as_ptr().wrapping_add((child.code & !LEAF) as usize));
    }
    *count += added;
}
