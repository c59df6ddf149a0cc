//! Decides which boxes belong together: a binary tree from the crate `obvhs` becomes a tree with eight children for
//! each node.
//!
//! The binary tree has one thing in each leaf. The nodes that stay are chosen so that the expected cost of a ray is
//! least (the surface area heuristic; the dynamic programme of Ylitie, Karras & Laine 2017, §3.1). A node costs as much
//! as a packet of up to eight things, and each is weighted with the surface of its box.

use mesophyll_base::lanes::WIDTH;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use std::collections::HashMap;

/// Low and high corner.
pub(crate) type Corners = [[f32; 3]; 2];

/// What is below a node.
#[derive(Debug, Clone)]
pub(crate) enum Child {
    /// A node, by its number.
    Node(usize),
    /// Things, by their numbers.
    Things(Vec<u32>),
}

/// A node with up to eight children.
#[derive(Debug, Clone, Default)]
pub(crate) struct WideNode {
    pub children: Vec<(Corners, Child)>,
}

/// Share of the nodes that are removed and inserted again where they cost less. A larger share makes trees a few per
/// cent faster to walk, and slower to build.
const REINSERTED: f32 = 0.3;

/// How much larger boxes may become, in a frame from −1 to 1.
const LIKE: f32 = 1e-6;

/// The nodes of a tree over boxes, with at most `most` things in a leaf. The root comes first, and parents before their
/// children. Without boxes there are no nodes. Boxes may become larger by a millionth.
pub(crate) fn wide(boxes: &[Corners], most: u32) -> Vec<WideNode> {
    if boxes.is_empty() {
        return Vec::new();
    }
    // Over equal boxes, the builder's time grows with the square of their number. So equal boxes count once.
    let mut groups: Vec<Vec<u32>> = Vec::new();
    let mut known = HashMap::new();
    for (k, corners) in boxes.iter().enumerate() {
        let group = *known.entry(corners.map(|c| c.map(f32::to_bits))).or_insert_with(|| {
            groups.push(Vec::new());
            groups.len() - 1
        });
        groups[group].push(k as u32);
    }
    // The time also grows in this way over rows of equal boxes. Enlarging each by up to a millionth of the tree's size
    // makes them different.
    let larger = |group: &Vec<u32>| {
        let [low, high] = boxes[group[0] as usize];
        let share = (group[0].wrapping_mul(0x9E37_79B9) >> 8) as f32 / (1 << 24) as f32;
        Aabb::new(low.into(), high.map(|x| (x + share * LIKE).max(x)).into())
    };
    let boxes: Vec<Aabb> = groups.iter().map(larger).collect();
    let indices = (0..boxes.len() as u32).collect();
    let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
        PlocSearchDistance::Medium,
        &boxes,
        indices,
        SortPrecision::U64,
        0,
    );
    let areas: f32 = binary.nodes.iter().map(|node| node.aabb().half_area()).sum();
    // Where almost everything overlaps, all places are equally good, and the search for better ones would try them all.
    if areas <= 2000.0 * binary.nodes[0].aabb().half_area() {
        ReinsertionOptimizer::default().run(&mut binary, REINSERTED, None);
    }
    Plan::new(&binary, &groups, most).nodes()
}

/// The decision for every node of the binary tree.
struct Plan<'a> {
    binary: &'a Bvh2,
    /// Things with the same box. Each group is a leaf of the binary tree.
    groups: &'a [Vec<u32>],
    /// The largest number of things in a leaf.
    most: usize,
    /// Whether a node becomes a leaf.
    leaf: Vec<bool>,
    /// For at most j subtrees, how many of them the first child gives. 0 means that j−1 subtrees are as good. Entries 2
    /// to 8 are used.
    first: Vec<[u8; WIDTH + 1]>,
}

impl Plan<'_> {
    fn new<'a>(binary: &'a Bvh2, groups: &'a [Vec<u32>], most: u32) -> Plan<'a> {
        let count = binary.nodes.len();
        let most = most as usize;
        let (leaf, first) = (vec![false; count], vec![[0; WIDTH + 1]; count]);
        let mut plan = Plan { binary, groups, most, leaf, first };
        // `cost[n][j−1]` is the least cost of node n as at most j subtrees.
        let mut cost = vec![[0.0f32; WIDTH - 1]; count];
        let mut things = vec![0; count];
        let mut order = Vec::with_capacity(count);
        let mut open = vec![0usize];
        while let Some(n) = open.pop() {
            order.push(n);
            if !binary.nodes[n].is_leaf() {
                let first = binary.nodes[n].first_index as usize;
                open.extend([first, first + 1]);
            }
        }
        for &n in order.iter().rev() {
            let node = &binary.nodes[n];
            let area = node.aabb().half_area();
            if node.is_leaf() {
                (things[n], plan.leaf[n], cost[n]) = (plan.below(n).len(), true, [area; WIDTH - 1]);
                continue;
            }
            let [l, r] = [0, 1].map(|k| node.first_index as usize + k);
            things[n] = things[l] + things[r];
            let mut best = [f32::INFINITY; WIDTH + 1];
            for j in 2..=WIDTH {
                for k in (1..j).filter(|k| j - k < WIDTH) {
                    let split = cost[l][k - 1] + cost[r][j - k - 1];
                    if split < best[j] {
                        best[j] = split;
                        plan.first[n][j] = k as u8;
                    }
                }
            }
            let inner = best[WIDTH] + area;
            let leaf = if things[n] <= most { area } else { f32::INFINITY };
            plan.leaf[n] = leaf <= inner;
            cost[n][0] = leaf.min(inner);
            for j in 2..WIDTH {
                cost[n][j - 1] = best[j].min(cost[n][j - 2]);
                if best[j] >= cost[n][j - 2] {
                    plan.first[n][j] = 0;
                }
            }
        }
        plan
    }

    fn nodes(&self) -> Vec<WideNode> {
        let mut nodes = vec![WideNode::default()];
        let mut open = vec![(0, 0)];
        while let Some((to, from)) = open.pop() {
            let mut children = Vec::with_capacity(WIDTH);
            if self.leaf[from] {
                children.push(from);
            } else {
                self.split(from, WIDTH, &mut children);
            }
            for n in children {
                let corners = self.corners(n);
                let child = if self.leaf[n] {
                    self.things(corners, &self.below(n), &mut nodes)
                } else {
                    nodes.push(WideNode::default());
                    open.push((nodes.len() - 1, n));
                    Child::Node(nodes.len() - 1)
                };
                nodes[to].children.push((corners, child));
            }
        }
        nodes
    }

    /// A leaf, or nodes above several leaves where too many things have the same box.
    fn things(&self, corners: Corners, things: &[u32], nodes: &mut Vec<WideNode>) -> Child {
        if things.len() <= self.most {
            return Child::Things(things.to_vec());
        }
        let at = nodes.len();
        nodes.push(WideNode::default());
        for part in things.chunks(things.len().div_ceil(WIDTH).max(self.most)) {
            let child = self.things(corners, part, nodes);
            nodes[at].children.push((corners, child));
        }
        Child::Node(at)
    }

    /// The at most `j` ≥ 2 subtrees of node `n` that become children of one node.
    fn split(&self, n: usize, j: usize, out: &mut Vec<usize>) {
        let k = usize::from(self.first[n][j]);
        let first = self.binary.nodes[n].first_index as usize;
        for (child, share) in [(first, k), (first + 1, j - k)] {
            let inner = !self.binary.nodes[child].is_leaf();
            match (2..=share).rev().find(|&j| inner && self.first[child][j] > 0) {
                Some(j) => self.split(child, j, out),
                None => out.push(child),
            }
        }
    }

    fn corners(&self, n: usize) -> Corners {
        let b = self.binary.nodes[n].aabb();
        [b.min.to_array(), b.max.to_array()]
    }

    /// The things under a node.
    fn below(&self, n: usize) -> Vec<u32> {
        let (mut out, mut open) = (Vec::new(), vec![n]);
        while let Some(n) = open.pop() {
            let node = &self.binary.nodes[n];
            let first = node.first_index as usize;
            if node.is_leaf() {
                let groups = &self.binary.primitive_indices[first..first + node.prim_count as usize];
                out.extend(groups.iter().flat_map(|&g| &self.groups[g as usize]));
            } else {
                open.extend([first + 1, first]);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Every thing occurs once, every box contains everything below it, and there are no more children and things than
    /// allowed.
    fn check(boxes: &[Corners], most: u32) {
        let nodes = wide(boxes, most);
        let mut seen = vec![0; boxes.len()];
        let holds =
            |outer: &Corners, inner: &Corners| (0..3).all(|x| outer[0][x] <= inner[0][x] && outer[1][x] >= inner[1][x]);
        for (n, node) in nodes.iter().enumerate() {
            assert!((1..=WIDTH).contains(&node.children.len()));
            for (corners, child) in &node.children {
                match child {
                    Child::Node(m) => {
                        assert!(*m > n);
                        assert!(nodes[*m].children.iter().all(|(inner, _)| holds(corners, inner)));
                    }
                    Child::Things(things) => {
                        assert!((1..=most as usize).contains(&things.len()));
                        for &k in things {
                            seen[k as usize] += 1;
                            assert!(holds(corners, &boxes[k as usize]));
                        }
                    }
                }
            }
        }
        assert!(seen.iter().all(|&s| s == 1));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn trees_hold_everything_once(
            places in prop::collection::vec(prop::array::uniform6(-1.0f32..1.0), 1..200),
            most in 1u32..=8,
        ) {
            let boxes: Vec<Corners> = places
                .iter()
                .map(|p| [[0, 1, 2].map(|x| p[x]), [0, 1, 2].map(|x| p[x] + 0.1 * p[x + 3].abs())])
                .collect();
            check(&boxes, most);
        }
    }

    #[test]
    fn piles_of_equal_boxes_and_points() {
        for n in [1, 2, 3, 9, 65, 600, 50_000] {
            check(&vec![[[-0.5, 0.0, 0.25], [0.5, 0.0, 0.5]]; n], 8);
            check(&vec![[[0.0; 3]; 2]; n], 1);
        }
        assert!(wide(&[], 8).is_empty());
    }
}
