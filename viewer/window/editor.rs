//! What the window needs from the program around it. The viewer does not solve the slab, does not draw the reference
//! and does not judge. An edit is sent through `Editor` and comes back as new curves or maps.

use crate::edit::Edits;
use glam::Vec3;
use mesophyll_viewer::Picture;
use mesophyll_viewer::scene::{Camera, Interior, Scene, Side, Sides, SkyDome};

/// The result of a change of sun or turbidity.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyUpdate {
    /// The light of the new sky.
    pub dome: SkyDome,
    /// Irradiance on a surface that faces the sun.
    pub sun_irradiance: [f32; 3],
}

/// The picture of the reference renderer.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplayPicture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Tone-mapped sRGB, row by row, with row 0 on top.
    pub ldr: Vec<[u8; 4]>,
}

/// One figure of a verdict. It passes where the value is not above the threshold.
#[derive(Debug, Clone, PartialEq)]
pub struct VerdictMeasure {
    /// Name of the figure.
    pub name: String,
    /// The value that was found.
    pub value: f64,
    /// The largest value that passes.
    pub threshold: f64,
}

/// The verdict of a check.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ComparisonVerdict {
    /// Whether all measures pass.
    pub passed: bool,
    /// The measures, in the order in which they are shown.
    pub measures: Vec<VerdictMeasure>,
    /// A further sentence, or empty.
    pub note: String,
}

/// A plant of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantInfo {
    /// Name of the plant.
    pub name: String,
    /// Name and level of each of its branches.
    pub branches: Vec<(String, usize)>,
}

/// The branches of a plant that an edit is for (Habel 2009, Fig. 4.17).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PlantPart {
    /// All branches of a level; 0 is a trunk.
    Level(usize),
    /// One branch, by its index.
    Branch(usize),
}

/// The program around the window. Errors are sentences that the window shows. A leaf is given by the index of its
/// material.
pub trait Editor {
    /// Thickness, σa and σs with which editing leaf `leaf` starts, as fitted; nothing where its reflection is stated.
    /// For pigment maps, σ is a mean. It is only called for materials that are leaves.
    fn start(&self, leaf: usize) -> Edits;

    /// Solves the slab of a leaf with edits: ρd and ρt, as curves or maps. The viewer applies the gloss factors.
    fn recompute(&mut self, leaf: usize, edits: &Edits) -> Result<Sides<Interior>, String>;

    /// The sky of a scene with a dome for another sun (a unit vector above the horizon) and turbidity.
    fn sky(&mut self, sun: Vec3, turbidity: f32) -> Result<SkyUpdate, String> {
        let _ = (sun, turbidity);
        Err("this scene's sky does not follow the sun".into())
    }

    /// Follows the sun where vertices have shares of it ([`Scene::sun_shares`]). It requests the shares for a sun in
    /// this direction. It returns the last shares that have become ready since the previous call, and whether more will
    /// come. An error is returned once.
    fn shares(&mut self, sun: Vec3) -> Result<(Option<Vec<u8>>, bool), String> {
        let _ = sun;
        Ok((None, false))
    }

    /// The plants whose branches can be edited.
    fn plants(&self) -> Vec<PlantInfo> {
        Vec::new()
    }

    /// The scene with edited branches. Edits of a level and of a branch of this level are both applied. The leaves'
    /// materials and the lights are as the window opened.
    fn bend(&mut self, edits: &Edits) -> Result<Scene, String> {
        let _ = edits;
        Err("this scene has no plants".into())
    }

    /// Saves plant `plant` with the edits that were applied last, and returns a sentence that says where.
    fn save_plant(&mut self, plant: usize) -> Result<String, String> {
        let _ = plant;
        Err("this scene has no plants".into())
    }

    /// Saves a leaf with edits as a new fit, and returns a sentence that says where.
    fn save(&mut self, leaf: usize, edits: &Edits) -> Result<String, String>;

    /// Draws the scene in its present state with the reference renderer.
    fn reference(&mut self, scene: &Scene, camera: &Camera, width: u32, height: u32) -> Result<DisplayPicture, String>;

    /// Compares a picture with its reference.
    fn judge(&mut self, picture: &Picture, reference: &DisplayPicture) -> ComparisonVerdict;

    /// What is known about one texel, as pairs of a name and a value with its unit. The texel is a column and a row of
    /// the side's own maps, as its camera saw them.
    fn probe(&self, leaf: usize, side: Side, texel: [u32; 2]) -> Vec<(String, String)>;
}
