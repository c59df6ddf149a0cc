//! Scene manifests: which leaves stand where, what lights them, who looks, and how close a picture must come to its reference.
//!
//! Lengths in mm, angles in degrees, world z up, radiance in units set by the light, colours linear sRGB. A path is relative to the
//! scene file. Unknown fields are errors; an error names file, line and field.

use super::translucency::Basis;
use crate::files::atomic::explain;
use crate::{Error, Result};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// `data/scenes/*.toml` (format: `data/scenes/README.md`).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    pub schema: u32,
    pub name: String,
    #[serde(default)]
    pub description: String,
    /// Largest error of a displayed value (0 to 1, after tone mapping and sRGB encoding) that one shortcut of the plan may cause.
    pub tolerance: f64,
    #[serde(default = "one")]
    pub exposure: f64,
    #[serde(default)]
    pub background: [f64; 3],
    #[serde(default, rename = "leaf")]
    pub leaves: Vec<Leaf>,
    #[serde(default, rename = "instance")]
    pub instances: Vec<Instance>,
    pub cluster: Option<Cluster>,
    pub tree: Option<Tree>,
    #[serde(default, rename = "branch")]
    pub branches: Vec<Branch>,
    pub wind: Option<Wind>,
    pub sun: Option<Sun>,
    pub sky: Option<Sky>,
    pub day: Option<Day>,
    #[serde(default, rename = "view")]
    pub views: Vec<View>,
    #[serde(default)]
    pub check: Check,
    /// The file this was read from.
    #[serde(skip)]
    pub path: PathBuf,
}

/// A leaf the scene may show: a fit folder, and where the fit comes from when it is missing or stale.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Leaf {
    pub name: String,
    /// Another leaf's name: this one is drawn from the same data, where they come from is said there.
    pub like: Option<String>,
    pub fit: Option<PathBuf>,
    pub capture: Option<PathBuf>,
    pub scan: Option<Scan>,
    /// glTF in mm; the fit's own blade when absent.
    pub mesh: Option<PathBuf>,
    #[serde(default)]
    pub interior: Interior,
    #[serde(default)]
    pub lobe: Lobe,
    /// Index of refraction of the `cook-torrance` lobe.
    pub index: Option<f64>,
    /// How the sun comes through as it turns; by ρt and the mapped normal alone when absent.
    pub translucency: Option<Translucency>,
}

impl Leaf {
    /// The name that its data go by in a run's folder.
    pub fn data_name(&self) -> &str {
        self.like.as_deref().unwrap_or(&self.name)
    }
}

/// Translucency maps of a leaf, made from its fit.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Translucency {
    /// A folder of `fit translucency`; made in the run's own folder when it is absent or not there.
    pub fit: Option<PathBuf>,
    /// What light is sent through when they are made.
    #[serde(default)]
    pub tissue: Tissue,
    #[serde(default)]
    pub colour: Colour,
    /// What they are made with, and what a folder that is named must hold; when absent, the default and either of the two.
    pub basis: Option<Basis>,
}

/// The slab that the leaf's fit found, or the table of Habel 2009 (one wavelength, 510 nm).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tissue {
    #[default]
    Fit,
    Table,
}

/// One wavelength with the measured colour, or each channel through the tissue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Colour {
    #[default]
    Substituted,
    ThreeWavelengths,
}

/// A synthetic scan to make when there is no capture: what `mesophyll synth` is told.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scan {
    pub spec: PathBuf,
    pub size: Option<String>,
    /// Width and height of what is scanned, around the middle of the specification's field; all of it when absent.
    pub field_mm: Option<[f64; 2]>,
    pub frames: Option<usize>,
    pub noise: Option<f64>,
    pub seed: Option<u64>,
}

/// Where ρd and ρt come from: W's scalars σa and σs with γ and δ maps, or per-texel pigment maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interior {
    #[default]
    Scalars,
    Maps,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Lobe {
    #[default]
    Beckmann,
    Ggx,
    CookTorrance,
}

/// A leaf standing somewhere: scaled, turned about x, then y, then z, then moved.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    pub leaf: String,
    #[serde(default)]
    pub position_mm: [f64; 3],
    #[serde(default)]
    pub rotation_deg: [f64; 3],
    #[serde(default = "one")]
    pub scale: f64,
    /// The branch that it hangs on; position and rotation are then in that branch's frame at `at`.
    pub branch: Option<String>,
    /// 0 (root) to 1 (tip).
    pub at: Option<f64>,
    /// From the branch's axis to the leaf's origin, along the turned leaf's x.
    pub offset_mm: Option<f64>,
}

/// A tapered branch that bends under its weight and in the wind.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Branch {
    pub name: String,
    pub length_mm: f64,
    /// At the root.
    pub radius_mm: f64,
    /// Tip radius over root radius; 1 when neither this nor a fit is given.
    pub taper: Option<f64>,
    /// F/(E′r₁⁴) of its own weight, were it horizontal: what `fit beam --deflections` calls so.
    pub load_over_stiffness_mm: Option<f64>,
    /// A folder of `fit beam --deflections -o`, for taper and load.
    pub fit: Option<PathBuf>,
    /// The measured branch's name there, where it is another.
    pub measured: Option<String>,
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// From root to tip; any length.
    pub direction: [f64; 3],
    /// Diffuse reflectance.
    pub bark: [f64; 3],
    /// Tip deflection over length per m/s of a steady wind across it.
    #[serde(default)]
    pub lean_per_m_s: f64,
    /// Its own frequency; from its length when absent.
    pub resonance_hz: Option<f64>,
    /// Over the critical one.
    #[serde(default = "damping")]
    pub damping: f64,
}

/// A mean wind and its gusts.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wind {
    pub speed_m_s: f64,
    /// Where it blows to, from +x towards +y.
    #[serde(default)]
    pub azimuth_deg: f64,
    /// Standard deviation of the speed over its mean.
    #[serde(default = "turbulence")]
    pub turbulence: f64,
    pub seed: u64,
    /// When the scene is seen, where a view does not say.
    #[serde(default)]
    pub time_s: f64,
}

/// Leaves on a twig along z, a golden angle apart; the same seed gives the same cluster.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cluster {
    /// Leaves by name, taken in turn.
    pub leaves: Vec<String>,
    pub count: usize,
    /// Length of the twig.
    pub length_mm: f64,
    /// From the twig to a blade's centre.
    pub offset_mm: f64,
    /// Mean angle of a blade below the horizontal, and how far single ones stray from it.
    #[serde(default)]
    pub droop_deg: f64,
    #[serde(default)]
    pub spread_deg: f64,
    #[serde(default = "one")]
    pub scale: f64,
    pub seed: u64,
}

/// A crown of leaves on seeded, rigid wood; the trunk's foot is the origin.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tree {
    /// Leaves by name, taken in turn.
    pub leaves: Vec<String>,
    pub count: usize,
    /// From foot to top.
    pub height_mm: f64,
    /// Radius of the crown.
    pub crown_mm: f64,
    /// From the twig to a blade's centre.
    pub offset_mm: f64,
    #[serde(default)]
    pub droop_deg: f64,
    /// How far single blades stray.
    #[serde(default)]
    pub spread_deg: f64,
    #[serde(default = "one")]
    pub scale: f64,
    /// Diffuse reflectance.
    pub bark: [f64; 3],
    pub seed: u64,
}

/// The sun as a disk.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sun {
    /// From straight up; more than 90 shines from below.
    pub zenith_deg: f64,
    /// From +x towards +y.
    #[serde(default)]
    pub azimuth_deg: f64,
    /// On a surface that faces the sun; under a physical sky the model's own when absent.
    pub irradiance: Option<[f64; 3]>,
    #[serde(default = "sun_radius")]
    pub radius_deg: f64,
    /// The sun will stand elsewhere too: the sky comes from the polynomial fit.
    #[serde(default)]
    pub moves: bool,
}

/// A constant sky all around, or a physical one above the horizon.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sky {
    /// Of the constant sky.
    pub radiance: Option<[f64; 3]>,
    /// Of the physical one.
    pub model: Option<SkyModel>,
    pub turbidity: Option<f64>,
    /// Of a level, matte ground that lights the scene from below; none when absent.
    pub ground_albedo: Option<[f64; 3]>,
    /// Scene units of radiance a kcd/m²; 1 when absent.
    pub scale: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SkyModel {
    Preetham,
}

/// Solar hours at which the scene is drawn too.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Day {
    pub latitude_deg: f64,
    /// Of the sun: 0 at the equinoxes, 23.44 in June.
    #[serde(default)]
    pub declination_deg: f64,
    /// 12 is noon.
    pub hours: Vec<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ViewKind {
    /// The scene as it stands.
    Perspective,
    /// A flat patch with one leaf's mean parameters, lit as the scene is: its radiance is known in closed form.
    Card,
}

/// What light through translucency maps is judged against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JudgedBy {
    /// The full convolution for this very sun.
    #[default]
    Convolution,
    /// The reference by the stored coefficients: the renderer alone is judged, and what the basis costs is reported beside it.
    Maps,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    pub name: String,
    pub kind: ViewKind,
    pub eye_mm: Option<[f64; 3]>,
    pub target_mm: Option<[f64; 3]>,
    pub up: Option<[f64; 3]>,
    pub fov_deg: Option<f64>,
    /// The card's leaf and how it is turned.
    pub leaf: Option<String>,
    pub rotation_deg: Option<[f64; 3]>,
    /// When the scene is seen, instead of the wind's own time.
    pub time_s: Option<f64>,
    /// Largest 99th percentile of FLIP against the reference.
    pub flip_p99: Option<f64>,
    /// Largest difference of a displayed value (0 to 1) over interior pixels; for a card, of the radiance relative to the closed form.
    pub max_error: Option<f64>,
    /// Largest median frame time (ms); judged on real GPUs only.
    pub frame_ms: Option<f64>,
    #[serde(default)]
    pub judged_by: JudgedBy,
}

/// How a check is done.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Check {
    pub width: u32,
    pub height: u32,
    /// Rays a pixel of the reference.
    pub samples: u32,
    /// Frames timed a view.
    pub frames: u32,
    /// Seed of the reference; its noise is measured against the next seed.
    pub seed: u64,
}

impl Default for Check {
    fn default() -> Self {
        Check { width: 800, height: 600, samples: 64, frames: 20, seed: 1 }
    }
}

fn one() -> f64 {
    1.0
}

fn damping() -> f64 {
    0.15
}

fn turbulence() -> f64 {
    0.3
}

fn sun_radius() -> f64 {
    0.2666
}

impl Manifest {
    /// Reads and validates a scene file.
    ///
    /// # Errors
    /// [`Error::Input`] naming the file, the line and the field, what was found and what was expected.
    pub fn read(path: &Path) -> Result<Manifest> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::input(path, explain(&e)))?;
        let mut manifest: Manifest = toml::from_str(&text).map_err(|e| Error::toml(path, &text, &e))?;
        manifest.path = path.to_path_buf();
        super::validate::validate(&manifest, &text)?;
        manifest.share();
        Ok(manifest)
    }

    /// Gives leaves that are like another one its data.
    fn share(&mut self) {
        for k in 0..self.leaves.len() {
            let Some(other) = self.leaves[k].like.as_ref().and_then(|n| self.leaf_index(n)) else { continue };
            let Leaf { fit, capture, scan, mesh, .. } = self.leaves[other].clone();
            let leaf = &mut self.leaves[k];
            (leaf.fit, leaf.capture, leaf.scan) = (fit, capture, scan);
            leaf.mesh = leaf.mesh.take().or(mesh);
        }
    }

    /// A path of the manifest, as seen from the working folder.
    pub fn resolve(&self, relative: &Path) -> PathBuf {
        match self.path.parent() {
            Some(folder) if relative.is_relative() && !folder.as_os_str().is_empty() => tidy(&folder.join(relative)),
            _ => relative.to_path_buf(),
        }
    }

    /// Whether the sky is a model's.
    pub fn physical_sky(&self) -> bool {
        self.sky.as_ref().is_some_and(|s| s.model.is_some())
    }

    /// Whether the sun stands in more than one place.
    pub fn sun_moves(&self) -> bool {
        self.day.is_some() || self.sun.as_ref().is_some_and(|s| s.moves)
    }

    pub fn branch_index(&self, name: &str) -> Option<usize> {
        self.branches.iter().position(|b| b.name == name)
    }

    pub fn leaf_index(&self, name: &str) -> Option<usize> {
        self.leaves.iter().position(|l| l.name == name)
    }
}

/// `a/b/../c` → `a/c`, as far as the text tells.
fn tidy(path: &Path) -> PathBuf {
    use std::path::Component;
    let mut out: Vec<Component> = Vec::new();
    for part in path.components() {
        match (part, out.last()) {
            (Component::ParentDir, Some(Component::Normal(_))) => {
                out.pop();
            }
            (Component::CurDir, _) => {}
            _ => out.push(part),
        }
    }
    out.iter().collect()
}
