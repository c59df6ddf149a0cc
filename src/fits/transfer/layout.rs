//! The anchors of a scene, and the place where the rows of each instance begin.

use crate::transfer::{Options, TransferScene};
use mesophyll_transport::transfer::{MeshAnchors, TransferRows};
use mesophyll_transport::world::{ReferenceLeaf, ReferenceWorld};
use std::ops::Range;

/// The anchors of one leaf (or wood, or ground) of the world, and the rows that each of them has.
#[derive(Debug, Clone, PartialEq)]
pub struct LeafRows {
    /// The anchors, which all instances of the leaf share.
    pub anchors: MeshAnchors,
    /// The rows of each anchor.
    pub rows: TransferRows,
}

/// The rows of a whole scene, in the order of the instances and, within an instance, of the anchors.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferLayout {
    /// The leaves, in the world's order.
    pub leaves: Vec<LeafRows>,
    /// First row of each instance.
    pub first: Vec<usize>,
    /// Number of rows of all instances together.
    pub rows: usize,
    /// Index of the instance that is the ground.
    pub ground: Option<usize>,
    /// Number of anchors of each instance that has rows of its own; 0 for the others.
    each: Vec<usize>,
    /// For each instance, the one whose rows it shows. Those beyond the end show their own.
    sources: Vec<usize>,
}

impl TransferLayout {
    /// The layout of a scene. An instance that is not seen gets no rows of its own, because no picture shows its light.
    /// It shares the rows of another instance of the same leaf, and so does one that shows the light of another.
    pub fn new(scene: &TransferScene, options: &Options) -> TransferLayout {
        let TransferScene { world, leaves, seen, sources, .. } = scene;
        let of = |(k, leaf): (usize, &ReferenceLeaf)| match k < *leaves {
            true => LeafRows {
                anchors: MeshAnchors::on_leaf(leaf, options.anchors),
                rows: if glossy(leaf) { TransferRows::Glossy(options.gloss_bands) } else { TransferRows::Both },
            },
            false => LeafRows { anchors: MeshAnchors::at_vertices(leaf), rows: TransferRows::Front },
        };
        let leaves: Vec<LeafRows> = world.leaves.iter().enumerate().map(of).collect();
        let shown = |k: usize| seen.get(k).is_none_or(|s| *s);
        // For each leaf, the first instance that is seen; where none is seen, the first instance.
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
            let source = sources.get(k).copied().filter(|s| own(*s));
            first[k] = source.or(stands_for[p.leaf]).map_or(0, |other| first[other]);
        }
        TransferLayout { leaves, first, rows, ground: world.ground, each, sources: sources.clone() }
    }

    /// Number of anchors of all instances together.
    pub fn anchors(&self) -> usize {
        self.each.iter().sum()
    }

    /// Whether an instance has rows of its own.
    pub fn is_own(&self, instance: usize) -> bool {
        self.each[instance] > 0
    }

    /// Whether pictures show the light of an instance: it has rows of its own, or shows those of another one.
    pub fn is_lit(&self, instance: usize) -> bool {
        self.is_own(self.sources.get(instance).copied().unwrap_or(instance))
    }

    /// Number of rows that belong to one instance alone.
    pub fn rows_of(&self, world: &ReferenceWorld, instance: usize) -> usize {
        self.each[instance] * self.leaves[world.instances[instance].leaf].rows.count()
    }

    /// Groups of consecutive instances with at least this many anchors each, except for the last group.
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
