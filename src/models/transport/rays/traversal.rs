//! How a ray is followed through a tree: the nearest box first, eight boxes at a time, in f32.

use crate::rays::arena::{LEAF, Line, NODE, Tree};
use crate::rays::frame::{Bounds, Frame};
use crate::rays::ray::Ray;
use crate::rays::triangle::Tolerance;
use glam::DVec3;
use mesophyll_base::lanes::{SingleLanes, WIDTH, Waiting, prefetch};

/// Half the distance between neighbouring f32 near 1.
const U: f32 = 1.0 / (1 << 24) as f32;

/// A value larger than every s at which a box of a tree can be hit in the tree's frame.
pub(crate) const FARTHEST: f32 = 64.0;

/// A ray in a tree's frame, in f32. Its parameter is s = t·per_t − start. It is chosen so that everything in the tree
/// lies at s ≥ 0, and the largest component of the direction is between ½ and 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Local {
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    pub tolerance: Tolerance,
    /// 1/direction.
    inverse: [f32; 3],
    /// origin/direction for the planes where the ray enters a box, and for those where it leaves it. The first is made
    /// larger and the second smaller, by the largest change that rounding can cause.
    entering: [f32; 3],
    leaving: [f32; 3],
    /// Whether the ray reaches the low plane (0) or the high one (1) first, for each axis.
    first: [usize; 3],
    per_t: f64,
    start: f64,
}

impl Local {
    /// The value of a field that holds no ray yet. It is overwritten before any walk reads it.
    pub const NONE: Local = Local {
        origin: [0.0; 3],
        direction: [0.0; 3],
        tolerance: Tolerance::NONE,
        inverse: [0.0; 3],
        entering: [0.0; 3],
        leaving: [0.0; 3],
        first: [0; 3],
        per_t: 0.0,
        start: 0.0,
    };

    /// `None` if the ray misses the tree's box, or has no usable direction. The ray hits nothing before t = `from`.
    #[inline(always)]
    pub fn new(ray: &Ray, from: f64, frame: &Frame, bounds: &Bounds) -> Option<Local> {
        let longest = ray.direction.abs().max_element();
        if !(longest > 1e-290 && longest < 1e290) {
            return None;
        }
        // The power of two above the largest component, and its inverse.
        let exponent = longest.to_bits() >> 52;
        let (shrink, grow) = (f64::from_bits((2045 - exponent) << 52), f64::from_bits((exponent + 1) << 52));
        let direction = ray.direction * shrink;
        let mut origin = frame.point(ray.origin);
        let mut reach = origin.abs().max_element();
        // The possible rounding error of f64 itself for a distant origin.
        let lost = (1e-14 * reach) as f32;
        let per_t = grow * frame.scale;
        let mut start = 0.0;
        if reach > 2.0 {
            // The ray's start is moved near the box, because f32 is too coarse for a long distance.
            start = from * per_t;
            let mut moved = origin + direction * start;
            reach = moved.abs().max_element();
            if !(reach <= 4.0) {
                start = enter(origin, direction, frame, bounds)?;
                moved = origin + direction * start;
                reach = moved.abs().max_element();
            }
            origin = moved;
        }
        let reach = reach as f32 * (1.0 + 2.0 * U);
        let (origin, direction) = (origin.as_vec3().to_array(), direction.as_vec3().to_array());
        let [x, y, z] = direction;
        let inverse = [slope(x), slope(y), slope(z)];
        // Rounding of the origin, the direction and each step changes a plane's s by at most 6 u (1 +
        // reach)/|direction|.
        let margin = 8.0 * U * (1.0 + reach) + lost;
        let middle = |k: usize| origin[k] * inverse[k];
        let around = |k: usize| inverse[k].abs() * margin;
        Some(Local {
            origin,
            direction,
            tolerance: Tolerance::new(reach, lost),
            inverse,
            entering: [middle(0) + around(0), middle(1) + around(1), middle(2) + around(2)],
            leaving: [middle(0) - around(0), middle(1) - around(1), middle(2) - around(2)],
            first: [usize::from(inverse[0] < 0.0), usize::from(inverse[1] < 0.0), usize::from(inverse[2] < 0.0)],
            per_t,
            start,
        })
    }

    /// The s of a limit on t, rounded up.
    #[inline(always)]
    pub fn s(&self, t: f64) -> f32 {
        (((t * self.per_t - self.start) * (1.0 + 1e-6) + 1e-7) as f32).min(FARTHEST)
    }

    /// The t of an s.
    #[inline(always)]
    pub fn t(&self, s: f32) -> f64 {
        (f64::from(s) + self.start) / self.per_t
    }

    /// For each of a node's boxes the s where the ray enters it, and where it leaves it or comes to the given s. It
    /// misses a box that it would leave before it enters.
    #[inline(always)]
    pub fn boxes<L: SingleLanes>(&self, node: &[Line; NODE], s: L) -> [L; 2] {
        let [x, y, z] = self.first;
        let near = self
            .enter::<L>(node, 0, x)
            .max(self.enter::<L>(node, 1, y))
            .max(self.enter::<L>(node, 2, z).max(L::splat(0.0)));
        let far = self.leave::<L>(node, 0, x).min(self.leave::<L>(node, 1, y)).min(self.leave::<L>(node, 2, z).min(s));
        [near, far]
    }

    #[inline(always)]
    fn enter<L: SingleLanes>(&self, node: &[Line; NODE], axis: usize, side: usize) -> L {
        L::from_bits(&node[axis].0[side & 1]).fms(L::splat(self.inverse[axis]), L::splat(self.entering[axis]))
    }

    #[inline(always)]
    fn leave<L: SingleLanes>(&self, node: &[Line; NODE], axis: usize, side: usize) -> L {
        L::from_bits(&node[axis].0[side & 1 ^ 1]).fms(L::splat(self.inverse[axis]), L::splat(self.leaving[axis]))
    }
}

/// 1/d. A tiny slope replaces 0, which avoids 0·∞. Within the box it moves the ray by less than the margin.
#[inline(always)]
fn slope(d: f32) -> f32 {
    1.0 / if d.abs() < 1e-18 { 1e-18f32.copysign(d) } else { d }
}

/// The t at which a ray enters a box, in f64 and a little too small; `None` if it misses the box.
#[inline(always)]
fn enter(origin: DVec3, direction: DVec3, frame: &Frame, bounds: &Bounds) -> Option<f64> {
    let slope = |d: f64| if d.abs() < 1e-30 { 1e-30f64.copysign(d) } else { d };
    let inverse = DVec3::new(slope(direction.x), slope(direction.y), slope(direction.z)).recip();
    let a = (frame.point(bounds.low) - origin) * inverse;
    let b = (frame.point(bounds.high) - origin) * inverse;
    let near = a.min(b).max_element().max(0.0);
    let far = a.max(b).min_element();
    let slack = 1e-7 * (1.0 + near);
    (near <= far + slack).then_some((near - slack).max(0.0))
}

/// What a walk does at a leaf.
pub(crate) trait Visit<L> {
    /// Takes a leaf's code without [`LEAF`], the ray in the tree's frame, the s where it enters the leaf's box, the
    /// limit on s (rounded up), and the limit on t, which it may lower. Returns true to end the walk.
    fn leaf(&mut self, code: u32, local: &Local, near: f32, s: f32, limit: &mut f64) -> bool;
}

/// Sizes of the arrays of waiting children that fit on the stack: enough for trees of 9 and of 18 levels. A smaller
/// array is cleared faster, which every ray has to do.
const FEW: usize = 72;
const USUAL: usize = 136;

/// Visits the leaves whose boxes the ray meets before `limit`, near ones first, or with `ANY` in no certain order. True
/// when a visit ended it.
#[inline(always)]
pub(crate) fn walk<L: SingleLanes, const ANY: bool, V: Visit<L>>(
    tree: &Tree,
    ray: &Local,
    limit: &mut f64,
    visitor: &mut V,
) -> bool {
    let (mut few, mut usual, mut many);
    let waiting: &mut [Waiting] = if tree.waiting <= FEW {
        few = [Waiting::default(); FEW];
        &mut few
    } else if tree.waiting <= USUAL {
        usual = [Waiting::default(); USUAL];
        &mut usual
    } else {
        many = vec![Waiting::default(); tree.waiting];
        &mut many
    };
    walk_with::<L, ANY, V>(tree, ray, limit, visitor, waiting)
}

/// Removes the lowest bit and returns its lane.
#[inline(always)]
pub(crate) fn next(hits: &mut u32) -> usize {
    let lane = hits.trailing_zeros() as usize & 7;
    *hits &= hits.wrapping_sub(1);
    lane
}

#[inline(always)]
fn walk_with<L: SingleLanes, const ANY: bool, V: Visit<L>>(
    tree: &Tree,
    ray: &Local,
    limit: &mut f64,
    visitor: &mut V,
    waiting: &mut [Waiting],
) -> bool {
    if tree.lines.is_empty() {
        return false;
    }
    let mut s = ray.s(*limit);
    let mut count = 0;
    let mut current = Waiting::default();
    loop {
        if current.code & LEAF == 0 {
            if let Some(nearest) = descend::<L, ANY>(tree, ray, current.code, s, waiting, &mut count) {
                current = nearest;
                continue;
            }
        } else {
            let before = *limit;
            if visitor.leaf(current.code & !LEAF, ray, current.near, s, limit) {
                return true;
            }
            if *limit < before {
                s = ray.s(*limit);
            }
        }
        match back(waiting, &mut count, 0, s) {
            Some(next) => current = next,
            None => return false,
        }
    }
}

/// Lets a node's children that the ray meets before s wait, the nearest on top.
///
/// Which boxes a ray meets, and in which order, cannot be foreseen unless the ray before was almost the same. Where the
/// processor guesses a branch wrongly, it throws away what it has begun, also of other rays. So nothing here branches;
/// [`descend`] does, and is faster for rays that follow each other closely.
#[inline(always)]
pub(crate) fn descend_without_branches<L: SingleLanes>(
    tree: &Tree,
    ray: &Local,
    code: u32,
    s: f32,
    waiting: &mut [Waiting],
    count: &mut usize,
) {
    let node = tree.node(code);
    let [near, far] = ray.boxes::<L>(node, L::splat(s));
    // `Tree::waiting` counts all lanes of the last node, whether the ray meets their boxes or not.
    let room = waiting[*count..].first_chunk_mut().expect("room for a node's children");
    *count += near.order(far, &node[3].0[0], room);
}

/// The nearest of a node's children that the ray meets before s, if any; the others wait, nearer ones on top. With
/// `ANY` they come as they lie: whatever is met ends the search, and their order costs more than it saves. The memory
/// is asked for all of them where there are several.
#[inline(always)]
fn descend<L: SingleLanes, const ANY: bool>(
    tree: &Tree,
    ray: &Local,
    code: u32,
    s: f32,
    waiting: &mut [Waiting],
    count: &mut usize,
) -> Option<Waiting> {
    let fetch = |code: u32| prefetch::<NODE, _>(tree.lines.as_ptr().wrapping_add((code & !LEAF) as usize));
    let node = tree.node(code);
    let [near, far] = ray.boxes::<L>(node, L::splat(s));
    let mut hits = L::bits(near.at_most(far));
    if hits == 0 {
        return None;
    }
    let (codes, mut entered) = (&node[3].0[0], [0.0; WIDTH]);
    near.store(&mut entered);
    let child = |lane: usize| Waiting { code: codes[lane], near: entered[lane] };
    let first = child(next(&mut hits));
    if hits == 0 {
        return Some(first);
    }
    if ANY {
        fetch(first.code);
        while hits != 0 {
            waiting[*count] = child(next(&mut hits));
            fetch(waiting[*count].code);
            *count += 1;
        }
        return Some(first);
    }
    let second = child(next(&mut hits));
    fetch(first.code);
    fetch(second.code);
    let second_is_nearer = second.near < first.near;
    let mut nearest = if second_is_nearer { second } else { first };
    let base = *count;
    waiting[*count] = if second_is_nearer { first } else { second };
    *count += 1;
    while hits != 0 {
        let mut other = child(next(&mut hits));
        fetch(other.code);
        if other.near < nearest.near {
            std::mem::swap(&mut other, &mut nearest);
        }
        let mut at = *count;
        while at > base && waiting[at - 1].near < other.near {
            waiting[at] = waiting[at - 1];
            at -= 1;
        }
        waiting[at] = other;
        *count += 1;
    }
    Some(nearest)
}

/// The last of the children that wait above `base` and that a ray enters before s; those above it are given up.
#[inline(always)]
pub(crate) fn back(waiting: &[Waiting], count: &mut usize, base: usize, s: f32) -> Option<Waiting> {
    while *count > base {
        *count -= 1;
        if waiting[*count].near <= s {
            return Some(waiting[*count]);
        }
    }
    None
}
