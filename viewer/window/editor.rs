//! What the window asks of the program around it. The viewer never solves the slab, renders no reference and judges
//! nothing: an edit goes out through `Editor` and comes back as new curves or maps.

use glam::Vec3;
use mesophyll_viewer::Picture;
use mesophyll_viewer::scene::{Camera, Dome, Interior, Scene, Side, Sides};

/// One side's editable parameters (Wang et al. 2005, Fig. 6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SideEdit {
    /// Absorption and scattering coefficients, red, green and blue (1/mm). For pigment maps: their means.
    pub sigma_a: [f32; 3],
    /// See `sigma_a`.
    pub sigma_s: [f32; 3],
    /// Factors on the fitted gloss maps.
    pub rho_s_scale: f32,
    /// See `rho_s_scale`.
    pub m_scale: f32,
}

/// A leaf's editable parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafEdit {
    /// Mean thickness h (mm).
    pub thickness_mm: f32,
    /// Of the front and of the back.
    pub sides: Sides<SideEdit>,
}

/// What follows from an edit: ρd and ρt of the new slab, as curves or maps. The gloss factors are applied by the
/// viewer.
#[derive(Debug, Clone)]
pub struct LeafUpdate {
    /// Mean thickness h (mm).
    pub thickness_mm: f32,
    /// ρd and ρt of the front and of the back.
    pub sides: Sides<Interior>,
}

/// What follows from another sun or turbidity.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyUpdate {
    /// The light of the new sky.
    pub dome: Dome,
    /// On a surface that faces the sun.
    pub sun_irradiance: [f32; 3],
}

/// What the reference renderer drew.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePicture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Tone-mapped sRGB, row-major, row 0 on top.
    pub ldr: Vec<[u8; 4]>,
}

/// One figure of a verdict; it passes where it is not above its threshold.
#[derive(Debug, Clone, PartialEq)]
pub struct Measure {
    /// What is measured.
    pub name: String,
    /// What was found.
    pub value: f64,
    /// The largest value that passes.
    pub threshold: f64,
}

/// What a check says.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Verdict {
    /// All measures pass.
    pub passed: bool,
    /// In the order in which they are shown.
    pub measures: Vec<Measure>,
    /// One sentence more, or empty.
    pub note: String,
}

/// The program around the window. Errors are sentences that the window shows. A leaf is meant by the index of its
/// material.
pub trait Editor {
    /// Where editing leaf `leaf` starts: its parameters as fitted. Materials that are no leaves are not asked for.
    fn start(&self, leaf: usize) -> LeafEdit;

    /// Solves the slab for an edit.
    fn recompute(&mut self, leaf: usize, edit: &LeafEdit) -> Result<LeafUpdate, String>;

    /// The sky of a scene with a dome for another sun (a unit vector above the horizon) and turbidity.
    fn sky(&mut self, sun: Vec3, turbidity: f32) -> Result<SkyUpdate, String> {
        let _ = (sun, turbidity);
        Err("this scene's sky does not follow the sun".into())
    }

    /// Follows the sun where vertices know their share of it ([`Scene::sun_shares`]): asks for the shares under a sun in
    /// this direction and gives the last ones that are ready since the call before, and whether more will come. An
    /// error is given once.
    fn shares(&mut self, sun: Vec3) -> Result<(Option<Vec<u8>>, bool), String> {
        let _ = sun;
        Ok((None, false))
    }

    /// Saves an edit as a new fit and says where.
    fn save(&mut self, leaf: usize, edit: &LeafEdit) -> Result<String, String>;

    /// Draws the scene as it stands with the reference renderer.
    fn reference(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        width: u32,
        height: u32,
    ) -> Result<ReferencePicture, String>;

    /// Compares a picture with its reference.
    fn judge(&mut self, picture: &Picture, reference: &ReferencePicture) -> Verdict;

    /// What is known about one texel, as pairs of a name and a value with its unit. The texel is a column and row of
    /// the side's own maps, as its camera saw them.
    fn probe(&self, leaf: usize, side: Side, texel: [u32; 2]) -> Vec<(String, String)>;
}
