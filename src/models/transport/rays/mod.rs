//! Rays against triangles: which triangle a ray hits first, and whether anything blocks it.
//!
//! A [`TriangleTree`] is a mesh with a tree of boxes. A [`InstanceForest`] places shapes, each in any number of
//! instances, and has a tree of boxes over the instances. Instances may form groups, which stand in any number of
//! places and are stored once: a ray is then carried into the group's space, and from there into the shape's. The crate
//! `obvhs` builds binary trees (PLOC: Meister & Bittner 2018; reinsertion: Meister & Bittner 2018). Here they become
//! trees with eight children for each node ([`wide_tree`]), through which rays are then followed ([`traversal`]).
//!
//! The tests of boxes and a first test of triangles use f32, eight at a time. Both are conservative: boxes are rounded
//! outwards, and the first test accepts every triangle for which rounding leaves any doubt. The accepted triangles are
//! then tested in f64 ([`triangle`]). So the result is the same as if every triangle were tested in f64, and the f32
//! part only saves time. A unit test compares the two. A triangle is *solid* if all its points count as hits. Where f32
//! is sure that a solid triangle is hit, a search for any hit ends at once, and a search for the nearest hit postpones
//! the f64 test to its end ([`shape`]).
//!
//! Many rays at once are followed in turns ([`ray_batch`]), and rays that are close to each other in groups
//! ([`neighbours`]).
//!
//! The caller chooses the units. Each tree uses its own frame, in which its box spans −1 to 1 ([`frame`]), so lengths
//! may be of any size.
//! Limits: coordinates are finite (a triangle with other coordinates is never hit), and transforms are affine and
//! invertible.

#![warn(missing_docs)]

mod arena;
mod forest;
mod frame;
mod neighbours;
mod ray;
mod ray_batch;
mod shape;
mod traversal;
mod triangle;
mod wide_tree;

pub use forest::{InstanceForest, Placements, RayHit};
pub(crate) use frame::Bounds;
pub use mesophyll_base::lanes::fetch;
pub use ray::Ray;
pub use shape::TriangleTree;
