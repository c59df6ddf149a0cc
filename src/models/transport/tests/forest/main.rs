//! Trees of triangles are compared with searches that use no tree.

mod brute_force;
mod closed;
mod common;
mod many;
