//! The trees through their public functions. One program, because each that builds trees compiles them anew: that takes
//! longer than all of its tests.

mod brute_force;
mod closed;
mod common;
