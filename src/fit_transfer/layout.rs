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
    /// Anchors of each instance that has rows of its own; 0 of the others.
    each: Vec<usize>,
}

impl Layout {
    /// The layout of a world whose first `leaves` leaves are leaves, and the others wood or ground. An instance that is
    /// not `seen` has no rows of its own: it shares those of another instance of its leaf, since its light is never
    /// looked at.
    pub fn new(world: &World, leaves: usize, seen: &[bool], options: &Options) -> Layout {
        let of = |(k, leaf): (usize, &ReferenceLeaf)| match k < leaves {
            true => OfLeaf {
                anchors: Anchors::on_leaf(leaf, options.anchors),
                rows: if glossy(leaf) { Rows::Glossy(options.gloss_bands) } else { Rows::Both },
            },
            false => OfLeaf { anchors: Anchors::at_vertices(leaf), rows: Rows::Front },
        };
        let leaves: Vec<OfLeaf> = world.leaves.iter().enumerate().map(of).collect();
        let shown = |k: usize| seen.get(k).is_none_or(|s| *s);
        // The first of each leaf that is seen, or the first of all.
        let mut stands_for: Vec<Option<usize>> = vec![None; leaves.len()];
        for (k, p) in world.instances.iter().enumerate() {
            let first = &mut stands_for[p.leaf];
            if first.is_none_or(|f| !shown(f) && shown(k)) {
                *first = Some(k);
            }
        }
        let own = |k: usize| shown(k) || stands_for[world.instances[k].leaf] == Some(k);
        let (mut rows, mut first, mut each) = (0, Vec::new(), Vec::new());
        for (k, p) in world.instances.iter().enumerate() {
            let of = &leaves[p.leaf];
            each.push(if own(k) { of.anchors.points.len() } else { 0 });
            first.push(rows);
            rows += each[k] * of.rows.count();
        }
        for (k, p) in world.instances.iter().enumerate().filter(|(k, _)| !own(*k)) {
            first[k] = stands_for[p.leaf].map_or(0, |other| first[other]);
        }
        Layout { leaves, first, rows, ground: world.ground, each }
    }

    /// Anchors of all instances together.
    pub fn anchors(&self) -> usize {
        self.each.iter().sum()
    }

    /// Whether an instance has rows of its own.
    pub(crate) fn is_own(&self, instance: usize) -> bool {
        self.each[instance] > 0
    }

    /// Rows of one instance's own.
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
