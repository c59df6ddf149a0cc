//! Rays against triangles: which one a ray meets first, and whether anything stands in its way.
//!
//! A [`Shape`] is a mesh with a tree of boxes; a [`Forest`] places shapes, each in any number of instances, and has a
//! tree of boxes over them. The trees are built by the crate `obvhs` (PLOC: Meister & Bittner 2018; reinsertion:
//! Meister & Bittner 2018), made eight children wide here ([`collapse`]) and walked here ([`walk`]).
//!
//! Boxes and a first look at the triangles are in f32, eight at a time. Both are conservative: boxes are rounded
//! outwards, and the first look lets every triangle pass that rounding leaves in doubt. What passes is decided in f64
//! ([`triangle`]), so that the result is that of the f64 test on every triangle, and the f32 part only saves time. A
//! test compares the two. Triangles of which every point counts are *solid*: where f32 is sure that one is met, a search
//! for anything at all ends there, and a search for the nearest decides it at the end of the walk ([`shape`]).
//!
//! Units are the caller's: each tree works in a frame of its own where its box spans −1 to 1 ([`frame`]), so lengths
//! may be of any size.
//! Limits: coordinates are finite (a triangle with others is never met), transforms are affine and can be inverted.

#![warn(missing_docs)]

mod arena;
mod collapse;
mod forest;
mod frame;
mod lanes;
mod many;
mod ray;
mod shape;
mod triangle;
mod walk;

pub use forest::{Forest, Hit};
pub use lanes::{Level, fetch};
pub use ray::Ray;
pub use shape::Shape;
