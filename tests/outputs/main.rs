//! The outputs made from fits: reports, and files that other programs read.
//!
//! These tests are one program, because building a program for each of them takes longer than running most of them.

mod assembled;
mod bsdf;
mod canopy;
#[path = "../common/mod.rs"]
mod common;
mod dress;
mod dress_cards;
mod export;
mod look_closer;
mod panorama;
mod pictures;
mod plants;
mod programs;
mod render;
mod report;
#[path = "../samples/mod.rs"]
mod samples;
mod sky_export;
mod sky_functions;
mod stands;
mod web;
