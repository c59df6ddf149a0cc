//! The renderer draws scenes whose pictures are known: by formulas, by the CPU, or by another way to draw the same.
//!
//! These tests are one program, because building a program for each of them takes longer than running most of them.

mod backdrop;
mod bend;
mod choose;
mod common;
mod detail;
mod display;
mod dome;
mod far;
mod follow;
mod motion;
mod needs;
mod place;
mod pose;
mod radiance;
mod reference;
mod shadow;
mod sides;
mod stand;
mod thin;
mod transfer;
mod translucency;
