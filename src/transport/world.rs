//! What the reference renderer draws: leaves, where they stand, and the light on them, all in f64.
//!
//! Lengths in mm, world z up, directions are unit vectors, colours linear sRGB, radiance in units set by the light.
//! Maps are row-major with row 0 on top, each side's as its own camera saw it: column i of the back is column
//! `width−1−i` of the front.

use super::dome::Dome;
use super::environment::Environment;
use super::foliar::Foliar;
use super::lobe::Lobe;
use crate::{Error, Result};
use glam::{DMat4, DVec2, DVec3, DVec4};
use std::path::Path;
use std::sync::Arc;

/// Everything in a picture.
#[derive(Debug, Clone)]
pub struct World {
    /// The leaves, each once.
    pub leaves: Vec<ReferenceLeaf>,
    /// Leaves that the path tracer draws by the models of B1; one beyond the end, or `None`, by its sides.
    pub foliar: Vec<Option<Arc<Foliar>>>,
    /// Where leaves stand; one leaf may stand in many places.
    pub instances: Vec<Placement>,
    /// How the sun comes through each instance; an instance beyond the end lets it through by the mapped normal's
    /// cosine.
    pub through: Vec<Through>,
    /// The sun, where there is one.
    pub sun: Option<ReferenceSun>,
    /// Radiance of a constant sky all around.
    pub sky: Option<[f64; 3]>,
    /// A sky of any radiance instead, which also is the background.
    pub dome: Option<Dome>,
    /// An environment map instead, which also is the background; the path tracer alone draws it.
    pub environment: Option<Arc<Environment>>,
    /// Everything repeats with this period (mm) along x and y; the path tracer alone repeats it.
    pub periodic: Option<[f64; 2]>,
    /// Which instance is the ground.
    pub ground: Option<usize>,
    /// A scanner instead of sun and sky.
    pub scanner: Option<Scanner>,
    /// Radiance where nothing is hit.
    pub background: [f64; 3],
    /// What radiance is multiplied with before tone mapping.
    pub exposure: f64,
}

impl Default for World {
    fn default() -> Self {
        World {
            leaves: Vec::new(),
            foliar: Vec::new(),
            instances: Vec::new(),
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

impl World {
    /// Radiance of the sky from a unit direction, without the sun: of a model, an environment map, or a constant one.
    pub fn sky_radiance(&self, d: DVec3) -> [f64; 3] {
        match (&self.dome, &self.environment) {
            (Some(dome), _) => (dome.radiance)(d),
            (None, Some(map)) => map.at(d),
            _ => self.sky.unwrap_or_default(),
        }
    }
}

/// A leaf that stands somewhere: rotation, translation and a uniform scale.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    /// Which leaf of the world.
    pub leaf: usize,
    /// From the leaf to the world.
    pub transform: DMat4,
}

/// What comes of the sun through one instance, where the sun stands now: for light that enters the front and the back.
#[derive(Debug, Clone, Default)]
pub struct Through {
    /// Light that enters the front, then the back.
    pub entering: [Option<Sunlit>; 2],
}

/// Maps as of the leaf, in the columns of the lit side's camera; interpolated, then at least 0.
#[derive(Debug, Clone)]
pub enum Sunlit {
    /// What multiplies ρt instead of max(0, F·l): exit radiance is E·V·f·ρt/π.
    Factor(Arc<Vec<f32>>),
    /// A channel each, instead of both.
    Colour(Arc<[Vec<f32>; 3]>),
}

/// The sun as a disk of uniform radiance.
#[derive(Debug, Clone, Copy)]
pub struct ReferenceSun {
    /// Towards the centre of the disk (normalised here).
    pub direction: DVec3,
    /// Irradiance on a surface that faces the unhidden sun.
    pub irradiance: [f64; 3],
    /// Angular radius (rad), 0 to below π/2.
    pub radius: f64,
}

/// A tube-shaped lamp over the plane z = 0 and an orthographic camera whose picture is rectified to that plane, as
/// `data/README.md` states for captures. Nothing casts a shadow, and nothing comes through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scanner {
    /// Towards the camera; a unit vector above the plane.
    pub camera: DVec3,
    /// Size of a pixel on the plane (mm).
    pub pixel_mm: f64,
    /// Height of the tube's axis, lit length (centred) and radius (0: thin).
    pub height_mm: f64,
    /// Lit length, centred (mm).
    pub length_mm: f64,
    /// Radius of the tube (mm).
    pub radius_mm: f64,
    /// The tube lies along x and moves along y, instead of the other way round.
    pub along_x: bool,
    /// Where it stands along its travel.
    pub at_mm: f64,
    /// Gloss with the V-cavity factor, as scenes have it; else without, as leaves are fitted.
    pub bounded: bool,
}

/// A pinhole camera; row 0 of its picture is the top row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Where the camera stands.
    pub eye: DVec3,
    /// What it looks at.
    pub target: DVec3,
    /// Which way is up in the picture.
    pub up: DVec3,
    /// Full vertical field of view (degrees), above 0 and below 180.
    pub fov_y_deg: f64,
}

/// One leaf: a single sheet of triangles whose normals point out of the front, and how each side looks.
#[derive(Debug, Clone)]
pub struct ReferenceLeaf {
    /// Its shape.
    pub mesh: ReferenceMesh,
    /// Size of every map (texels).
    pub width: usize,
    /// Rows of every map.
    pub height: usize,
    /// How the front looks.
    pub front: ReferenceSide,
    /// How the back looks.
    pub back: ReferenceSide,
    /// Nonzero on the leaf, in the front's columns. A point is on the leaf where the bilinear value reaches ½; `None`:
    /// everywhere.
    pub mask: Option<Vec<u8>>,
    /// Which lobe the gloss of both sides has.
    pub lobe: Lobe,
}

/// Indexed triangles.
#[derive(Debug, Clone, Default)]
pub struct ReferenceMesh {
    /// Vertices.
    pub positions: Vec<DVec3>,
    /// Out of the front, a vertex each; interpolated and normalised.
    pub normals: Vec<DVec3>,
    /// xyz along +u, w = ±1: bitangent = w · normal × tangent. Only read for [`NormalFrame::Tangent`]; may else be
    /// empty.
    pub tangents: Vec<DVec4>,
    /// (0, 0) is the top left corner of the front's maps.
    pub uvs: Vec<DVec2>,
    /// Three a triangle.
    pub indices: Vec<u32>,
    /// Every triangle stands for a disc: it is equilateral, and the disc is the circle inside it.
    pub discs: bool,
}

/// How one side looks.
#[derive(Debug, Clone)]
pub struct ReferenceSide {
    /// Diffuse reflectance and transmittance.
    pub interior: Interior,
    /// `None` is a matte side.
    pub gloss: Option<Gloss>,
    /// `None` is the mesh normal.
    pub normal: Option<NormalMap>,
}

/// ρd and ρt (a channel each) of a blade of the given thickness (mm), before γ.
pub type SlabAt = Arc<dyn Fn(f64) -> ([f64; 3], [f64; 3]) + Send + Sync>;

/// Where a side's diffuse reflectance and transmittance come from; a channel's map is `width · height` long.
#[derive(Clone)]
pub enum Interior {
    /// Final ρd (γ applied) and ρt a texel, interpolated themselves.
    Maps {
        /// Diffuse reflectance, a map a channel.
        rho_d: [Vec<f32>; 3],
        /// Transmittance, a map a channel.
        rho_t: [Vec<f32>; 3],
    },
    /// γ and thickness (h + δ, mm) are interpolated, then ρd = γ·curve.ρd, ρt = curve.ρt. The curve is the caller's and
    /// must be accurate.
    Scalars {
        /// γ, a map a channel.
        gamma: [Vec<f32>; 3],
        /// Thickness h + δ (mm).
        thickness: Vec<f32>,
        /// ρd and ρt at a thickness.
        curve: SlabAt,
    },
}

impl std::fmt::Debug for Interior {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Interior::Maps { rho_d, .. } => write!(f, "Maps({} texels)", rho_d[0].len()),
            Interior::Scalars { thickness, .. } => write!(f, "Scalars({} texels)", thickness.len()),
        }
    }
}

/// Surface reflection a texel: ρs a channel, slope m (0.001 at least; smaller is taken as 0.001).
#[derive(Debug, Clone)]
pub struct Gloss {
    /// ρs, a map a channel.
    pub rho_s: [Vec<f32>; 3],
    /// Slope m.
    pub m: Vec<f32>,
}

/// Mapped normals, x to the right in this side's image, y up, z out of this side.
#[derive(Debug, Clone)]
pub struct NormalMap {
    /// What the normals are measured against.
    pub frame: NormalFrame,
    /// x, y and z, a texel each.
    pub values: Vec<[f32; 3]>,
}

/// What a mapped normal is measured against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NormalFrame {
    /// The flat frame of the scan, which is also the mesh's own: world normal = rotation · (x, y, z) in front and
    /// rotation · (−x, y, −z) on the back, because the blade was turned about its y axis between the two scans.
    Blade,
    /// The mesh's interpolated normal and tangents: x·T + y·B + z·N in front, −x·T + y·B − z·N on the back.
    Tangent,
}

/// Most instances of a scene that repeats, those that reach over from its neighbours counted.
const MOST_COPIES: f64 = 1e7;

impl World {
    /// Whether everything is there and of one size; the sentence names the leaf and the field.
    pub fn validate(&self) -> Result<()> {
        let bad = |what: String| Err(Error::input(Path::new("reference scene"), what));
        for (k, leaf) in self.leaves.iter().enumerate() {
            if let Err(what) = leaf.validate() {
                return bad(format!("leaf {k}: {what}"));
            }
        }
        for (k, placed) in self.instances.iter().enumerate() {
            if placed.leaf >= self.leaves.len() {
                return bad(format!("instance {k}: leaf {} wanted, the scene has {}", placed.leaf, self.leaves.len()));
            }
            let det = placed.transform.determinant();
            if !placed.transform.is_finite() || !det.is_normal() {
                return bad(format!("instance {k}: the transform cannot be inverted (determinant {det})"));
            }
        }
        for (k, (through, placed)) in self.through.iter().zip(&self.instances).enumerate() {
            let texels = self.leaves[placed.leaf].width * self.leaves[placed.leaf].height;
            let sizes = through.entering.iter().flatten().flat_map(|s| match s {
                Sunlit::Factor(map) => vec![map.len()],
                Sunlit::Colour(maps) => maps.iter().map(Vec::len).collect(),
            });
            if let Some(found) = sizes.into_iter().find(|n| *n != texels) {
                return bad(format!("instance {k}: light through it has {found} texels, expected {texels}"));
            }
        }
        let skies = [self.sky.is_some(), self.dome.is_some(), self.environment.is_some()];
        if skies.into_iter().filter(|given| *given).count() > 1 {
            return bad("sky: expected one of a constant one, a dome and an environment map".into());
        }
        if let Some(sun) = &self.sun {
            if !(sun.direction.length() > 0.0 && sun.direction.is_finite()) {
                return bad("sun direction: expected a vector that is finite and not zero".into());
            }
            if !(0.0..1.5).contains(&sun.radius) {
                return bad(format!("sun radius: found {} rad, expected 0 to 1.5", sun.radius));
            }
        }
        if let Some(ground) = self.ground.filter(|g| *g >= self.instances.len()) {
            return bad(format!("ground: instance {ground}, the scene has {}", self.instances.len()));
        }
        if let Some(size) = self.periodic {
            let copies = super::stage::copies(self, size);
            if !(size.iter().all(|s| *s > 0.0 && s.is_finite()) && copies <= MOST_COPIES) {
                return bad(format!(
                    "periodic: a period of {} × {} mm needs {copies:.0} copies of what stands there, expected at most \
                     {MOST_COPIES:.0}",
                    size[0], size[1]
                ));
            }
        }
        if !(self.exposure.is_finite() && self.exposure >= 0.0) {
            return bad(format!("exposure: found {}, expected a number ≥ 0", self.exposure));
        }
        Ok(())
    }
}

impl ReferenceLeaf {
    fn validate(&self) -> std::result::Result<(), String> {
        let texels = self.width * self.height;
        if texels == 0 {
            return Err(format!("maps of {}×{} texels, expected at least 1×1", self.width, self.height));
        }
        let mesh = &self.mesh;
        let vertices = mesh.positions.len();
        if mesh.normals.len() != vertices || mesh.uvs.len() != vertices {
            return Err(format!(
                "mesh: {vertices} positions, {} normals, {} uvs; expected as many of each",
                mesh.normals.len(),
                mesh.uvs.len()
            ));
        }
        if !mesh.indices.len().is_multiple_of(3) || mesh.indices.iter().any(|&i| i as usize >= vertices) {
            return Err(format!("mesh: indices must come in threes and stay below {vertices}"));
        }
        if !(mesh.positions.iter().chain(&mesh.normals).all(|p| p.is_finite())
            && mesh.uvs.iter().all(|p| p.is_finite()))
        {
            return Err("mesh: positions, normals and uvs must be finite".into());
        }
        let mut maps: Vec<(String, usize)> = Vec::new();
        for (name, side) in [("front", &self.front), ("back", &self.back)] {
            let mut channels = |what: &str, c: &[Vec<f32>; 3]| {
                maps.extend(c.iter().zip(["R", "G", "B"]).map(|(m, ch)| (format!("{name} {what}.{ch}"), m.len())));
            };
            match &side.interior {
                Interior::Maps { rho_d, rho_t } => {
                    channels("rho_d", rho_d);
                    channels("rho_t", rho_t);
                }
                Interior::Scalars { gamma, thickness, .. } => {
                    channels("gamma", gamma);
                    maps.push((format!("{name} thickness"), thickness.len()));
                }
            }
            if let Some(gloss) = &side.gloss {
                maps.extend(gloss.rho_s.iter().map(|m| (format!("{name} rho_s"), m.len())));
                maps.push((format!("{name} m"), gloss.m.len()));
            }
            if let Some(normal) = &side.normal {
                maps.push((format!("{name} normal"), normal.values.len()));
                if normal.frame == NormalFrame::Tangent && mesh.tangents.len() != vertices {
                    return Err(format!(
                        "{name} normals need tangents: found {}, expected {vertices}",
                        mesh.tangents.len()
                    ));
                }
            }
        }
        if let Some(mask) = &self.mask {
            maps.push(("mask".into(), mask.len()));
        }
        match maps.iter().find(|(_, found)| *found != texels) {
            Some((name, found)) => {
                Err(format!("{name}: {found} texels, expected {}×{} = {texels}", self.width, self.height))
            }
            None => Ok(()),
        }
    }
}
