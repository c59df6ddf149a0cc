//! The data that the reference renderer draws: leaves, their places, and the light on them, all in f64.
//!
//! Lengths are in mm, world z is up, directions are unit vectors, colours are linear sRGB, and the light sets the unit
//! of radiance. Maps are stored row by row with row 0 on top. Each side's maps are as its own camera saw them: column i
//! of the back is column `width−1−i` of the front.

use super::dome::ReferenceDome;
use super::environment::Environment;
use super::foliar::FoliarMaterial;
use super::lobe::Lobe;
use glam::{DMat4, DVec3};
use mesophyll_files::mesh::LeafMesh;
use std::sync::Arc;

/// Everything in a picture.
#[derive(Debug, Clone)]
pub struct ReferenceWorld {
    /// The leaves, each once.
    pub leaves: Vec<ReferenceLeaf>,
    /// Leaves that the path tracer draws by the models of B1. A leaf with `None`, or beyond the end of the list, is
    /// drawn by its sides.
    pub foliar: Vec<Option<Arc<FoliarMaterial>>>,
    /// The instances. One leaf may stand in many places.
    pub instances: Vec<ReferencePlacement>,
    /// Groups of instances that stand together in many places and are stored once, in the frame of each group. Their
    /// instances are numbered after those above.
    pub groups: Vec<Vec<ReferencePlacement>>,
    /// Where groups stand.
    pub places: Vec<ReferencePlace>,
    /// How sunlight passes through each instance. For an instance beyond the end of the list, the cosine of the mapped
    /// normal decides.
    pub through: Vec<SunTransmission>,
    /// The sun, where there is one.
    pub sun: Option<ReferenceSun>,
    /// Radiance of a constant sky all around.
    pub sky: Option<[f64; 3]>,
    /// A sky of any radiance, instead of a constant one. It is also the background.
    pub dome: Option<ReferenceDome>,
    /// An environment map, instead of a sky. It is also the background. Only the path tracer draws it.
    pub environment: Option<Arc<Environment>>,
    /// The period (mm) along x and y with which everything repeats.
    pub periodic: Option<[f64; 2]>,
    /// Index of the instance that is the ground.
    pub ground: Option<usize>,
    /// A scanner instead of sun and sky.
    pub scanner: Option<ReferenceScanner>,
    /// Radiance where nothing is hit.
    pub background: [f64; 3],
    /// The factor that radiance is multiplied by before tone mapping.
    pub exposure: f64,
}

impl Default for ReferenceWorld {
    fn default() -> Self {
        ReferenceWorld {
            leaves: Vec::new(),
            foliar: Vec::new(),
            instances: Vec::new(),
            groups: Vec::new(),
            places: Vec::new(),
            through: Vec::new(),
            sun: None,
            sky: None,
            dome: None,
            environment: None,
            periodic: None,
            ground: None,
            scanner: None,
            background: [0.0; 3],
            exposure: 1.0,
        }
    }
}

impl ReferenceWorld {
    /// The instances, and then those of groups, each once: in the order of their numbers.
    pub fn numbered(&self) -> impl Iterator<Item = &ReferencePlacement> {
        self.instances.iter().chain(self.groups.iter().flatten())
    }

    /// Radiance of the sky from a unit direction, without the sun: that of a dome, of an environment map, or of a
    /// constant sky.
    pub fn sky_radiance(&self, d: DVec3) -> [f64; 3] {
        match (&self.dome, &self.environment) {
            (Some(dome), _) => (dome.radiance)(d),
            (None, Some(map)) => map.at(d),
            _ => self.sky.unwrap_or_default(),
        }
    }
}

/// A leaf at a place: rotation, translation and a uniform scale.
#[derive(Debug, Clone, Copy)]
pub struct ReferencePlacement {
    /// Index of the leaf in the world.
    pub leaf: usize,
    /// The transform from the leaf's frame to the world.
    pub transform: DMat4,
}

/// A group at a place: rotation, translation and a uniform scale.
#[derive(Debug, Clone, Copy)]
pub struct ReferencePlace {
    /// Index of the group in the world.
    pub group: usize,
    /// The transform from the group's frame to the world.
    pub transform: DMat4,
}

/// How sunlight passes through one instance for the sun's present direction.
#[derive(Debug, Clone, Default)]
pub struct SunTransmission {
    /// For light that enters the front, and for light that enters the back.
    pub entering: [Option<SunlitMaps>; 2],
}

/// Maps like those of the leaf, in the columns of the lit side's camera. Values are interpolated, and then limited to
/// at least 0.
#[derive(Debug, Clone)]
pub enum SunlitMaps {
    /// The factor f that replaces max(0, F·l): the exit radiance is E·V·f·ρt/π.
    Factor(Arc<Vec<f32>>),
    /// A map for each channel that replaces both the cosine and ρt.
    Colour(Arc<[Vec<f32>; 3]>),
}

/// The sun as a disk of uniform radiance.
#[derive(Debug, Clone, Copy)]
pub struct ReferenceSun {
    /// Vector towards the centre of the disk. It is normalised where it is used.
    pub direction: DVec3,
    /// Irradiance on a surface that faces the unhidden sun.
    pub irradiance: [f64; 3],
    /// Angular radius (rad), 0 to below π/2.
    pub radius: f64,
}

/// A tube-shaped lamp over the plane z = 0, and an orthographic camera whose picture is rectified to that plane, as
/// `data/README.md` describes it for captures. Nothing casts a shadow, and no light is transmitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceScanner {
    /// Unit vector towards the camera, above the plane.
    pub camera: DVec3,
    /// Size of a pixel on the plane (mm).
    pub pixel_mm: f64,
    /// Height of the tube's axis above the plane (mm).
    pub height_mm: f64,
    /// Length of the tube's lit part (mm); its middle is at 0.
    pub length_mm: f64,
    /// Radius of the tube (mm); 0 is a thin tube.
    pub radius_mm: f64,
    /// Whether the tube lies along x and moves along y. If not, it lies along y and moves along x.
    pub along_x: bool,
    /// Place of the tube along its travel.
    pub at_mm: f64,
    /// Whether gloss has the V-cavity factor, as in scenes. Without it, gloss is as leaves are fitted.
    pub bounded: bool,
}

/// One leaf: a single sheet of triangles whose normals point out of the front, and the look of each side.
#[derive(Debug, Clone)]
pub struct ReferenceLeaf {
    /// Its shape.
    pub mesh: LeafMesh,
    /// Columns of every map (texels).
    pub width: usize,
    /// Rows of every map.
    pub height: usize,
    /// The look of the front.
    pub front: ReferenceSide,
    /// The look of the back.
    pub back: ReferenceSide,
    /// Nonzero on the leaf, in the front's columns. A point is on the leaf where the bilinear value is at least ½. With
    /// `None`, every point is on it.
    pub mask: Option<Vec<u8>>,
    /// The lobe of the gloss on both sides.
    pub lobe: Lobe,
}

/// The look of one side.
#[derive(Debug, Clone)]
pub struct ReferenceSide {
    /// Diffuse reflectance and transmittance.
    pub interior: ReferenceInterior,
    /// The gloss; `None` is a matte side.
    pub gloss: Option<ReferenceGloss>,
    /// The mapped normals; `None` means the mesh's normal.
    pub normal: Option<NormalMap>,
}

/// ρd and ρt for each channel of a blade of the given thickness (mm), before γ.
pub type SlabAt = Arc<dyn Fn(f64) -> ([f64; 3], [f64; 3]) + Send + Sync>;

/// The source of a side's diffuse reflectance and transmittance. A channel's map has `width · height` entries.
#[derive(Clone)]
pub enum ReferenceInterior {
    /// The final ρd (with γ) and ρt of each texel, which are interpolated themselves.
    Maps {
        /// Diffuse reflectance, with a map for each channel.
        rho_d: [Vec<f32>; 3],
        /// Transmittance, with a map for each channel.
        rho_t: [Vec<f32>; 3],
    },
    /// γ and thickness (h + δ, mm) are interpolated. Then ρd = γ·curve.ρd and ρt = curve.ρt. The caller provides the
    /// curve, which must be accurate.
    Scalars {
        /// γ, with a map for each channel.
        gamma: [Vec<f32>; 3],
        /// Thickness h + δ (mm).
        thickness: Vec<f32>,
        /// ρd and ρt at a thickness.
        curve: SlabAt,
    },
}

impl std::fmt::Debug for ReferenceInterior {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ReferenceInterior::Maps { rho_d, .. } => write!(f, "Maps({} texels)", rho_d[0].len()),
            ReferenceInterior::Scalars { thickness, .. } => write!(f, "Scalars({} texels)", thickness.len()),
        }
    }
}

/// Surface reflection of each texel: ρs for each channel, and the slope m (smaller values than 0.001 are taken as
/// 0.001).
#[derive(Debug, Clone)]
pub struct ReferenceGloss {
    /// ρs, with a map for each channel.
    pub rho_s: [Vec<f32>; 3],
    /// Slope m.
    pub m: Vec<f32>,
}

/// Mapped normals: x to the right in this side's image, y up, z out of this side.
#[derive(Debug, Clone)]
pub struct NormalMap {
    /// The frame of the normals.
    pub frame: NormalFrame,
    /// x, y and z of each texel.
    pub values: Vec<[f32; 3]>,
}

/// The frame in which a mapped normal is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NormalFrame {
    /// The flat frame of the scan, which is also the mesh's own. The world normal is rotation · (x, y, z) on the front,
    /// and rotation · (−x, y, −z) on the back, because the blade was turned about its y axis between the two scans.
    Blade,
    /// The mesh's interpolated normal and tangents: x·T + y·B + z·N on the front, −x·T + y·B − z·N on the back.
    Tangent,
}
