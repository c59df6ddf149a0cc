//! A scene as one file, which the viewer in a browser opens: everything that the renderer draws ([`Scene`]), the
//! cameras with their reference pictures, and σa, σs and thickness of each leaf side, from which [`slab`] computes what
//! an edit changes.
//!
//! The file is the eight bytes `MESOPHYL`, the [`VERSION`] as four bytes (little-endian), and then CBOR (RFC 8949),
//! compressed by gzip. CBOR keeps the names of all fields, so the file says itself what it holds. Lengths are in mm, σ
//! in 1/mm, and colours are linear sRGB.

#![warn(missing_docs)]

mod file;
mod slab;

pub use file::{Error, LARGEST, VERSION};
use mesophyll_viewer::scene::{Camera, Scene, SectionAnimation, SectionMotion, Sides};
use serde::{Deserialize, Serialize};
pub use slab::{EditError, slab, slab_curve};
use std::sync::Arc;

/// What a file holds.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Bundle {
    /// Name of the scene or of the fit.
    pub title: String,
    /// The program that wrote the file, with its version.
    pub program: String,
    /// The things that the renderer draws, at one time.
    pub scene: Scene,
    /// The plants' cross-sections at that time; `None` where nothing bends.
    pub still: Option<StillSections>,
    /// The cameras, of which there is at least one.
    pub views: Vec<BundleView>,
    /// The leaves whose slabs can be edited.
    pub leaves: Vec<LeafSlabs>,
}

/// A camera, and what the reference renderer draws there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BundleView {
    /// Name of the view.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// The reference picture of this size as a PNG file; `None` where none was drawn.
    pub reference: Option<Vec<u8>>,
}

/// σ and thickness of a leaf.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LeafSlabs {
    /// Index into the scene's materials.
    pub material: usize,
    /// Mean thickness h (mm).
    pub thickness_mm: f64,
    /// The slab that each side sees; `None` for a side that no camera sees.
    pub sides: Sides<Option<SideSlab>>,
}

/// σ of the slab that light enters by one side, for each channel (1/mm).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SideSlab {
    /// Absorption coefficients σa (red, green, blue).
    pub sigma_a: [f64; 3],
    /// Scattering coefficients σs (red, green, blue).
    pub sigma_s: [f64; 3],
}

/// The cross-sections that carry a plant's leaves and bark, at one time.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StillSections {
    sections: Vec<SectionMotion>,
    of_vertices: Arc<Vec<u32>>,
    turn_normals: bool,
}

impl StillSections {
    /// The sections of a scene at the time of its wind.
    pub fn of(scene: &Scene) -> Option<StillSections> {
        let sections = scene.sections.as_ref()?;
        Some(StillSections {
            sections: (sections.at)(scene.wind.as_ref().map_or(0.0, |w| w.time_s)),
            of_vertices: sections.of_vertices.clone(),
            turn_normals: sections.turn_normals,
        })
    }

    /// The same as sections that stand still.
    pub fn sections(&self) -> SectionAnimation {
        let at = self.sections.clone();
        SectionAnimation {
            count: at.len(),
            of_vertices: self.of_vertices.clone(),
            turn_normals: self.turn_normals,
            poses: None,
            at: Arc::new(move |_| at.clone()),
        }
    }
}
