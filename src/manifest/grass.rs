//! Grass on the scene's ground: blades for the path tracer, slices for the renderer in real time.

use serde::Deserialize;
use std::path::PathBuf;

/// A lawn: a meadow's rectangle laid side by side on the ground.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grass {
    /// What it is called in what is printed.
    pub name: String,
    /// A description for `mesophyll grow`, or what it makes of it: the blades, which the path tracer draws.
    pub meadow: PathBuf,
    /// A folder of `fit grass` of this meadow, which the renderer draws; slices are made with every start when absent.
    pub fit: Option<PathBuf>,
    /// What blades reflect and let through, a table a material; the program's own when absent.
    pub leaves: Option<PathBuf>,
    /// Slices across x and as many across y, where there is no fit.
    pub slices: Option<usize>,
    /// Texels along a slice and along its height, where there is no fit: powers of two.
    pub texels: Option<[usize; 2]>,
    /// Of the middle, on the ground.
    #[serde(default)]
    pub position_mm: [f64; 2],
    /// How often the rectangle is laid along x and along y.
    pub tiles: [usize; 2],
    /// A ray crosses at most so many slices; what it gathered stands for the rest.
    #[serde(default = "steps")]
    pub steps: usize,
    /// How far the wind leans blades: the way of a point over its height, for each m/s. 0: they stand still in any wind.
    #[serde(default)]
    pub lean_per_m_s: f64,
}

fn steps() -> usize {
    64
}
