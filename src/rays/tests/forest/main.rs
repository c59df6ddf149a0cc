//! Trees of triangles against searches that know no tree.

mod brute_force;
mod closed;
mod common;
