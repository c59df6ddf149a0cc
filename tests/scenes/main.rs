//! Scenes are planned, handed over, drawn and checked; and the reference renderer.
//!
//! These tests are one program, because building a program for each of them takes longer than running most of them.

mod animation;
mod between;
#[path = "../blade/mod.rs"]
mod blade;
mod branch;
mod check;
#[path = "../common/mod.rs"]
mod common;
mod daylight;
#[cfg(feature = "render")]
mod display;
mod elsewhere;
mod environment;
mod film;
mod goldens;
mod grass;
mod grass_hill;
mod grass_light;
mod grass_pass;
mod grass_tiling;
mod lawn;
mod look;
mod other_side;
#[cfg(feature = "render")]
mod parts;
mod pivots;
mod plan;
mod plants;
mod reference;
mod scene;
mod stands;
mod translucency_scene;
mod whole;

use common::skips;

/// The program's output with `--json`.
fn json(output: &std::process::Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stderr)))
}
