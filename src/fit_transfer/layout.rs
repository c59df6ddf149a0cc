//! Which anchors a scene has, and where the rows of each instance begin.

use crate::Options;
use mesophyll_transport::transfer::{Anchors, Rows};
use mesophyll_transport::world::{ReferenceLeaf, World};
use std::ops::Range;

/// The anchors of one leaf (or wood, or ground) of the world, and what is wanted of each.
#[derive(Debug, Clone, PartialEq)]
pub struct OfLeaf {
    /// Shared by every instance of it.
    pub anchors: Anchors,
    /// Of each anchor.
    pub rows: Rows,
}

/// The rows of a whole scene: instance by instance, anchor by anchor.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// In the world's order.
    pub leaves: Vec<OfLeaf>,
    /// First row of each instance.
    pub first: Vec<usize>,
    /// Of all instances together.
    pub rows: usize,
    /// Which instance is the ground.
    pub ground: Option<usize>,
    /// Anchors of each instance.
    each: Vec<usize>,
}

impl Layout {
    /// The layout of a world whose first `leaves` leaves are leaves, and the others wood or ground.
    pub fn new(world: &World, leaves: usize, options: &Options) -> Layout {
        let of = |(k, leaf): (usize, &ReferenceLeaf)| match k < leaves {
            true => OfLeaf {
                anchors: Anchors::on_leaf(leaf, options.anchors),
                rows: if glossy(leaf) { Rows::Glossy(options.gloss_bands) } else { Rows::Both },
            },
            false => OfLeaf { anchors: Anchors::at_vertices(leaf), rows: Rows::Front },
        };
        let leaves: Vec<OfLeaf> = world.leaves.iter().enumerate().map(of).collect();
        let each = world.instances.iter().map(|p| leaves[p.leaf].anchors.points.len()).collect();
        let mut rows = 0;
        let first = world
            .instances
            .iter()
            .map(|p| {
                let first = rows;
                rows += leaves[p.leaf].anchors.points.len() * leaves[p.leaf].rows.count();
                first
            })
            .collect();
        Layout { leaves, first, rows, ground: world.ground, each }
    }

    /// Anchors of all instances together.
    pub fn anchors(&self) -> usize {
        self.each.iter().sum()
    }

    /// Rows of one instance.
    pub fn rows_of(&self, world: &World, instance: usize) -> usize {
        self.each[instance] * self.leaves[world.instances[instance].leaf].rows.count()
    }

    /// Runs of instances with at least this many anchors each, but for the last.
    pub(crate) fn parts(&self, anchors: usize) -> Vec<Range<usize>> {
        let (mut out, mut start, mut count) = (Vec::new(), 0, 0);
        for (k, each) in self.each.iter().enumerate() {
            count += each;
            if count >= anchors {
                out.push(start..k + 1);
                (start, count) = (k + 1, 0);
            }
        }
        if start < self.each.len() {
            out.push(start..self.each.len());
        }
        out
    }
}

fn glossy(leaf: &ReferenceLeaf) -> bool {
    let shines = |rho_s: &[Vec<f32>; 3]| rho_s.iter().flatten().any(|v| *v > 0.0);
    [&leaf.front, &leaf.back].into_iter().any(|s| s.gloss.as_ref().is_some_and(|g| shines(&g.rho_s)))
}
