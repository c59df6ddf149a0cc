//! Trees of triangles are compared with searches that use no tree, and groups with each of their instances.

mod brute_force;
mod closed;
mod common;
mod groups;
mod light;
mod many;
