//! Grass on the scene's ground. The path tracer draws its blades, and the real-time renderer draws slices.

use serde::Deserialize;
use std::path::PathBuf;

/// A lawn: the rectangle of a meadow, laid side by side on the ground.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatedLawn {
    /// Name of the lawn in printed text.
    pub name: String,
    /// A description for `mesophyll grow`, or the file that it makes. It holds the blades, which the path tracer draws.
    pub meadow: PathBuf,
    /// A folder of `fit grass` for this meadow, which the renderer draws. When absent, slices are made at every start.
    pub fit: Option<PathBuf>,
    /// Table of the blades' reflectance and transmittance for each material; the program's own when absent.
    pub leaves: Option<PathBuf>,
    /// Number of slices across x, and the same number across y, where there is no fit.
    pub slices: Option<usize>,
    /// Texels along a slice and along its height, where there is no fit. Both are powers of two.
    pub texels: Option<[usize; 2]>,
    /// The middle of the lawn on the ground.
    #[serde(default)]
    pub position_mm: [f64; 2],
    /// How many rectangles are laid along x and along y.
    pub tiles: [usize; 2],
    /// The seed of an irregular lawn: every rectangle shows the meadow moved by a random number of eighths of its
    /// sides, so that nothing repeats. All rectangles are alike when absent.
    pub irregular_seed: Option<u32>,
    /// The largest number of slices that a ray crosses. What it has gathered by then represents the rest.
    #[serde(default = "steps")]
    pub steps: usize,
    /// How far the wind leans blades: the displacement of a point over its height, for each m/s. With 0 they stand
    /// still in any wind.
    #[serde(default)]
    pub lean_per_m_s: f64,
}

fn steps() -> usize {
    64
}
