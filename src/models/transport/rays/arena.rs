//! The memory layout of a tree: nodes and packets of triangles in one array of cache lines, with children near their
//! parents.
//!
//! A row is eight 32-bit numbers. A node takes eight rows: the low and the high x of its eight children, the same for y
//! and z, the children's codes, and a row that stays free so that a node fills four cache lines. A code is the number
//! of the child's first cache line. If it has [`LEAF`] set, it belongs to a leaf instead, and the rest is the first
//! line of a packet or the number of an instance.

use crate::rays::frame::{Bounds, Frame};
use crate::rays::wide_tree::{Child, wide};
use mesophyll_base::lanes::WIDTH;

/// Eight numbers, as their bits.
pub(crate) type Row = [u32; WIDTH];

/// A cache line.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Line(pub [Row; 2]);

/// Number of lines of a node.
pub(crate) const NODE: usize = 4;

/// The bit that marks the code of a leaf.
pub(crate) const LEAF: u32 = 1 << 31;

/// A box tree eight children wide.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    /// The lines, which begin with the root; empty where there is nothing.
    pub lines: Vec<Line>,
    pub frame: Frame,
    /// The box around everything, in the caller's units.
    pub bounds: Bounds,
    /// Largest number of children that can wait at the same time, with room for the lanes of one more node.
    pub waiting: usize,
}

impl Tree {
    /// A tree over boxes, with at most `most` of them in a leaf. `leaf` gets the numbers of a leaf's boxes, may append
    /// lines, and returns the leaf's code without [`LEAF`].
    pub fn build(boxes: &[Bounds], most: u32, mut leaf: impl FnMut(&Frame, &[u32], &mut Vec<Line>) -> u32) -> Tree {
        let bounds = boxes.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        let frame = Frame::of(&bounds);
        let rounded: Vec<_> = boxes.iter().map(|b| frame.rounded(b)).collect();
        let nodes = wide(&rounded, most);
        let mut lines = Vec::new();
        let mut deepest = 0;
        // Number of the node, its first line, and its depth.
        let mut open = Vec::new();
        if !nodes.is_empty() {
            lines.resize(NODE, EMPTY);
            open.push((0, 0, 1));
        }
        while let Some((n, at, depth)) = open.pop() {
            deepest = deepest.max(depth);
            let mut codes = [0; WIDTH];
            let children = &nodes[n].children;
            for (k, (_, child)) in children.iter().enumerate() {
                if let Child::Things(things) = child {
                    codes[k] = LEAF | leaf(&frame, things, &mut lines);
                }
            }
            for (k, (_, child)) in children.iter().enumerate().rev() {
                if let Child::Node(m) = child {
                    codes[k] = lines.len() as u32;
                    open.push((*m, lines.len(), depth + 1));
                    lines.resize(lines.len() + NODE, EMPTY);
                }
            }
            assert!(lines.len() < LEAF as usize, "a tree of {} cache lines is larger than codes can say", lines.len());
            // Free slots have an empty box: low +∞, high −∞.
            for axis in 0..3 {
                let pick = |side: usize, none: f32| {
                    std::array::from_fn(|k| children.get(k).map_or(none, |(corners, _)| corners[side][axis]).to_bits())
                };
                lines[at + axis] = Line([pick(0, f32::INFINITY), pick(1, f32::NEG_INFINITY)]);
            }
            lines[at + 3].0[0] = codes;
        }
        lines.shrink_to_fit();
        Tree { lines, frame, bounds, waiting: (WIDTH - 1) * deepest + 1 + WIDTH }
    }

    /// The node that begins at a line.
    ///
    /// `at` is 0 in a tree with a box, or comes from a node. `build` makes room for a whole node before it stores the
    /// node's first line, and lines are never removed. So there is always a whole node from this line on.
    #[inline(always)]
    pub fn node(&self, at: u32) -> &[Line; NODE] {
        self.lines[at as usize..].first_chunk().expect("a node's code names a node")
    }

    /// The boxes of the root's children, in the caller's units. Together they are tighter than the one box around
    /// everything.
    pub fn parts(&self) -> Vec<Bounds> {
        if self.lines.is_empty() {
            return Vec::new();
        }
        let root = self.node(0);
        let back = |side: usize, k: usize| {
            let local = [0, 1, 2].map(|axis| f64::from(f32::from_bits(root[axis].0[side][k])));
            glam::DVec3::from(local) / self.frame.scale + self.frame.centre
        };
        (0..WIDTH).map(|k| Bounds { low: back(0, k), high: back(1, k) }).filter(|b| !b.is_empty()).collect()
    }
}

pub(crate) const EMPTY: Line = Line([[0; WIDTH]; 2]);
