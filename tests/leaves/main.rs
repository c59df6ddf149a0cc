//! Leaves: captures are synthesised, inspected and fitted, and compared with the truth that they were made from.
//!
//! These tests are one program, because building a program for each of them takes longer than running most of them.

mod bad_scans;
#[path = "../common/mod.rs"]
mod common;
mod consistent;
mod dome;
mod dome_input;
mod faults;
mod fits;
mod held_out;
mod inspect;
mod leaf_fit;
mod photo;
mod photo_dark;
mod photo_input;
#[path = "../samples/mod.rs"]
mod samples;
mod scan_model;
mod synth;
mod tissue;
mod translucency;
mod wild_texels;
