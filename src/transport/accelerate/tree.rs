//! Rays, boxes, and a tree of boxes over numbered things, built by the crate `bvh` and walked nearest box first.

use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::{Bvh, BvhNode};
use glam::{DMat4, DVec3};
use nalgebra::Point3;

/// A half-line o + t·d; d need not be of unit length.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Where it begins.
    pub origin: DVec3,
    /// Where it goes; t counts in its lengths.
    pub direction: DVec3,
    inverse: DVec3,
}

impl Ray {
    /// The half-line from `origin` along `direction`.
    pub fn new(origin: DVec3, direction: DVec3) -> Ray {
        // a tiny slope instead of zero keeps 0·∞ out of the box test
        let safe = |x: f64| if x.abs() < 1e-300 { 1e300 } else { 1.0 / x };
        Ray { origin, direction, inverse: DVec3::new(safe(direction.x), safe(direction.y), safe(direction.z)) }
    }

    /// The same half-line seen through an affine map; t keeps its meaning.
    pub(super) fn through(&self, to_local: &DMat4) -> Ray {
        Ray::new(to_local.transform_point3(self.origin), to_local.transform_vector3(self.direction))
    }
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    pub low: DVec3,
    pub high: DVec3,
}

impl Bounds {
    pub(super) fn empty() -> Bounds {
        Bounds { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.low.x > self.high.x
    }

    pub(super) fn of(points: impl IntoIterator<Item = DVec3>) -> Bounds {
        points.into_iter().fold(Bounds::empty(), |b, p| Bounds { low: b.low.min(p), high: b.high.max(p) })
    }

    /// A little larger, so that rounding in the box test loses no hit on a face.
    fn padded(self) -> Bounds {
        if self.is_empty() {
            return self;
        }
        let pad = DVec3::splat(1e-12 * (self.low.abs().max(self.high.abs()).max_element() + 1e-30));
        Bounds { low: self.low - pad, high: self.high + pad }
    }

    /// Where the ray enters, or +∞ where it misses or enters beyond `limit`.
    #[inline]
    fn enter(&self, ray: &Ray, limit: f64) -> f64 {
        let a = (self.low - ray.origin) * ray.inverse;
        let b = (self.high - ray.origin) * ray.inverse;
        let (near, far) = (lesser(a.x, b.x), greater(a.x, b.x));
        let (near, far) = (greater(near, lesser(a.y, b.y)), lesser(far, greater(a.y, b.y)));
        let (near, far) = (greater(near, lesser(a.z, b.z)), lesser(far, greater(a.z, b.z)));
        let near = greater(near, 0.0);
        if near <= lesser(far, limit) { near } else { f64::INFINITY }
    }
}

#[inline(always)]
fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// A box tree over numbered things.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    root: u32,
    pub(super) bounds: Bounds,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: [Bounds; 2],
    child: [u32; 2],
}

/// Marks a child that is a thing and not a node.
const THING: u32 = 1 << 31;
const NOTHING: u32 = u32::MAX;

struct Item {
    bounds: Bounds,
    node: usize,
}

impl Bounded<f64, 3> for Item {
    fn aabb(&self) -> Aabb<f64, 3> {
        Aabb::with_bounds(Point3::from(self.bounds.low.to_array()), Point3::from(self.bounds.high.to_array()))
    }
}

impl BHShape<f64, 3> for Item {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

impl Tree {
    pub(super) fn build(bounds: Vec<Bounds>) -> Tree {
        let all =
            bounds.iter().fold(Bounds::empty(), |a, b| Bounds { low: a.low.min(b.low), high: a.high.max(b.high) });
        let mut items: Vec<Item> = bounds.into_iter().map(|bounds| Item { bounds, node: 0 }).collect();
        let built = Bvh::build(&mut items);
        // inner nodes get numbers of their own, leaves carry their shape's
        let mut number = Vec::with_capacity(built.nodes.len());
        let mut inner = 0u32;
        for node in &built.nodes {
            number.push(match node {
                BvhNode::Leaf { shape_index, .. } => THING | *shape_index as u32,
                BvhNode::Node { .. } => {
                    inner += 1;
                    inner - 1
                }
            });
        }
        let convert = |b: &Aabb<f64, 3>| {
            Bounds { low: DVec3::new(b.min.x, b.min.y, b.min.z), high: DVec3::new(b.max.x, b.max.y, b.max.z) }.padded()
        };
        let nodes = built
            .nodes
            .iter()
            .filter_map(|node| match node {
                BvhNode::Leaf { .. } => None,
                BvhNode::Node { child_l_index, child_l_aabb, child_r_index, child_r_aabb, .. } => Some(Node {
                    bounds: [convert(child_l_aabb), convert(child_r_aabb)],
                    child: [number[*child_l_index], number[*child_r_index]],
                }),
            })
            .collect();
        Tree { nodes, root: number.first().copied().unwrap_or(NOTHING), bounds: all.padded() }
    }

    /// Calls `visit(thing, limit)` for each thing whose box the ray meets before `limit`, near ones first; `visit` may
    /// lower the limit, and stops the walk by returning true.
    #[inline]
    pub(super) fn walk(&self, ray: &Ray, limit: &mut f64, mut visit: impl FnMut(u32, &mut f64) -> bool) -> bool {
        if self.root == NOTHING || self.bounds.enter(ray, *limit) == f64::INFINITY {
            return false;
        }
        let mut stack = [(0u32, 0f64); 32];
        let mut depth = 0usize;
        // trees of coincident boxes can be deeper than the stack; the spill allocates only then
        let mut spill: Vec<(u32, f64)> = Vec::new();
        let mut current = self.root;
        loop {
            if current & THING != 0 {
                if visit(current & !THING, limit) {
                    return true;
                }
            } else {
                let node = &self.nodes[current as usize];
                let enter = [node.bounds[0].enter(ray, *limit), node.bounds[1].enter(ray, *limit)];
                let near = usize::from(enter[1] < enter[0]);
                let far = 1 - near;
                if enter[near] < f64::INFINITY {
                    if enter[far] < f64::INFINITY {
                        if depth < stack.len() {
                            stack[depth] = (node.child[far], enter[far]);
                            depth += 1;
                        } else {
                            spill.push((node.child[far], enter[far]));
                        }
                    }
                    current = node.child[near];
                    continue;
                }
            }
            loop {
                let (next, enter) = match spill.pop() {
                    Some(top) => top,
                    None if depth > 0 => {
                        depth -= 1;
                        stack[depth]
                    }
                    None => return false,
                };
                if enter <= *limit {
                    current = next;
                    break;
                }
            }
        }
    }
}
