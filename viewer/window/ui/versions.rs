//! Versions: one counter that every change increments. What follows from the state keeps the number of the state that
//! it was made of, and is made again where that is an older one.

use std::collections::BTreeMap;

/// A part of what is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// Meshes, instances, and anything else.
    Scene,
    Leaf(usize),
    Lights,
    Time,
    /// The camera.
    View,
}

/// The number of the last change, and of the last one of each part.
#[derive(Debug, Default)]
pub(crate) struct Versions {
    pub now: u64,
    pub scene: u64,
    pub lights: u64,
    pub time: u64,
    leaves: BTreeMap<usize, u64>,
}

impl Versions {
    pub(crate) fn change(&mut self, what: Change) {
        self.now += 1;
        match what {
            Change::Scene => self.scene = self.now,
            Change::Leaf(leaf) => *self.leaves.entry(leaf).or_default() = self.now,
            Change::Lights => self.lights = self.now,
            Change::Time => self.time = self.now,
            Change::View => {}
        }
    }

    pub(crate) fn leaf(&self, leaf: usize) -> u64 {
        self.leaves.get(&leaf).copied().unwrap_or_default()
    }

    /// The leaves that have changed since a version.
    pub(crate) fn leaves_since(&self, version: u64) -> Vec<usize> {
        self.leaves.iter().filter(|(_, v)| **v > version).map(|(leaf, _)| *leaf).collect()
    }
}
