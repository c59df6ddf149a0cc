//! The models and their fits to tables: they are evaluated and fitted by the program, and their properties are tested.
//!
//! These tests are one program, because building a program for each of them takes longer than running most of them.

mod bands;
mod beam;
mod channels;
mod coefficients;
#[path = "../common/mod.rs"]
mod common;
mod designs;
mod dipole;
mod gloss;
mod goniometer;
mod lobes;
mod properties;
mod sky;
mod slab;
mod slab_index;
mod solve;
mod spectra;

use common::skips;
